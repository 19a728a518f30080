// Layout of the sums that precondition_camera keeps of each segment: the upper triangle of the camera unknowns' block by
// rows (pose, then the camera's parameters), their right-hand side, and the pose's block before points are eliminated.

#import "common/unit.wgsl"

const SIDE = 6u + PARAMS;
const ENTRIES = SIDE * SIDE;
const TRIANGLE = SIDE * (SIDE + 1u) / 2u;
const POSE_TRIANGLE = 21u;
const POSE_AT = TRIANGLE + SIDE;
const SUMS = POSE_AT + POSE_TRIANGLE;

// Place of (row, column), row ≤ column, in an upper triangle of a matrix with `side` rows.
fn triangle_at(side: u32, row: u32, column: u32) -> u32 {
    return row * side - row * (row + 1u) / 2u + column;
}
