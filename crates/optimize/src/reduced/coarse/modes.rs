//! The columns of `Z`: how a similarity of a cluster moves its images, and unit columns for shared parameters.

use glam::DVec3;

use super::Memberships;
use crate::reduced::BlockLayout;

/// Three translations, three rotations, one scale.
pub(crate) const MODES: usize = 7;

/// Weighted centre and rms radius of a cluster's image centres.
#[derive(Clone, Copy, Debug)]
struct Extent {
    center: DVec3,
    radius: f64,
}

/// The rows of `Z` that belong to one block of unknowns, by the columns it has a part in.
#[derive(Clone, Debug)]
pub(crate) struct Columns {
    /// First column.
    pub(crate) first: usize,
    /// Row-major, unknowns of the block × columns.
    pub(crate) values: Vec<f64>,
    pub(crate) count: usize,
}

/// `Z`, by blocks of unknowns.
#[derive(Clone, Debug)]
pub(crate) struct Basis {
    pub(crate) dim: usize,
    pub(crate) of_block: Vec<Vec<Columns>>,
}

impl Basis {
    /// Blocks `0..memberships.len()` of `layout` are images; the first `pose_unknowns[i]` unknowns of image `i` are its
    /// world rotation and centre (6), its centre (3) or nothing (0). Each of `groups` is a block whose unknowns become
    /// columns of their own. Rows of removed unknowns are 0.
    pub(crate) fn new(
        layout: &BlockLayout,
        memberships: &Memberships,
        centers: &[DVec3],
        pose_unknowns: &[u8],
        groups: &[usize],
        removed: &[bool],
    ) -> Self {
        let extents = extents(memberships, centers);
        let mut of_block = vec![Vec::new(); layout.num_blocks()];
        for (i, weights) in memberships.iter().enumerate() {
            if pose_unknowns[i] == 0 {
                continue;
            }
            for &(cluster, weight) in weights {
                let extent = &extents[cluster as usize];
                let from_center = (centers[i] - extent.center) / extent.radius;
                let mut values = vec![0.0; layout.size(i) * MODES];
                let modes = pose_modes(weight, from_center, extent.radius);
                let skip = 6 - pose_unknowns[i] as usize;
                for (row, mode) in values.chunks_exact_mut(MODES).zip(&modes[skip..]) {
                    row.copy_from_slice(mode);
                }
                of_block[i].push(Columns { first: MODES * cluster as usize, values, count: MODES });
            }
        }
        let mut dim = MODES * extents.len();
        for &block in groups {
            let count = layout.size(block);
            let values = (0..count * count).map(|k| f64::from(u8::from(k / count == k % count))).collect();
            of_block[block].push(Columns { first: dim, values, count });
            dim += count;
        }
        for (block, columns) in of_block.iter_mut().enumerate() {
            for columns in columns {
                let rows = columns.values.chunks_exact_mut(columns.count);
                for (row, _) in rows.zip(&removed[layout.range(block)]).filter(|(_, removed)| **removed) {
                    row.fill(0.0);
                }
            }
        }
        Self { dim, of_block }
    }
}

/// Rows: rotation about the world's axes (R ← R exp[ω]×), centre. Columns: [`MODES`]. `from_center` is `(C − c)/ρ`.
fn pose_modes(weight: f64, from_center: DVec3, radius: f64) -> [[f64; MODES]; 6] {
    let mut modes = [[0.0; MODES]; 6];
    for (k, axis) in DVec3::AXES.into_iter().enumerate() {
        modes[3 + k][k] = weight;
        // Turning the cluster about its centre turns each image against the world: ω = −e/ρ for δC = e × (C − c)/ρ.
        modes[k][3 + k] = -weight / radius;
        let moved = weight * axis.cross(from_center);
        (0..3).for_each(|row| modes[3 + row][3 + k] = moved[row]);
        modes[3 + k][6] = weight * from_center[k];
    }
    modes
}

fn extents(memberships: &Memberships, centers: &[DVec3]) -> Vec<Extent> {
    let count = memberships.iter().flatten().map(|m| m.0 as usize + 1).max().unwrap_or(0);
    let mut total = vec![0.0; count];
    let mut extents = vec![Extent { center: DVec3::ZERO, radius: 0.0 }; count];
    let members = || memberships.iter().zip(centers).flat_map(|(m, &c)| m.iter().map(move |m| (m.0 as usize, m.1, c)));
    for (cluster, weight, center) in members() {
        extents[cluster].center += weight * center;
        total[cluster] += weight;
    }
    for (extent, total) in extents.iter_mut().zip(&total) {
        extent.center /= total.max(f64::MIN_POSITIVE);
    }
    for (cluster, weight, center) in members() {
        let extent = &mut extents[cluster];
        extent.radius += weight * center.distance_squared(extent.center) / total[cluster];
    }
    for extent in &mut extents {
        // One image, or several in one place: any length will do, as columns are scaled before they are used.
        extent.radius = if extent.radius > 0.0 { extent.radius.sqrt() } else { 1.0 };
    }
    extents
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_of_one_cluster_are_the_similarities() {
        let centers: Vec<DVec3> = (0..5).map(|k| DVec3::new(f64::from(k), 0.3 * f64::from(k * k), -2.0)).collect();
        let memberships = vec![vec![(0, 1.0)]; 5];
        let layout = BlockLayout::new(vec![6, 6, 3, 0, 6, 2]);
        let mut removed = vec![false; layout.dim()];
        removed[layout.offset(4) + 1] = true;
        let basis = Basis::new(&layout, &memberships, &centers, &[6, 6, 3, 0, 6], &[5], &removed);
        assert_eq!(basis.dim, 9);
        // A small rotation ω about c and a scale s move C to c + (1 + s)(C − c) + ω × (C − c), and turn images by −ω.
        let (omega, s) = (DVec3::new(0.2, -0.1, 0.3), 0.5);
        let center: DVec3 = centers.iter().sum::<DVec3>() / 5.0;
        let radius = (centers.iter().map(|c| c.distance_squared(center)).sum::<f64>() / 5.0).sqrt();
        let y = [0.0, 0.0, 0.0, omega.x * radius, omega.y * radius, omega.z * radius, s * radius];
        for i in [0, 1, 2, 4] {
            let columns = &basis.of_block[i][0];
            let step: Vec<f64> =
                columns.values.chunks_exact(7).map(|row| row.iter().zip(y).map(|(a, b)| a * b).sum()).collect();
            let arm = centers[i] - center;
            let moved = omega.cross(arm) + s * arm;
            let found = DVec3::from_slice(&step[step.len() - 3..]);
            assert!((found - moved).length() < 1e-12, "image {i}: {found} {moved}");
            if i != 2 {
                let turned = if i == 4 { DVec3::new(-0.2, 0.0, -0.3) } else { -omega };
                assert!((DVec3::from_slice(&step[..3]) - turned).length() < 1e-12);
            }
        }
        assert!(basis.of_block[3].is_empty());
        assert_eq!(
            (basis.of_block[5][0].first, basis.of_block[5][0].values.as_slice()),
            (7, &[1.0, 0.0, 0.0, 1.0][..])
        );
    }
}
