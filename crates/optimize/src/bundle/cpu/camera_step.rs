//! A step of the camera unknowns, spread to what products per observation need.

use epipole_geometry::camera::{MAX_PARAMS, Real};

use super::structure::Structure;

/// A step by image and by camera, in the working scalar.
#[derive(Clone, Debug)]
pub(super) struct CameraStep<T> {
    /// World rotation and centre.
    pub(super) pose: Vec<([T; 3], [T; 3])>,
    params: Vec<([T; MAX_PARAMS], usize)>,
}

impl<T: Real> CameraStep<T> {
    pub(super) fn new(structure: &Structure, x: &[f64]) -> Self {
        let pose = (0..structure.num_images()).map(|i| {
            let step = &x[structure.layout.range(i)];
            let dof = structure.pose_dof[i] as usize;
            let three = |from: usize| std::array::from_fn(|k| T::from_f64(step[from + k]));
            let rotation = if dof == 6 { three(0) } else { [T::ZERO; 3] };
            let center = if dof >= 3 { three(dof - 3) } else { [T::ZERO; 3] };
            (rotation, center)
        });
        let params = structure.free_params.iter().zip(&structure.param_slot).map(|(free, slot)| {
            let start = structure.layout.offset(slot.block) + slot.offset;
            let mut step = [T::ZERO; MAX_PARAMS];
            step.iter_mut().zip(&x[start..start + free.len()]).for_each(|(a, &b)| *a = T::from_f64(b));
            (step, free.len())
        });
        Self { pose: pose.collect(), params: params.collect() }
    }

    #[inline(always)]
    pub(super) fn params(&self, camera: usize) -> &[T] {
        let (step, count) = &self.params[camera];
        &step[..*count]
    }
}
