//! A point from views of which some are wrong: LO-RANSAC on pairs of views.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::multi_view::triangulate_selected;
use super::{View, has_triangulation_angle, triangulate_midpoint};

/// Settings of [`estimate_triangulation`]; the defaults are COLMAP's (source: `algorithms.md` §2.10).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobustOptions {
    /// Some pair of views must see the point under at least this angle, rad.
    pub min_angle_rad: f64,
    /// A view agrees if its bearing is at most this far from the direction to the point, rad; below 90°.
    pub max_angular_error_rad: f64,
    /// Probability that a sample without outliers was among the trials.
    pub confidence: f64,
    /// Fraction of views that are assumed to be right at least.
    pub min_inlier_ratio: f64,
    /// Trials at most.
    pub max_trials: usize,
    /// Up to this number of views every pair is tried.
    pub exhaustive_up_to: usize,
}

impl Default for RobustOptions {
    fn default() -> Self {
        Self {
            min_angle_rad: 1f64.to_radians(),
            max_angular_error_rad: 2f64.to_radians(),
            confidence: 0.9999,
            min_inlier_ratio: 0.02,
            max_trials: 10_000,
            exhaustive_up_to: 15,
        }
    }
}

/// A point and the views that agree with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Triangulation {
    /// Position in the world.
    pub position: DVec3,
    /// For each view whether it agrees.
    pub inlier_mask: Vec<bool>,
}

/// Rounds of estimating from the inliers and counting them again, at most, after a sample is the best so far.
const MAX_LOCAL_ROUNDS: usize = 5;

/// RANSAC draws this many times as many samples as the theory asks for, because noise spoils good samples too
/// (COLMAP's `dyn_num_trials_multiplier`).
const TRIALS_MULTIPLIER: f64 = 3.0;

/// How well a point explains the views: more of them first, then a smaller sum of squared sines.
#[derive(Clone, Copy, PartialEq)]
struct Support {
    inliers: usize,
    residual: f64,
}

impl Support {
    fn better_than(&self, other: &Self) -> bool {
        self.inliers > other.inliers || (self.inliers == other.inliers && self.residual < other.residual)
    }
}

/// The point that most views agree with.
///
/// A sample is two views that see their midpoint in front of them and under at least `min_angle_rad`; the best sample is
/// re-estimated from its inliers by [`super::triangulate_multi_view`]. All pairs are tried up to `exhaustive_up_to`
/// views, otherwise random ones from `seed`. The search ends as soon as all views agree: no other sample can
/// be better than the estimate from all of them. `None` if no pair qualifies or fewer than two views agree.
pub fn estimate_triangulation(views: &[View], options: &RobustOptions, seed: u64) -> Option<Triangulation> {
    let n = views.len();
    if n < 2 {
        return None;
    }
    let mut search = Search::new(views, options);
    if n <= options.exhaustive_up_to {
        'pairs: for i in 0..n - 1 {
            for j in i + 1..n {
                search.try_pair(i, j);
                if search.best.inliers == n {
                    break 'pairs;
                }
            }
        }
    } else {
        let mut rng = Pcg32::seed_from_u64(seed);
        let mut trial = 0;
        while trial < search.trials_needed() {
            let i = rng.random_range(0..n);
            let j = (i + rng.random_range(1..n)) % n;
            search.try_pair(i, j);
            if search.best.inliers == n {
                break;
            }
            trial += 1;
        }
    }
    let position = search.position.filter(|_| search.best.inliers >= 2)?;
    let inlier_mask = views.iter().map(|v| v.sine_squared(position) <= search.max_sine2).collect();
    Some(Triangulation { position, inlier_mask })
}

struct Search<'a> {
    views: &'a [View],
    options: &'a RobustOptions,
    max_sine2: f64,
    best: Support,
    position: Option<DVec3>,
}

impl<'a> Search<'a> {
    fn new(views: &'a [View], options: &'a RobustOptions) -> Self {
        let sine = options.max_angular_error_rad.clamp(0.0, std::f64::consts::FRAC_PI_2).sin();
        // Below 1, which stands for "behind", even for a limit of 90°.
        let max_sine2 = (sine * sine).min(1.0 - f64::EPSILON);
        let best = Support { inliers: 0, residual: f64::INFINITY };
        Self { views, options, max_sine2, best, position: None }
    }

    fn support(&self, position: DVec3) -> Support {
        let mut support = Support { inliers: 0, residual: 0.0 };
        for view in self.views {
            let sine2 = view.sine_squared(position);
            if sine2 <= self.max_sine2 {
                support.inliers += 1;
                support.residual += sine2;
            }
        }
        support
    }

    fn in_front(&self, i: usize, position: DVec3) -> bool {
        (position - self.views[i].center).dot(self.views[i].ray_in_world) > 0.0
    }

    fn try_pair(&mut self, i: usize, j: usize) {
        let Some(position) = triangulate_midpoint(&self.views[i], &self.views[j]) else { return };
        let centers = [self.views[i].center, self.views[j].center];
        if !self.in_front(i, position)
            || !self.in_front(j, position)
            || !has_triangulation_angle(centers.into_iter(), position, self.options.min_angle_rad)
        {
            return;
        }
        let support = self.support(position);
        if !support.better_than(&self.best) {
            return;
        }
        (self.best, self.position) = (support, Some(position));
        self.improve_locally();
    }

    /// Re-estimates from the inliers as long as that helps.
    fn improve_locally(&mut self) {
        for _ in 0..MAX_LOCAL_ROUNDS {
            let Some(from) = self.position else { return };
            let is_inlier = |i: usize| self.views[i].sine_squared(from) <= self.max_sine2;
            let Some(position) = triangulate_selected(self.views, is_inlier) else { return };
            let centers = self.views.iter().enumerate().filter(|(i, _)| is_inlier(*i)).map(|(_, v)| v.center);
            let support = self.support(position);
            if !support.better_than(&self.best)
                || (0..self.views.len()).any(|i| is_inlier(i) && !self.in_front(i, position))
                || !has_triangulation_angle(centers, position, self.options.min_angle_rad)
            {
                return;
            }
            let same_inliers = support.inliers == self.best.inliers;
            (self.best, self.position) = (support, Some(position));
            if same_inliers {
                return;
            }
        }
    }

    /// Number of trials after which, by the best support so far, a clean pair has been drawn with the confidence asked.
    fn trials_needed(&self) -> usize {
        let n = self.views.len() as f64;
        let ratio = (self.best.inliers as f64 / n).max(self.options.min_inlier_ratio);
        let miss = (1.0 - ratio * ratio).ln();
        if miss >= 0.0 {
            return self.options.max_trials;
        }
        let trials = TRIALS_MULTIPLIER * (1.0 - self.options.confidence).ln() / miss;
        // A cast of infinity saturates.
        (trials.ceil() as usize).clamp(1, self.options.max_trials.max(1))
    }
}
