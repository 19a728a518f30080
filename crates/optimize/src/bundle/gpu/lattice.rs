//! Integer cells that positions are anchored to, so that `f32` loses nothing far from the origin (`solver.md` §1.3 c).

use glam::DVec3;

use crate::bundle::problem::Problem;

/// Cells a point's record can hold along one axis.
const CELLS: f64 = 1024.0;
/// Share of points, at each end of an axis, that may lie outside the lattice: their offsets grow instead of the cells.
const OUTSIDE: f64 = 0.02;
/// Share of the lattice that the points fill at the start, so that they have room to move.
const FILL: f64 = 0.9;

/// The lattice of a problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lattice {
    /// Size of a cell, a power of two.
    pub(super) cell: f64,
    /// Corner of cell 0.
    pub(super) origin: DVec3,
}

impl Lattice {
    /// Cells of about the median depth, larger where the scene would not fit.
    pub(super) fn new(problem: &Problem) -> Self {
        let mut depths = Vec::with_capacity(problem.observation_image.len());
        for (point, track) in problem.points.iter().zip(problem.track_start.windows(2)) {
            let images = &problem.observation_image[track[0] as usize..track[1] as usize];
            depths.extend(images.iter().map(|&i| problem.cam_from_world[i as usize].transform_point(*point).length()));
        }
        let depth = quantile(&mut depths, 0.5).filter(|d| *d > 0.0).unwrap_or(1.0);
        let axis = |k: usize, share: f64| {
            quantile(&mut problem.points.iter().map(|p| p[k]).collect::<Vec<_>>(), share).unwrap_or(0.0)
        };
        let low = DVec3::from_array(std::array::from_fn(|k| axis(k, OUTSIDE)));
        let high = DVec3::from_array(std::array::from_fn(|k| axis(k, 1.0 - OUTSIDE)));
        let least = (high - low).max_element() / (FILL * CELLS);
        // Also keeps cell indices of cameras inside an i32.
        let reach = low.abs().max(high.abs()).max_element() / 1e9;
        let cell = depth.max(least).max(reach).log2().ceil().clamp(-60.0, 60.0).exp2();
        // A whole number of cells, so that moving the origin is exact.
        let origin = ((0.5 * (low + high) / cell).round() - 0.5 * CELLS) * cell;
        Self { cell, origin }
    }

    /// Cell and offset of a point; the cell is one the lattice has.
    pub(super) fn point(&self, position: DVec3) -> (u32, [f32; 3]) {
        let cell = ((position - self.origin) / self.cell).round().clamp(DVec3::ZERO, DVec3::splat(CELLS - 1.0));
        let offset = position - self.origin - cell * self.cell;
        let [x, y, z] = cell.to_array().map(|c| c as u32);
        (x | y << 10 | z << 20, offset.to_array().map(|v| v as f32))
    }

    /// Cell and offset of a camera centre; any cell will do.
    pub(super) fn center(&self, position: DVec3) -> ([i32; 3], [f32; 3]) {
        let cell = ((position - self.origin) / self.cell).round();
        let offset = position - self.origin - cell * self.cell;
        (cell.to_array().map(|c| c as i32), offset.to_array().map(|v| v as f32))
    }

    /// A point's position from its record.
    pub(super) fn position(&self, cell: u32, offset: [f32; 3]) -> DVec3 {
        let cells = [cell & 1023, cell >> 10 & 1023, cell >> 20 & 1023].map(f64::from);
        self.origin + DVec3::from_array(cells) * self.cell + DVec3::from_array(offset.map(f64::from))
    }

    /// A centre's position from its record.
    pub(super) fn center_position(&self, cell: [i32; 3], offset: [f32; 3]) -> DVec3 {
        self.origin + DVec3::from_array(cell.map(f64::from)) * self.cell + DVec3::from_array(offset.map(f64::from))
    }
}

fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let at = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_survive_far_from_the_origin_and_outside_the_lattice() {
        let mut problem = Problem::default();
        for k in 0..200 {
            let k = f64::from(k);
            problem.points.push(DVec3::new(1e6 + 0.1 * k, -3e5 + 0.37 * k, 0.01 * k));
        }
        problem.points.push(DVec3::new(9e6, 0.0, 0.0));
        problem.track_start = vec![0; 202];
        let lattice = Lattice::new(&problem);
        for (k, &position) in problem.points.iter().enumerate() {
            let (cell, offset) = lattice.point(position);
            let error = (lattice.position(cell, offset) - position).length();
            assert!(error < if k < 200 { 1e-6 } else { 1.0 }, "{k}: {error}");
            let (cell, offset) = lattice.center(position);
            assert!((lattice.center_position(cell, offset) - position).length() < 1e-6);
        }
    }
}
