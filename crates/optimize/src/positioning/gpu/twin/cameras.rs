//! Twins of the kernels that walk segments of a camera, and of the vector kernels of PCG.

use super::points::{floored, solve_row};
use super::state::{Chunk, State};
use crate::bundle::gpu::twin::num::{Num, Vec3, add, dot, scale, sub, tree, zero};

const LANES: usize = 256;

/// What `pcg_step` leaves behind.
pub(super) struct PcgState<N> {
    /// x, residual, z, direction by camera.
    pub(super) vectors: Vec<[Vec3<N>; 4]>,
    /// Iterations, rᵀz, twice the model's decrease, xᵀDx.
    pub(super) scalars: [N; 4],
}

impl<N: Num> State<N> {
    /// Sums over segments: lanes take every 64th observation, then the tree.
    fn by_segment<const W: usize>(
        &self,
        chunk: &Chunk<N>,
        value: impl Fn(usize, (usize, N, usize)) -> [N; W],
    ) -> Vec<[N; W]> {
        let segment = |&[camera, start, end, _]: &[u32; 4]| {
            let places = |lane: usize| (start as usize + lane..end as usize).step_by(64);
            let lane =
                |lane| places(lane).map(|o| value(camera as usize, chunk.by_camera[o])).fold(zero(), add::<N, W>);
            tree((0..64).map(lane).collect())
        };
        chunk.segments.iter().map(segment).collect()
    }

    /// By segment: block, right-hand side, diagonal, as `precondition.wgsl` orders them.
    pub(super) fn precondition_sums(&self, chunk: &Chunk<N>) -> Vec<[N; 12]> {
        self.by_segment(chunk, |camera, (p, _, index)| {
            let point = &chunk.points[p];
            let d = sub(point.x, self.center(0, camera));
            let found = self.linear(chunk.rays[index], self.centers[camera][3], d);
            let unit = |k: usize| std::array::from_fn(|j| N::of(f32::from(u8::from(j == k))));
            let a: [Vec3<N>; 3] = std::array::from_fn(|k| found.row.root(unit(k)));
            let z = a.map(|a| solve_row(&chunk.blocks[p], a));
            let n = |i: usize, j: usize| N::of(f32::from(u8::from(i == j))) - dot(&z[i], &z[j]);
            let m: [Vec3<N>; 3] =
                std::array::from_fn(|k| std::array::from_fn(|i| dot(&[n(i, 0), n(i, 1), n(i, 2)], &a[k])));
            let right = sub(found.gradient, found.row.block(point.s));
            let entry = |i: usize, j: usize| dot(&a[i], &m[j]);
            let square = |k: usize| dot(&a[k], &a[k]);
            [
                entry(0, 0),
                entry(0, 1),
                entry(0, 2),
                entry(1, 1),
                entry(1, 2),
                entry(2, 2),
                right[0],
                right[1],
                right[2],
                square(0),
                square(1),
                square(2),
            ]
        })
    }

    /// By camera: the sum of its segments in `block_sums`.
    pub(super) fn block_sum(&self, camera: usize) -> [N; 12] {
        self.segments_of(camera).iter().map(|&s| self.block_sums[s as usize]).fold(zero(), add)
    }

    pub(super) fn diagonal(&self, camera: usize) -> Vec3<N> {
        let sum = self.block_sum(camera);
        floored([sum[9], sum[10], sum[11]])
    }

    /// By segment: `A e` and `‖e‖²`.
    pub(super) fn product_camera(&self, chunk: &Chunk<N>) -> Vec<[N; 4]> {
        self.by_segment(chunk, |camera, (p, kept, index)| {
            let point = &chunk.points[p];
            let row = self.row(kept, sub(point.x, self.center(0, camera)), chunk.rays[index]);
            let e = row.root(sub(self.vector(4, camera), point.s));
            let out = row.root(e);
            [out[0], out[1], out[2], dot(&e, &e)]
        })
    }

    /// Sums over cameras: lanes take every 256th, then the tree.
    pub(super) fn by_camera<const W: usize>(&self, value: impl Fn(usize) -> [N; W]) -> [N; W] {
        let lane = |lane: usize| (lane..self.cameras).step_by(LANES).map(&value).fold(zero(), add);
        tree((0..LANES).map(lane).collect())
    }

    fn precondition(&self, camera: usize, r: Vec3<N>) -> Vec3<N> {
        let (t, b) = (self.vector(7, camera), self.vector(8, camera));
        [dot(&t, &r), dot(&[t[1], b[0], b[1]], &r), dot(&[t[2], b[1], b[2]], &r)]
    }

    /// Direction and rᵀz at the start.
    pub(super) fn pcg_start(&self) -> (Vec<Vec3<N>>, N) {
        let z: Vec<_> = (0..self.cameras).map(|camera| self.precondition(camera, self.vector(0, camera))).collect();
        let [rz] = self.by_camera(|camera| [dot(&self.vector(0, camera), &z[camera])]);
        (z, rz)
    }

    pub(super) fn pcg_step(&self) -> PcgState<N> {
        let part = |camera: usize| {
            self.segments_of(camera).iter().map(|&s| self.partials[s as usize]).fold(zero::<N, 4>(), add)
        };
        let damped = |camera: usize| -> Vec3<N> {
            let (d, p) = (self.vector(6, camera), self.vector(4, camera));
            std::array::from_fn(|k| d[k] * p[k])
        };
        // Every lane goes on from its groups to its cameras.
        let lane = |lane: usize| {
            let groups = self.sums.iter().skip(lane).step_by(LANES).map(|s| s[0]).fold(N::of(0.0), |a, b| a + b);
            (lane..self.cameras).step_by(LANES).fold([groups, N::of(0.0)], |sum, camera| {
                [sum[0] + part(camera)[3], sum[1] + dot(&damped(camera), &self.vector(4, camera))]
            })
        };
        let [squares, damped_squares] = tree((0..LANES).map(lane).collect());
        let alpha = self.vectors[0][2] / (squares + self.lambda() * damped_squares);
        let next = |camera: usize| {
            let sum = part(camera);
            let q = add([sum[0], sum[1], sum[2]], scale(damped(camera), self.lambda()));
            let x = add(self.vector(1, camera), scale(self.vector(4, camera), alpha));
            let r = sub(self.vector(2, camera), scale(q, alpha));
            (x, r, self.precondition(camera, r))
        };
        let all: Vec<_> = (0..self.cameras).map(next).collect();
        let [improved, rz, length] = self.by_camera(|camera| {
            let ((x, r, z), d) = (all[camera], self.vector(6, camera));
            let dx: Vec3<N> = std::array::from_fn(|k| d[k] * x[k]);
            [dot(&x, &add(self.vector(0, camera), r)), dot(&r, &z), dot(&x, &dx)]
        });
        let beta = rz / self.vectors[0][2];
        let finish = |camera: usize| {
            let (x, r, z) = all[camera];
            [x, r, z, add(z, scale(self.vector(4, camera), beta))]
        };
        let scalars = [self.vectors[0][0] + N::of(1.0), rz, improved, length];
        PcgState { vectors: (0..self.cameras).map(finish).collect(), scalars }
    }
}
