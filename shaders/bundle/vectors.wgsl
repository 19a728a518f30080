// The vectors of the reduced system in one buffer: four vec4f of state, then sections of one Unit an image (rotation,
// centre) and one a camera (parameters). The kernel declares `vectors`.

#import "bundle/row.wgsl"

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
// Behind the units' sections, two vec4f a row of the coarse matrix's blocks: Zᵀ r, then A⁻¹ Zᵀ r.
const COARSE = 10u;

fn section(which: u32, units: u32) -> u32 {
    return STATE + which * UNIT_VEC4 * units;
}

fn load_unit(start: u32, unit: u32) -> Unit {
    let at = start + UNIT_VEC4 * unit;
#if wide
    return Unit(vectors[at], vectors[at + 1u], vectors[at + 2u], vectors[at + 3u]);
#else
    return Unit(vectors[at], vectors[at + 1u]);
#endif
}

// An image and its camera in a section.
fn load_step(start: u32, image: u32, camera: u32) -> CameraStep {
    let at = start + UNIT_VEC4 * image;
    return CameraStep(vectors[at], vectors[at + 1u], load_unit(start, camera));
}
