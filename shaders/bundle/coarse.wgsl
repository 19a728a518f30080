// Records of the coarse matrix's assembly, as crates/optimize/src/bundle/gpu/coarse lays them out.

// A block of 8 × 8 that is kept: row ≤ column.
struct CoarseBlock {
    row: u32,
    column: u32,
    // Block of its row that is kept first; those of a row follow one another, columns ascending.
    first: u32,
    // Camera and eight of its parameters, of a column and of a row that belong to a camera.
    camera: u32,
    eighth: u32,
    row_camera: u32,
    row_eighth: u32,
    padding: u32,
}

// What a point has to do with one row of blocks. A point's entries follow one another, rows ascending.
struct CoarseEntry {
    // NO_ENTRY beyond the last.
    point: u32,
    row: u32,
    // One past the last entry of the point.
    end: u32,
    // 0 for a cluster, else 1 + the eight of the camera's parameters.
    kind: u32,
    track_start: u32,
    track_end: u32,
    camera: u32,
    padding: u32,
}

const NO_ENTRY = 0xffffffffu;

// Entries of a row in a piece of points that one workgroup pairs. The piece is an array of words: the number of segments,
// the number of rows; for each row and beyond, its first segment; the segments; then entries sorted by row.
struct CoarseSegment {
    // First block of the row and how many there are.
    first: u32,
    count: u32,
    // Sorted entries.
    start: u32,
    end: u32,
    // First block of its partial sums.
    out: u32,
}

const SEGMENT_WORDS = 5u;
