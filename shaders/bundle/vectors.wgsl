// The vectors of the reduced system in one buffer: four vec4f of state, then sections of two vec4f an image (rotation,
// centre, two unused) and two a camera (parameters).

// state[0] = iterations, done, rᵀz, twice the model's decrease; state[1] = ‖x‖², largest |x|, what priors cost less at the
// tried state, what they cost there.
const STATE = 4u;
const SCALE = 0u;
const RHS = 1u;
const X = 2u;
const RESIDUAL = 3u;
const Z = 4u;
const DIRECTION = 5u;
const PRODUCT = 6u;
// The direction times the scale: what the products per observation read.
const SCALED = 7u;
// Priors in column scale: their diagonal, beside the damping, and their gradient.
const PRIOR_DIAGONAL = 8u;
const PRIOR_GRADIENT = 9u;

fn section(which: u32, units: u32) -> u32 {
    return STATE + which * 2u * units;
}
