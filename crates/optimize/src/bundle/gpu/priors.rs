//! Priors on camera parameters as the kernels' records.

use epipole_geometry::camera::MAX_PARAMS;

use super::records::param_slot;
use crate::bundle::problem::{ParamPrior, Problem};

/// Priors on the parameters that may move, all of one parameter taken together.
#[derive(Debug)]
pub(super) struct Priors {
    /// `Prior` in `types.wgsl`: means of a camera's parameters, then their inverse variances.
    pub(super) rows: Vec<[[f32; MAX_PARAMS]; 2]>,
    /// Whether there is any.
    pub(super) any: bool,
    /// What several priors on one parameter cost by disagreeing, whatever its value.
    pub(super) constant: f64,
}

impl Priors {
    pub(super) fn new(problem: &Problem) -> Self {
        let of_camera = of_cameras(problem);
        let mut priors = Self { rows: Vec::with_capacity(problem.cameras.len()), any: false, constant: 0.0 };
        for (c, camera) in problem.cameras.iter().enumerate() {
            let mut row = [[0.0; MAX_PARAMS]; 2];
            for index in 0..camera.model.num_params() {
                let of_param = || of_camera[c].iter().filter(|p| p.index == index);
                let information: f64 = of_param().map(|p| p.sigma.powi(-2)).sum();
                if information > 0.0 {
                    let mean = of_param().map(|p| p.mean * p.sigma.powi(-2)).sum::<f64>() / information;
                    priors.constant += of_param().map(|p| 0.5 * ((p.mean - mean) / p.sigma).powi(2)).sum::<f64>();
                    priors.any = true;
                    let slot = param_slot(camera.model, index);
                    row[0][slot] = mean as f32;
                    row[1][slot] = information as f32;
                }
            }
            priors.rows.push(row);
        }
        priors
    }
}

/// By camera: the priors on parameters that may move; none where no image uses it.
fn of_cameras(problem: &Problem) -> Vec<Vec<ParamPrior>> {
    let mut used = vec![false; problem.cameras.len()];
    problem.image_camera.iter().for_each(|&c| used[c as usize] = true);
    let moves = |c: usize, p: &ParamPrior| used[c] && problem.refine_params[c][p.index];
    let priors = problem.param_priors.iter().enumerate();
    priors.map(|(c, priors)| priors.iter().filter(|p| moves(c, p)).copied().collect()).collect()
}

/// `½ Σ ((p − mean)/σ)²` at a problem's parameters, in `f64`.
pub(super) fn prior_cost(problem: &Problem) -> f64 {
    let cameras = problem.cameras.iter().zip(of_cameras(problem));
    let cost = |p: &ParamPrior, params: &[f64]| 0.5 * ((params[p.index] - p.mean) / p.sigma).powi(2);
    cameras.map(|(camera, priors)| priors.iter().map(|p| cost(p, &camera.params)).sum::<f64>()).sum()
}
