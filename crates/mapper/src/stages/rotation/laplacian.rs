//! The linear system of rotation averaging: one scalar graph Laplacian for all three components of the update.
//!
//! A robust step minimises `Σ w_ij ‖θ_j − θ_i − r_ij‖²`. With one weight an edge its normal matrix is `L ⊗ I₃`, so an
//! n × n system with three right-hand sides replaces a 3n × 3n one (`solver.md` §4). Vertex 0 is held at zero, which
//! fixes the gauge and makes the system of a connected graph positive definite.

use epipole_optimize::reduced::SparseFactor;
use glam::DVec3;

/// Added to the diagonal relative to its largest entry, as COLMAP's ridge of 1e-9: only there so that weights that
/// underflow next to large ones cannot make the factorisation fail.
const RELATIVE_RIDGE: f64 = 1e-12;

/// Above this (non-zeros of the factor)² / n, a stand-in for the factorisation's operations, conjugate gradients win:
/// `solver.md` §4 measured 1.8 s a factorisation against 0.1 s for a random graph of 5000 images.
const MAX_FACTOR_OPERATIONS: f64 = 2e10;

/// Relative residual at which conjugate gradients stop; the steps that use it stop at 1e-3 rad.
const PCG_TOLERANCE: f64 = 1e-8;

/// Iterations after which conjugate gradients give the best they have; bands of 5000 images need 400.
const PCG_MAX_ITERATIONS: usize = 2000;

/// The Laplacian of a connected graph, its structure analysed once and its weights given at every solve.
pub(super) struct Laplacian {
    ends: Vec<[usize; 2]>,
    num_vertices: usize,
    method: Method,
}

enum Method {
    Factor(Box<Factor>),
    ConjugateGradients,
}

/// Lower triangle of the Laplacian without vertex 0.
struct Factor {
    factor: SparseFactor,
    values: Vec<f64>,
    diagonal_slot: Vec<usize>,
    edge_slot: Vec<Option<usize>>,
}

impl Laplacian {
    /// Analyses the graph with the given edges, each between two different vertices below `num_vertices`.
    pub(super) fn new(num_vertices: usize, ends: &[[usize; 2]]) -> Result<Self, String> {
        let (factor, operations) = Factor::new(num_vertices, ends)?;
        let method = if operations < MAX_FACTOR_OPERATIONS {
            Method::Factor(Box::new(factor))
        } else {
            Method::ConjugateGradients
        };
        Ok(Self { ends: ends.to_vec(), num_vertices, method })
    }

    #[cfg(test)]
    fn iterative(num_vertices: usize, ends: &[[usize; 2]]) -> Self {
        Self { ends: ends.to_vec(), num_vertices, method: Method::ConjugateGradients }
    }

    /// Number of vertices, the fixed one included.
    pub(super) fn num_vertices(&self) -> usize {
        self.num_vertices
    }

    /// The minimiser of `Σ weight ‖θ_j − θ_i − residual‖²` over the edges (i, j), with θ_0 = 0.
    pub(super) fn solve(&mut self, weights: &[f64], residuals: &[DVec3]) -> Result<Vec<DVec3>, String> {
        let mut rhs = vec![DVec3::ZERO; self.num_vertices];
        for ((&[i, j], &w), &r) in self.ends.iter().zip(weights).zip(residuals) {
            rhs[i] -= w * r;
            rhs[j] += w * r;
        }
        let solution = match &mut self.method {
            Method::Factor(factor) => factor.solve(&self.ends, weights, &rhs)?,
            Method::ConjugateGradients => conjugate_gradients(&self.ends, weights, &rhs),
        };
        if solution.iter().all(|x| x.is_finite()) { Ok(solution) } else { Err("the update is not finite".into()) }
    }
}

impl Factor {
    fn new(num_vertices: usize, ends: &[[usize; 2]]) -> Result<(Self, f64), String> {
        let n = num_vertices.saturating_sub(1);
        let mut entries: Vec<(usize, usize)> = (0..n).map(|v| (v, v)).collect();
        let off_diagonal = |[i, j]: [usize; 2]| (i > 0 && j > 0).then(|| (i.min(j) - 1, i.max(j) - 1));
        entries.extend(ends.iter().filter_map(|&e| off_diagonal(e)));
        entries.sort_unstable();
        entries.dedup();
        let slot = |entry| entries.binary_search(&entry).ok();
        let diagonal_slot = (0..n).filter_map(|v| slot((v, v))).collect();
        let edge_slot = ends.iter().map(|&e| off_diagonal(e).and_then(slot)).collect();
        let mut column_start = vec![0; n + 1];
        for &(column, _) in &entries {
            column_start[column + 1] += 1;
        }
        for column in 0..n {
            column_start[column + 1] += column_start[column];
        }
        let rows = entries.iter().map(|&(_, row)| row).collect();
        let factor = SparseFactor::new(n, column_start, rows)
            .map_err(|e| format!("the Laplacian of {num_vertices} images could not be analysed: {e}"))?;
        let operations = factor.flops();
        Ok((Self { factor, values: vec![0.0; entries.len()], diagonal_slot, edge_slot }, operations))
    }

    fn solve(&mut self, ends: &[[usize; 2]], weights: &[f64], rhs: &[DVec3]) -> Result<Vec<DVec3>, String> {
        self.values.fill(0.0);
        for ((&[i, j], &w), slot) in ends.iter().zip(weights).zip(&self.edge_slot) {
            for vertex in [i, j] {
                if vertex > 0 {
                    self.values[self.diagonal_slot[vertex - 1]] += w;
                }
            }
            if let Some(slot) = *slot {
                self.values[slot] -= w;
            }
        }
        let largest = self.diagonal_slot.iter().map(|&s| self.values[s]).fold(0.0, f64::max);
        for &slot in &self.diagonal_slot {
            self.values[slot] += RELATIVE_RIDGE * largest;
        }
        let n = rhs.len() - 1;
        let mut x: Vec<f64> = (0..3).flat_map(|k| rhs[1..].iter().map(move |r| r[k])).collect();
        self.factor.solve(&self.values, &mut x).map_err(|e| format!("the Laplacian's system: {e}"))?;
        let mut solution = vec![DVec3::ZERO];
        solution.extend((0..n).map(|row| DVec3::new(x[row], x[n + row], x[2 * n + row])));
        Ok(solution)
    }
}

/// Three solves side by side with the diagonal as preconditioner; each component has its own step lengths.
fn conjugate_gradients(ends: &[[usize; 2]], weights: &[f64], rhs: &[DVec3]) -> Vec<DVec3> {
    let n = rhs.len();
    let mut inverse_diagonal = vec![0.0; n];
    for (&[i, j], &w) in ends.iter().zip(weights) {
        inverse_diagonal[i] += w;
        inverse_diagonal[j] += w;
    }
    let ridge = RELATIVE_RIDGE * inverse_diagonal.iter().copied().fold(0.0, f64::max);
    inverse_diagonal.iter_mut().for_each(|d| *d = 1.0 / (*d + ridge));
    inverse_diagonal[0] = 0.0;
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).fold(DVec3::ZERO, |sum, (&x, &y)| sum + x * y);
    let quotient =
        |a: DVec3, b: DVec3| DVec3::from_array(std::array::from_fn(|k| if b[k] > 0.0 { a[k] / b[k] } else { 0.0 }));

    let mut x = vec![DVec3::ZERO; n];
    let mut residual = rhs.to_vec();
    residual[0] = DVec3::ZERO;
    let precondition = |r: &[DVec3]| -> Vec<DVec3> { r.iter().zip(&inverse_diagonal).map(|(&r, &d)| r * d).collect() };
    let mut z = precondition(&residual);
    let mut direction = z.clone();
    let mut energy = dot(&residual, &z);
    let target = energy * (PCG_TOLERANCE * PCG_TOLERANCE);
    let mut product = vec![DVec3::ZERO; n];
    for _ in 0..PCG_MAX_ITERATIONS {
        if energy.cmple(target).all() {
            break;
        }
        product.iter_mut().zip(&direction).for_each(|(q, &p)| *q = ridge * p);
        for (&[i, j], &w) in ends.iter().zip(weights) {
            let flow = w * (direction[j] - direction[i]);
            product[j] += flow;
            product[i] -= flow;
        }
        product[0] = DVec3::ZERO;
        let alpha = quotient(energy, dot(&direction, &product));
        for v in 0..n {
            x[v] += alpha * direction[v];
            residual[v] -= alpha * product[v];
        }
        z = precondition(&residual);
        let next = dot(&residual, &z);
        let beta = quotient(next, energy);
        energy = next;
        for v in 0..n {
            direction[v] = z[v] + beta * direction[v];
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph() -> (usize, Vec<[usize; 2]>, Vec<f64>, Vec<DVec3>) {
        let n = 40;
        let mut ends: Vec<[usize; 2]> = (1..n).map(|v| [v - 1, v]).collect();
        ends.extend((0..n).flat_map(|v| [[v, (v * 7 + 3) % n], [(v * 5 + 11) % n, v]]).filter(|[i, j]| i != j));
        let weights = (0..ends.len()).map(|e| 0.01 + (e % 13) as f64).collect();
        let residuals = (0..ends.len()).map(|e| DVec3::new((e as f64).sin(), (e as f64 * 0.7).cos(), 0.1)).collect();
        (n, ends, weights, residuals)
    }

    #[test]
    fn agrees_with_the_coupled_dense_form() {
        let (n, ends, weights, residuals) = graph();
        let scalar = Laplacian::new(n, &ends).unwrap().solve(&weights, &residuals).unwrap();
        let mut normal = elimination::Dense::new(3 * n);
        for ((&[i, j], &w), &r) in ends.iter().zip(&weights).zip(&residuals) {
            for k in 0..3 {
                normal.add_row(&[(3 * i + k, -1.0), (3 * j + k, 1.0)], r[k], w);
            }
        }
        let coupled = normal.solve_with_fixed(3);
        for v in 0..n {
            for k in 0..3 {
                assert!((scalar[v][k] - coupled[3 * v + k]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn conjugate_gradients_agree_with_the_factorisation() {
        let (n, ends, weights, residuals) = graph();
        let direct = Laplacian::new(n, &ends).unwrap().solve(&weights, &residuals).unwrap();
        let iterative = Laplacian::iterative(n, &ends).solve(&weights, &residuals).unwrap();
        for (a, b) in direct.iter().zip(&iterative) {
            assert!((*a - *b).length() < 1e-6);
        }
    }

    #[test]
    fn two_vertices_are_enough() {
        let x = Laplacian::new(2, &[[1, 0]]).unwrap().solve(&[2.0], &[DVec3::X]).unwrap();
        assert!((x[1] + DVec3::X).length() < 1e-9 && x[0] == DVec3::ZERO);
    }

    /// The 3n × 3n normal equations by Gaussian elimination, as an independent check.
    mod elimination {
        pub(super) struct Dense {
            n: usize,
            a: Vec<f64>,
            b: Vec<f64>,
        }

        impl Dense {
            pub(super) fn new(n: usize) -> Self {
                Self { n, a: vec![0.0; n * n], b: vec![0.0; n] }
            }

            pub(super) fn add_row(&mut self, row: &[(usize, f64)], rhs: f64, weight: f64) {
                for &(i, x) in row {
                    self.b[i] += weight * x * rhs;
                    for &(j, y) in row {
                        self.a[i * self.n + j] += weight * x * y;
                    }
                }
            }

            pub(super) fn solve_with_fixed(mut self, fixed: usize) -> Vec<f64> {
                let n = self.n;
                for i in 0..fixed {
                    self.b[i] = 0.0;
                    for j in 0..n {
                        self.a[i * n + j] = if i == j { 1.0 } else { 0.0 };
                        self.a[j * n + i] = if i == j { 1.0 } else { 0.0 };
                    }
                }
                for p in 0..n {
                    for i in p + 1..n {
                        let f = self.a[i * n + p] / self.a[p * n + p];
                        for j in p..n {
                            self.a[i * n + j] -= f * self.a[p * n + j];
                        }
                        self.b[i] -= f * self.b[p];
                    }
                }
                for p in (0..n).rev() {
                    for j in p + 1..n {
                        self.b[p] -= self.a[p * n + j] * self.b[j];
                    }
                    self.b[p] /= self.a[p * n + p];
                }
                self.b
            }
        }
    }
}
