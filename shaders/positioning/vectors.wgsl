// The vectors of the reduced system in one buffer: four vec4f of state, then sections of one vec4f a camera.

// state[0] = iterations, done, rᵀz, twice the model's decrease;
// state[1] = xᵀDx, then the largest |x √D|, |x| and |C| of a coordinate;
// state[2] = what position_gauge found: the mean centre, new lengths per old length;
// state[3] = the least scale, unused.
const STATE = 4u;
const RHS = 0u;
const X = 1u;
const RESIDUAL = 2u;
const Z = 3u;
const DIRECTION = 4u;
const PRODUCT = 5u;
// What λ multiplies.
const DIAGONAL = 6u;
// The inverse of the preconditioner's block: (00 01 02), then (11 12 22).
const INVERSE_TOP = 7u;
const INVERSE_BOTTOM = 8u;

fn section(which: u32, cameras: u32) -> u32 {
    return STATE + which * cameras;
}
