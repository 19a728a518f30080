//! Twins of the kernels of the coarse space, and their comparison.

use epipole_geometry::camera::MAX_PARAMS;

use super::bench::{Bench, compare, flat};
use super::num::{Num, Vec3, add, cross, dot, scale, sub, zero};
use super::points::solve_row;
use super::state::State;
use crate::bundle::gpu::coarse::{PieceWords, Plan};
use crate::bundle::gpu::records::{HIDDEN, OUT};
use crate::reduced::coarse::MAX_MEMBERSHIPS;

/// One image in one cluster, as `Mode` in `modes.wgsl`.
#[derive(Clone, Copy)]
pub(super) struct Mode<N> {
    pub(super) from_center: Vec3<N>,
    pub(super) inverse_radius: N,
    pub(super) cluster: u32,
    pub(super) blended: N,
    pub(super) weight: N,
}

impl<N: Num> Mode<N> {
    pub(super) fn read(words: &[u32]) -> Self {
        let real = |k: usize| N::of(f32::from_bits(words[k]));
        Self {
            from_center: std::array::from_fn(real),
            inverse_radius: real(3),
            cluster: words[4],
            blended: real(5),
            weight: real(6),
        }
    }

    /// Rotation and centre of column `k`.
    fn pose(&self, k: usize) -> [N; 6] {
        let none = N::of(0.0);
        let axis = |k: usize| -> Vec3<N> { std::array::from_fn(|j| N::of(if j == k { 1.0 } else { 0.0 })) };
        let (rotation, center) = match k {
            0..3 => ([none; 3], scale(axis(k), self.weight)),
            3..6 => (
                scale(axis(k - 3), -(self.weight * self.inverse_radius)),
                scale(cross(axis(k - 3), self.from_center), self.weight),
            ),
            6 => ([none; 3], scale(self.from_center, self.weight)),
            _ => ([none; 3], [none; 3]),
        };
        std::array::from_fn(|j| if j < 3 { rotation[j] } else { center[j - 3] })
    }
}

impl<N: Num> State<N> {
    /// Modes as they are to be, by membership.
    fn coarse_modes(&self, plan: &Plan) -> Vec<[N; 5]> {
        let mut out = vec![zero(); self.modes.len()];
        let lists = plan.cluster_lists();
        let free = |image: usize| (0..6).all(|k| self.unit(0, image)[k].value() != 0.0);
        for cluster in 0..plan.clusters {
            let members = &lists[plan.clusters + 2..][lists[1 + cluster] as usize..lists[2 + cluster] as usize];
            let origin = &self.views[members[0] as usize / MAX_MEMBERSHIPS];
            let weight = |m: usize| if free(m / MAX_MEMBERSHIPS) { self.modes[m].blended } else { N::of(0.0) };
            let arm = |m: usize| -> Vec3<N> {
                let view = &self.views[m / MAX_MEMBERSHIPS];
                let cells = std::array::from_fn(|k| self.cell * N::of((view.cell[k] - origin.cell[k]) as f32));
                add(cells, sub(view.center, origin.center))
            };
            let mut sum: [N; 4] = zero();
            for &m in members {
                let (w, a) = (weight(m as usize), arm(m as usize));
                sum = add(sum, [w * a[0], w * a[1], w * a[2], w]);
            }
            let center: Vec3<N> = if sum[3].value() > 0.0 { std::array::from_fn(|k| sum[k] / sum[3]) } else { zero() };
            let mut spread = N::of(0.0);
            for &m in members {
                let a = sub(arm(m as usize), center);
                spread += weight(m as usize) * dot(&a, &a);
            }
            let inverse_radius = match sum[3].value() > 0.0 && spread.value() / sum[3].value() > 1e-30 {
                true => N::of(1.0) / (spread / sum[3]).root(),
                false => N::of(1.0),
            };
            for &m in members {
                let a = scale(sub(arm(m as usize), center), inverse_radius);
                out[m as usize] = [a[0], a[1], a[2], inverse_radius, weight(m as usize)];
            }
        }
        out
    }

    /// Blocks before points are eliminated.
    fn coarse_base(&self, plan: &Plan, block_sums: &[f32]) -> Vec<[N; 64]> {
        let (side, width) = (self.sizes.side(), self.sizes.block_sums());
        let image_sum = |image: usize, k: usize| {
            self.segments_of(image).map(|s| N::of(block_sums[width * s + k])).fold(N::of(0.0), |a, b| a + b)
        };
        let of_image = |image: usize| &self.modes[image * MAX_MEMBERSHIPS..(image + 1) * MAX_MEMBERSHIPS];
        let triangle = |i: usize, j: usize| side * i - i * (i + 1) / 2 + j;
        let has = |camera: u32, k: usize| self.has_param(camera as usize, k);
        let block = |&(row, column): &(u32, u32)| -> [N; 64] {
            let mut sum: [N; 64] = zero();
            match (plan.camera_of_row(row as usize), plan.camera_of_row(column as usize)) {
                (None, other) => {
                    for image in 0..self.images {
                        let Some(a) = of_image(image).iter().find(|m| m.cluster == row) else { continue };
                        let b = of_image(image).iter().find(|m| m.cluster == column);
                        for k in 0..64 {
                            let x = a.pose(k / 8);
                            let more = match (other, b) {
                                (None, Some(b)) => self.pose_product(&|k| image_sum(image, k), &x, &b.pose(k % 8)),
                                (Some((camera, eighth)), _) if self.views[image].camera == camera as usize => {
                                    let j = 8 * eighth as usize + k % 8;
                                    if !has(camera, j) {
                                        continue;
                                    }
                                    (0..6)
                                        .map(|i| x[i] * image_sum(image, triangle(i, 6 + j)))
                                        .fold(N::of(0.0), |a, b| a + b)
                                }
                                _ => continue,
                            };
                            sum[k] += more;
                        }
                    }
                }
                (Some(a), Some(b)) if a.0 == b.0 => {
                    for k in 0..64 {
                        let (i, j) = (8 * a.1 as usize + k / 8, 8 * b.1 as usize + k % 8);
                        if !has(a.0, i) || !has(a.0, j) {
                            continue;
                        }
                        for &image in self.members(a.0 as usize) {
                            sum[k] += image_sum(image as usize, triangle(6 + i.min(j), 6 + i.max(j)));
                        }
                        if i == j {
                            let unit = self.images + a.0 as usize;
                            let (s, prior) = (self.unit(0, unit)[i], self.unit(8, unit)[i]);
                            let moves = s.value() != 0.0;
                            sum[k] = if moves { sum[k] + (self.lambda + prior) / (s * s) } else { N::of(0.0) };
                        }
                    }
                }
                _ => {}
            }
            sum
        };
        plan.blocks.iter().map(block).collect()
    }

    /// `Z A⁻¹ Zᵀ r` by units, in column scale.
    pub(super) fn coarse_correction(&self, r: &[[N; MAX_PARAMS]]) -> Vec<[N; MAX_PARAMS]> {
        let unscaled = |unit: usize| -> [N; MAX_PARAMS] {
            let s = self.unit(0, unit);
            s.map(|s| if s.value() != 0.0 { N::of(1.0) / s } else { N::of(0.0) })
        };
        let groups: Vec<usize> = (0..self.cameras).filter(|&c| self.exact[c]).map(|c| self.images + c).collect();
        let width = self.sizes.params;
        let dim = 8 * self.clusters + width * groups.len();
        let mut restricted = vec![N::of(0.0); dim];
        for (m, mode) in self.modes.iter().enumerate() {
            if mode.weight.value() != 0.0 {
                let image = m / MAX_MEMBERSHIPS;
                let (r, s) = (&r[image], unscaled(image));
                for k in 0..7 {
                    let terms = mode.pose(k);
                    let at = &mut restricted[8 * mode.cluster as usize + k];
                    *at = (0..6).fold(*at, |sum, j| sum + terms[j] * (r[j] * s[j]));
                }
            }
        }
        for (k, &unit) in groups.iter().enumerate() {
            let s = unscaled(unit);
            (0..width).for_each(|j| restricted[8 * self.clusters + width * k + j] = r[unit][j] * s[j]);
        }
        let y: Vec<N> = (0..dim).map(|i| dot(&self.coarse_inverse[i * dim..(i + 1) * dim], &restricted)).collect();
        let correction = |unit: usize| {
            let mut step: [N; MAX_PARAMS] = zero();
            if unit < self.images {
                for mode in &self.modes[unit * MAX_MEMBERSHIPS..(unit + 1) * MAX_MEMBERSHIPS] {
                    for k in (0..7).filter(|_| mode.weight.value() != 0.0) {
                        let terms = mode.pose(k);
                        let y = y[8 * mode.cluster as usize + k];
                        (0..6).for_each(|j| step[j] += terms[j] * y);
                    }
                }
            } else if let Some(k) = groups.iter().position(|&g| g == unit) {
                (0..width).for_each(|j| step[j] = y[8 * self.clusters + width * k + j]);
            }
            let s = unscaled(unit);
            std::array::from_fn(|j| step[j] * s[j])
        };
        (0..self.images + self.cameras).map(correction).collect()
    }

    fn pose_product(&self, sum: &dyn Fn(usize) -> N, x: &[N; 6], y: &[N; 6]) -> N {
        let mut total = N::of(0.0);
        let mut k = self.sizes.triangle() + self.sizes.side();
        for i in 0..6 {
            for j in i..6 {
                let entry = sum(k);
                total += if i == j {
                    (entry + self.lambda * entry) * x[i] * y[i]
                } else {
                    entry * (x[i] * y[j] + x[j] * y[i])
                };
                k += 1;
            }
        }
        total
    }

    /// 3 × 8 of each entry; points count from `first_point`.
    fn coarse_entry(&self, first_point: usize, entries: &[[u32; 8]]) -> Vec<[N; 24]> {
        let entry = |&[point, row, _, kind, _, _, camera, _]: &[u32; 8]| {
            let p = first_point + point as usize;
            let mut columns: [Vec3<N>; 8] = [zero(); 8];
            let (mut normal, mut arm): ([Vec3<N>; 3], Vec3<N>) = ([zero(); 3], zero());
            for o in self.tracks[p] as usize..self.tracks[p + 1] as usize {
                let (image, weights) = ((self.by_point[o].0 & !(OUT | HIDDEN)) as usize, self.by_point[o].1);
                if weights[0].value() == 0.0 || self.blocks[p][3][3].value() != 1.0 {
                    continue;
                }
                let row_of = || self.row(p, image, weights);
                if kind > 0 {
                    if self.views[image].camera == camera as usize {
                        let r = row_of();
                        for (k, column) in columns.iter_mut().enumerate() {
                            let k = 8 * (kind as usize - 1) + k;
                            let terms = add(scale(r.point[0], r.params[0][k]), scale(r.point[1], r.params[1][k]));
                            *column = add(*column, terms);
                        }
                    }
                    continue;
                }
                for mode in &self.modes[image * MAX_MEMBERSHIPS..(image + 1) * MAX_MEMBERSHIPS] {
                    if mode.cluster != row || mode.weight.value() == 0.0 {
                        continue;
                    }
                    let r = row_of();
                    let [x, y, z] = r.point;
                    let h: [Vec3<N>; 3] = std::array::from_fn(|c| {
                        scale(add(add(scale(x, x[c]), scale(y, y[c])), scale(z, z[c])), mode.weight)
                    });
                    normal = std::array::from_fn(|c| add(normal[c], h[c]));
                    columns[6] = sub(columns[6], std::array::from_fn(|c| dot(&h[c], &mode.from_center)));
                    arm = add(scale(r.ray, mode.inverse_radius), mode.from_center);
                }
            }
            if kind == 0 {
                for k in 0..3 {
                    let axis: Vec3<N> = std::array::from_fn(|j| N::of(if j == k { 1.0 } else { 0.0 }));
                    let turned = cross(axis, arm);
                    columns[k] = normal[k].map(|v| -v);
                    columns[3 + k] = std::array::from_fn(|c| -dot(&normal[c], &turned));
                }
            }
            let solved = columns.map(|c| solve_row(&self.blocks[p], c));
            std::array::from_fn(|k| solved[k % 8][k / 8])
        };
        entries.iter().map(entry).collect()
    }

    /// Partial sums of a piece by block of its segments' rows.
    fn coarse_pair(plan: &Plan, piece: &PieceWords, factors: &[[N; 24]]) -> Vec<[N; 64]> {
        let mut out = Vec::new();
        for (row, sorted) in piece.segments() {
            for &(_, column) in plan.blocks.iter().filter(|b| b.0 == row) {
                let mut sum: [N; 64] = zero();
                for &e in sorted {
                    let point = e as usize..piece.entries[e as usize][2] as usize;
                    let Some(f) = point.clone().find(|&f| piece.entries[f][1] == column) else { continue };
                    let (x, y) = (&factors[e as usize], &factors[f]);
                    let product = |k: usize| {
                        let column = |v: &[N; 24], k: usize| [v[k], v[8 + k], v[16 + k]];
                        dot(&column(x, k / 8), &column(y, k % 8))
                    };
                    sum = std::array::from_fn(|k| sum[k] + product(k));
                }
                out.push(sum);
            }
        }
        out
    }
}

/// Every kernel of the assembly, from the device's own state before it.
pub(super) fn check_coarse(bench: &Bench<'_>) {
    let system = &bench.system;
    let (plan, buffers) = (&system.layout.plan, &system.resident.buffers);
    if plan.clusters == 0 {
        return;
    }
    bench.run("coarse_modes");
    let (twin, exact) = bench.twins();
    let found: Vec<f32> = twin
        .modes
        .iter()
        .flat_map(|m| [m.from_center[0], m.from_center[1], m.from_center[2], m.inverse_radius, m.weight])
        .collect();
    compare("coarse_modes", &found, flat(&twin.coarse_modes(plan)), flat(&exact.coarse_modes(plan)));

    bench.run("coarse_base");
    let sums = bench.words(&buffers.block_sums, system.layout.sizes.block_sums() * system.layout.segments);
    let mut found = bench.words(&buffers.coarse.matrix, 64 * plan.blocks.len());
    // A column of a parameter that the model does not have is dropped later; the twin does not know it.
    let has = |row: u32, k: usize| {
        let camera = plan.camera_of_row(row as usize);
        camera.is_none_or(|(camera, eighth)| twin.has_param(camera as usize, 8 * eighth as usize + k))
    };
    for (block, &(row, column)) in found.chunks_exact_mut(64).zip(&plan.blocks) {
        (0..64).filter(|k| !has(row, k / 8) || !has(column, k % 8)).for_each(|k| block[k] = 0.0);
    }
    compare("coarse_base", &found, flat(&twin.coarse_base(plan, &sums)), flat(&exact.coarse_base(plan, &sums)));

    for piece in &plan.pieces {
        let chunk = &system.layout.chunks[piece.chunk];
        let mut words = PieceWords::new(plan, chunk, piece);
        let count = words.entries.len();
        words.pad(plan.limits.entries);
        buffers.coarse.upload(system.device(), &words);
        let before = bench.words(&buffers.coarse.matrix, 64 * plan.blocks.len());
        let mut encoder = system.device().encoder();
        system.resident.record_on_chunk(&mut encoder, piece.chunk, "coarse_entry").expect("fits");
        system.device().submit(encoder);
        let factors = bench.words(&buffers.coarse.factors, 24 * count);
        let entries = &words.entries[..count];
        let (t, e) = (twin.coarse_entry(chunk.first_point, entries), exact.coarse_entry(chunk.first_point, entries));
        let mut known = factors.clone();
        for (factor, entry) in known.chunks_exact_mut(24).zip(entries) {
            (0..24).filter(|k| !has(entry[1], k % 8)).for_each(|k| factor[k] = 0.0);
        }
        compare("coarse_entry", &known, flat(&t), flat(&e));

        bench.run("coarse_pair");
        let rows: Vec<[f32; 24]> = factors.chunks_exact(24).map(|row| std::array::from_fn(|k| row[k])).collect();
        let wide: Vec<_> = rows.iter().map(|row| row.map(Num::of)).collect();
        let (t, e) = (State::coarse_pair(plan, &words, &rows), State::coarse_pair(plan, &words, &wide));
        let partials = bench.words(&buffers.coarse.partials, 64 * t.len());
        compare("coarse_pair", &partials, flat(&t), flat(&e));

        bench.run("coarse_subtract");
        let after = bench.words(&buffers.coarse.matrix, 64 * plan.blocks.len());
        let mut wanted: Vec<f64> = before.iter().map(|&v| f64::from(v)).collect();
        let mut terms: Vec<f64> = wanted.iter().map(|v| v.abs()).collect();
        let mut partials = partials.chunks_exact(64);
        for (row, _) in words.segments() {
            for slot in (0..plan.blocks.len()).filter(|&s| plan.blocks[s].0 == row) {
                for (k, &value) in partials.next().expect("as many").iter().enumerate() {
                    wanted[64 * slot + k] -= f64::from(value);
                    terms[64 * slot + k] += f64::from(value).abs();
                }
            }
        }
        for (k, &found) in after.iter().enumerate() {
            assert!((f64::from(found) - wanted[k]).abs() <= 1e-6 * terms[k] + 1e-30, "{k}: {found} {}", wanted[k]);
        }
    }
}
