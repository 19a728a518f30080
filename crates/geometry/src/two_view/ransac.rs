//! Deterministic LO-RANSAC, written once for every model.
//!
//! Models are ranked by the truncated sum of squared errors (MSAC), each new best one is fitted again to its inliers
//! (O. Chum, J. Matas and J. Kittler, "Locally optimized RANSAC", DAGM 2003), and hopeless ones are dropped early. The
//! same seed and data give the same result on any machine with the same arithmetic: nothing depends on time or threads.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::correspondence::LANES;

/// What RANSAC needs to know of a model. Data are held by the estimator, in random order (see [`shuffled`]).
pub trait Estimator {
    /// The model.
    type Model: Clone;
    /// Number of data that fix it.
    const MIN_SAMPLE: usize;

    /// Number of data.
    fn len(&self) -> usize;

    /// Whether there are no data.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends the models that pass through the sample of [`Self::MIN_SAMPLE`] distinct data.
    fn estimate(&self, sample: &[usize], models: &mut Vec<Self::Model>);

    /// A model that fits all `inliers` (ascending) better than `start`, or `None` where they do not fix one.
    fn refine(&self, start: &Self::Model, inliers: &[usize]) -> Option<Self::Model>;

    /// Squared errors of the data `block · LANES ..`, px²; NaN counts as infinite, entries past the end are ignored.
    fn residuals_squared(&self, model: &Self::Model, block: usize, out: &mut [f64; LANES]);
}

/// When an observation is an inlier and when to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RansacOptions {
    /// Largest error of an inlier, px.
    pub max_error_px: f64,
    /// Wanted probability that a sample without outliers was drawn.
    pub confidence: f64,
    /// Fewest trials.
    pub min_trials: usize,
    /// Most trials.
    pub max_trials: usize,
    /// Trials are at most those that `confidence` needs at this ratio of inliers.
    pub min_inlier_ratio: f64,
}

impl Default for RansacOptions {
    /// COLMAP's values (`algorithms.md` §2.2).
    fn default() -> Self {
        Self { max_error_px: 4.0, confidence: 0.999, min_trials: 100, max_trials: 10_000, min_inlier_ratio: 0.25 }
    }
}

/// The best model.
#[derive(Clone, Debug)]
pub struct RansacReport<M> {
    /// The model.
    pub model: M,
    /// Its inliers, ascending.
    pub inliers: Vec<usize>,
    /// Σ min(error², max_error²) over all data, px².
    pub cost: f64,
    /// Number of samples drawn.
    pub trials: usize,
}

/// A fixed permutation of `0..len`. Estimators store their data in such an order, so that the first blocks are a fair
/// sample of all.
pub fn shuffled(len: usize, seed: u64) -> Vec<usize> {
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut order: Vec<usize> = (0..len).collect();
    for i in (1..len).rev() {
        order.swap(i, below(&mut rng, i + 1));
    }
    order
}

/// A number below `bound`, drawn as 32 bits so that wasm32 draws the same.
fn below(rng: &mut Pcg32, bound: usize) -> usize {
    rng.random_range(0..u32::try_from(bound).unwrap_or(u32::MAX)) as usize
}

/// Refits per new best model: the second pass profits from the inliers of the first, later ones hardly ever.
const MAX_LOCAL_FITS: usize = 3;

/// Blocks after which a model with far fewer inliers than the best one is dropped (64 data).
const PREVIEW_BLOCKS: usize = 8;

/// How many standard deviations below the best model's ratio count as hopeless (one good model in 3000 is lost).
const PREVIEW_SIGMA: f64 = 3.5;

/// The best model by LO-RANSAC, or `None` where no sample gave a model or the data are fewer than a sample.
///
/// `start`, if given, competes as if a sample had produced it.
pub fn ransac<E: Estimator>(
    estimator: &E,
    options: &RansacOptions,
    start: Option<&E::Model>,
    seed: u64,
) -> Option<RansacReport<E::Model>> {
    let len = estimator.len();
    let max_squared = options.max_error_px * options.max_error_px;
    if len < E::MIN_SAMPLE || max_squared.is_nan() || max_squared <= 0.0 {
        return None;
    }
    let mut rng = Pcg32::seed_from_u64(seed);
    let mut search = Search { estimator, max_squared, best: None, inliers: Vec::with_capacity(len) };
    let trials_for = |ratio: f64| trials_needed::<E>(ratio, options);
    let cap = options.max_trials.min(trials_for(options.min_inlier_ratio)).max(options.min_trials);
    let mut needed = cap;
    if let Some(model) = start {
        search.offer(model);
        needed = search.trials_wanted(cap, trials_for);
    }
    let mut models = Vec::with_capacity(10);
    let mut sample = vec![0; E::MIN_SAMPLE];
    let mut trials = 0;
    while trials < needed.max(options.min_trials) && trials < cap {
        trials += 1;
        draw(&mut rng, len, &mut sample);
        models.clear();
        estimator.estimate(&sample, &mut models);
        for model in &models {
            if search.offer(model) {
                needed = search.trials_wanted(cap, trials_for);
            }
        }
    }
    let best = search.best?;
    let inliers = collect_inliers(estimator, &best.model, max_squared);
    Some(RansacReport { model: best.model, inliers, cost: best.cost, trials })
}

struct Scored<M> {
    model: M,
    cost: f64,
    count: usize,
}

struct Search<'a, E: Estimator> {
    estimator: &'a E,
    max_squared: f64,
    best: Option<Scored<E::Model>>,
    inliers: Vec<usize>,
}

impl<E: Estimator> Search<'_, E> {
    /// Keeps the model, after local optimisation, where it beats the best one.
    fn offer(&mut self, model: &E::Model) -> bool {
        let Some((mut cost, count)) = self.score(model) else { return false };
        self.best = Some(Scored { model: model.clone(), cost, count });
        let mut current = model.clone();
        for _ in 0..MAX_LOCAL_FITS {
            self.gather_inliers(&current);
            if self.inliers.len() <= E::MIN_SAMPLE {
                break;
            }
            let Some(refined) = self.estimator.refine(&current, &self.inliers) else { break };
            let Some((better, count)) = self.score(&refined) else { break };
            self.best = Some(Scored { model: refined.clone(), cost: better, count });
            current = refined;
            // A fit that gains less than 1 % has settled.
            let settled = better > 0.99 * cost;
            cost = better;
            if settled {
                break;
            }
        }
        true
    }

    /// Cost and number of inliers where the model beats the best one.
    fn score(&self, model: &E::Model) -> Option<(f64, usize)> {
        let len = self.estimator.len();
        let limit = self.best.as_ref().map_or(f64::INFINITY, |b| b.cost);
        let hopeless = self.best.as_ref().map_or(0.0, |b| {
            let ratio = b.count as f64 / len as f64;
            let n = (PREVIEW_BLOCKS * LANES) as f64;
            n * ratio - PREVIEW_SIGMA * (n * ratio * (1.0 - ratio)).sqrt()
        });
        let (mut cost, mut count) = (0.0, 0);
        let mut errors = [0.0; LANES];
        for block in 0..len.div_ceil(LANES) {
            self.estimator.residuals_squared(model, block, &mut errors);
            for &e in &errors[..LANES.min(len - block * LANES)] {
                let inlier = e <= self.max_squared;
                count += usize::from(inlier);
                cost += if inlier { e } else { self.max_squared };
            }
            if cost >= limit || (block + 1 == PREVIEW_BLOCKS && (count as f64) < hopeless) {
                return None;
            }
        }
        Some((cost, count))
    }

    fn gather_inliers(&mut self, model: &E::Model) {
        let mut inliers = std::mem::take(&mut self.inliers);
        inliers.clear();
        append_inliers(self.estimator, model, self.max_squared, &mut inliers);
        self.inliers = inliers;
    }

    fn trials_wanted(&self, cap: usize, trials_for: impl Fn(f64) -> usize) -> usize {
        let ratio = self.best.as_ref().map_or(0.0, |b| b.count as f64 / self.estimator.len() as f64);
        trials_for(ratio).min(cap)
    }
}

fn collect_inliers<E: Estimator>(estimator: &E, model: &E::Model, max_squared: f64) -> Vec<usize> {
    let mut inliers = Vec::new();
    append_inliers(estimator, model, max_squared, &mut inliers);
    inliers
}

fn append_inliers<E: Estimator>(estimator: &E, model: &E::Model, max_squared: f64, inliers: &mut Vec<usize>) {
    let mut errors = [0.0; LANES];
    for block in 0..estimator.len().div_ceil(LANES) {
        estimator.residuals_squared(model, block, &mut errors);
        let first = block * LANES;
        let here = errors[..LANES.min(estimator.len() - first)].iter().enumerate();
        inliers.extend(here.filter(|&(_, &e)| e <= max_squared).map(|(l, _)| first + l));
    }
}

/// Samples after which one without outliers was drawn with the wanted confidence.
fn trials_needed<E: Estimator>(inlier_ratio: f64, options: &RansacOptions) -> usize {
    let all_inliers = inlier_ratio.clamp(0.0, 1.0).powi(E::MIN_SAMPLE as i32);
    let trials = (1.0 - options.confidence).ln() / (1.0 - all_inliers).ln();
    // ln(1 − w) is −∞ or 0 at the ends; the cast saturates.
    if all_inliers <= 0.0 { options.max_trials } else { trials.ceil() as usize }
}

fn draw(rng: &mut Pcg32, len: usize, sample: &mut [usize]) {
    for i in 0..sample.len() {
        loop {
            let candidate = below(rng, len);
            if !sample[..i].contains(&candidate) {
                sample[i] = candidate;
                break;
            }
        }
    }
}
