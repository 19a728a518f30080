//! How sums over points and images are cut, so that their order depends on the problem alone: segments of an image's
//! observations, rows of eight sums that [`REDUCE`](super::kernels::REDUCE) takes by spans, and the host's last addition.

/// Observations of one image that one workgroup sums (source: `solver.md` §2.1).
const SEGMENT: usize = 512;
/// Rows of sums that the host adds in `f64` at most (source: `solver.md` §1.4).
const HOST_ROWS: u64 = 1024;
/// Rows that one workgroup of the second stage sums at least: one a lane.
const MIN_SPAN: u64 = 64;
/// Bytes of a row of eight sums.
pub(crate) const ROW_BYTES: u64 = 32;

/// Image, start, end, and room for a word, of every segment; `start` has the images' offsets and the end.
pub(crate) fn segments(start: &[u32]) -> Vec<[u32; 4]> {
    let mut out = Vec::new();
    for (image, range) in (0u32..).zip(start.windows(2)) {
        for from in (range[0]..range[1]).step_by(SEGMENT) {
            out.push([image, from, range[1].min(from + SEGMENT as u32), 0]);
        }
    }
    out
}

/// Rows that one workgroup of the second stage sums, and rows that are left for the host.
pub(crate) fn spans(rows: u64) -> (u64, u64) {
    let span = rows.div_ceil(HOST_ROWS).max(MIN_SPAN);
    (span, rows.div_ceil(span))
}

/// Sums of the columns of rows (eighth: maximum), in `f64`.
pub(crate) fn totals(rows: &[[f32; 8]]) -> [f64; 8] {
    rows.iter().fold([0.0; 8], |mut sum, row| {
        (0..7).for_each(|k| sum[k] += f64::from(row[k]));
        sum[7] = sum[7].max(f64::from(row[7]));
        sum
    })
}
