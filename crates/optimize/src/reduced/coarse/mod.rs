//! The second level of the preconditioner: `M⁻¹ = D⁻¹ + Z A⁻¹ Zᵀ`, `A = Zᵀ S Z` (source: `scale.md` §3).
//!
//! Block-Jacobi `D` cannot bend a long street: an error that moves whole stretches of it costs almost nothing image by
//! image, and PCG hands it on from one image to its neighbours. The columns of `Z` are just these errors: a translation, a
//! rotation and a scale of each cluster of images that see the same points, blended where clusters meet, and each
//! shared camera parameter. On a street of 500 images this takes 30 times fewer products.
//!
//! Clusters and weights belong to the problem, modes to a state, the matrix to a state and a damping; the last two may
//! be a few steps old.

mod apply;
mod blending;
mod clusters;
mod matrix;
mod modes;

pub(crate) use apply::CoarseSpace;
#[cfg(feature = "gpu")]
pub(crate) use blending::MAX_MEMBERSHIPS;
pub(crate) use matrix::CoarseMatrix;
#[cfg(feature = "gpu")]
pub(crate) use matrix::invert;
pub(crate) use modes::Basis;

/// Fewer images than this have no stretches to bend; block-Jacobi alone converges (source: `scale.md` §5).
pub(crate) const MIN_IMAGES: usize = 60;
/// Steps with which a matrix is used before it is made anew (source: `scale.md` §5).
pub(crate) const REBUILD_AFTER: usize = 2;
/// As many steps in a row with PCG at its limit call for the second level whatever the size (source: `scale.md` §5).
pub(crate) const STEPS_AT_LIMIT: usize = 3;
/// Intrinsics groups whose parameters become columns; with more, each says little about the whole (source:
/// `scale.md` §3.3).
pub(crate) const MAX_GROUPS: usize = 8;

/// Images per cluster, and how many clusters there may be (source: `scale.md` §5).
const IMAGES_PER_CLUSTER: usize = 30;
const MIN_CLUSTERS: usize = 16;
const MAX_CLUSTERS: usize = 128;

/// For each image, its clusters (numbered from 0) and weights.
pub(crate) type Memberships = Vec<Vec<(u32, f64)>>;

/// Clusters the images that share points; `images[track_start[p]..track_start[p + 1]]` saw point `p`.
pub(crate) fn memberships(num_images: usize, track_start: &[u32], images: &[u32]) -> Memberships {
    let wanted = (num_images / IMAGES_PER_CLUSTER).clamp(MIN_CLUSTERS, MAX_CLUSTERS);
    let covisibility = clusters::Covisibility::new(num_images, track_start, images);
    // What the bound on a cluster's size keeps apart may exceed the wanted number by a quarter.
    let cluster = clusters::clusters(&covisibility, wanted, wanted + wanted / 4);
    renumbered(blending::blend(&covisibility, &cluster))
}

/// Where everything sees everything, smoothing leaves some clusters without anyone who has them among the largest: their
/// numbers go to others.
fn renumbered(mut memberships: Memberships) -> Memberships {
    let count = memberships.iter().flatten().map(|m| m.0 as usize + 1).max().unwrap_or(0);
    let mut used = vec![false; count];
    memberships.iter().flatten().for_each(|m| used[m.0 as usize] = true);
    let numbers: Vec<u32> = used
        .iter()
        .scan(0, |next, &used| {
            let number = *next;
            *next += u32::from(used);
            Some(number)
        })
        .collect();
    memberships.iter_mut().flatten().for_each(|m| m.0 = numbers[m.0 as usize]);
    memberships
}
