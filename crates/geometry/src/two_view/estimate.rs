//! The geometry of two views from their matches: which model holds, its inliers and the relative pose.
//!
//! COLMAP's decision (`algorithms.md` §2.2) with two of its weaknesses mended: the pose is refined in pixels and its
//! inliers are those of the refined pose, and a pair counts as a pure rotation where a rotation explains it as well as
//! the homography does, rather than where noise happens to leave less than a fixed tolerance.

use glam::{DMat3, DVec2, DVec3};

use super::config::TwoViewConfig;
use super::correspondence::{Bearing, BearingPair};
use super::estimators::{EssentialEstimator, FundamentalEstimator, HomographyEstimator};
use super::ransac::{RansacReport, ransac};
use super::relative_pose::{CalibratedPair, RelativePoseOptions, calibration_matrix};
use super::watermark::{WatermarkOptions, is_watermark};
use crate::Rigid3;
use crate::camera::{Camera, CameraFamily};

/// How to verify a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoViewOptions {
    /// Sampling and refinement.
    pub relative_pose: RelativePoseOptions,
    /// Fewest inliers of a pair that is not degenerate.
    pub min_num_inliers: usize,
    /// An essential matrix holds where it has more than this share of the fundamental matrix's inliers.
    pub min_e_f_inlier_ratio: f64,
    /// A homography explains the pair where it has more than this share of the epipolar inliers.
    pub max_h_inlier_ratio: f64,
    /// How watermarks are recognised; `None` for not at all.
    pub watermark: Option<WatermarkOptions>,
    /// Take the focal lengths as known even where the cameras do not say so (after a calibration stage).
    pub assume_calibrated: bool,
}

impl Default for TwoViewOptions {
    /// COLMAP's values (`algorithms.md` §2.2).
    fn default() -> Self {
        Self {
            relative_pose: RelativePoseOptions::default(),
            min_num_inliers: 15,
            min_e_f_inlier_ratio: 0.95,
            max_h_inlier_ratio: 0.8,
            watermark: Some(WatermarkOptions::default()),
            assume_calibrated: false,
        }
    }
}

/// The geometry of a pair.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoViewGeometry {
    /// What the pair is.
    pub config: TwoViewConfig,
    /// Essential matrix, `ray2ᵀ E ray1 = 0`, of Frobenius norm √2.
    pub essential: Option<DMat3>,
    /// Fundamental matrix, `x2ᵀ F x1 = 0` in pixels as observed, of unit Frobenius norm.
    pub fundamental: Option<DMat3>,
    /// Homography, `x2 ∝ H x1` in pixels of the cameras without distortion, of unit Frobenius norm.
    pub homography: Option<DMat3>,
    /// The motion where one is known; its baseline is 1, or 0 for a pure rotation.
    pub cam2_from_cam1: Option<Rigid3>,
    /// Indices into the list of matches, ascending.
    pub inliers: Vec<u32>,
    /// Median angle under which the inliers are seen, min(θ, π − θ), rad; 0 without a pose.
    pub tri_angle_rad: f64,
}

impl TwoViewGeometry {
    fn degenerate() -> Self {
        Self {
            config: TwoViewConfig::Degenerate,
            essential: None,
            fundamental: None,
            homography: None,
            cam2_from_cam1: None,
            inliers: Vec::new(),
            tri_angle_rad: 0.0,
        }
    }
}

/// Verifies a pair: `matches[i] = [index into points1, index into points2]`, points in pixels as observed.
///
/// Calibrated (essential matrix against fundamental matrix and homography) where both cameras have a prior focal
/// length, else uncalibrated (fundamental matrix against homography). Matches that point outside the lists or to
/// pixels without a ray are never inliers. The same inputs and seed give the same result. Pairs with too few inliers,
/// invalid cameras, or cameras that are neither perspective nor calibrated are DEGENERATE.
pub fn estimate_two_view(
    camera1: &Camera,
    points1: &[DVec2],
    camera2: &Camera,
    points2: &[DVec2],
    matches: &[[u32; 2]],
    options: &TwoViewOptions,
    seed: u64,
) -> TwoViewGeometry {
    let mut of_match = Vec::with_capacity(matches.len());
    let (mut matched1, mut matched2) = (Vec::with_capacity(matches.len()), Vec::with_capacity(matches.len()));
    for (i, &[a, b]) in matches.iter().enumerate() {
        if let (Some(&p), Some(&q)) = (points1.get(a as usize), points2.get(b as usize)) {
            of_match.push(i as u32);
            matched1.push(p);
            matched2.push(q);
        }
    }
    let geometry = Matched { camera1, points1: &matched1, camera2, points2: &matched2, options, seed }.estimate();
    let Some(mut geometry) = geometry.filter(|g| g.inliers.len() >= options.min_num_inliers) else {
        return TwoViewGeometry::degenerate();
    };
    let pick = |points: &[DVec2]| -> Vec<DVec2> { geometry.inliers.iter().map(|&i| points[i as usize]).collect() };
    if options.watermark.is_some_and(|w| is_watermark(camera1, &pick(&matched1), camera2, &pick(&matched2), &w)) {
        geometry.config = TwoViewConfig::Watermark;
    }
    for i in &mut geometry.inliers {
        *i = of_match[*i as usize];
    }
    geometry
}

struct Matched<'a> {
    camera1: &'a Camera,
    points1: &'a [DVec2],
    camera2: &'a Camera,
    points2: &'a [DVec2],
    options: &'a TwoViewOptions,
    seed: u64,
}

/// Points centred and scaled alike in both images.
struct Scaled {
    to_unit1: DMat3,
    to_unit2: DMat3,
    points1: Vec<DVec2>,
    points2: Vec<DVec2>,
    unit_px: f64,
}

type Report = Option<RansacReport<DMat3>>;

fn count(report: &Report) -> usize {
    report.as_ref().map_or(0, |r| r.inliers.len())
}

fn unit_norm(m: DMat3) -> DMat3 {
    let norm = m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
    m * (1.0 / norm)
}

impl Matched<'_> {
    fn estimate(&self) -> Option<TwoViewGeometry> {
        let view = CalibratedPair::new(self.camera1, self.points1, self.camera2, self.points2, self.seed)?;
        if view.pairs.len() < self.options.min_num_inliers {
            return None;
        }
        let known = self.camera1.has_prior_focal && self.camera2.has_prior_focal;
        if known || self.options.assume_calibrated || self.is_spherical() {
            return self.calibrated(&view);
        }
        if self.is_perspective() { self.uncalibrated(&view) } else { None }
    }

    fn is_perspective(&self) -> bool {
        [self.camera1, self.camera2].iter().all(|c| c.model.family() == CameraFamily::Perspective)
    }

    /// Equirectangular images have no focal length to be unsure of.
    fn is_spherical(&self) -> bool {
        [self.camera1, self.camera2].iter().all(|c| c.model.family() == CameraFamily::Spherical)
    }

    /// The pixels of the pairs of `view`, in its order.
    fn scaled(&self, view: &CalibratedPair) -> Scaled {
        let pick = |points: &[DVec2]| -> Vec<DVec2> { view.matches.iter().map(|&i| points[i]).collect() };
        let (points1, points2) = (pick(self.points1), pick(self.points2));
        let n = points1.len() as f64;
        let (center1, center2) = (points1.iter().sum::<DVec2>() / n, points2.iter().sum::<DVec2>() / n);
        let spread = |points: &[DVec2], c: DVec2| points.iter().map(|p| p.distance(c)).sum::<f64>() / n;
        let unit_px = spread(&points1, center1).max(spread(&points2, center2)).max(1.0);
        let to_unit = |c: DVec2| {
            let shift = -c / unit_px;
            DMat3::from_cols(DVec3::X / unit_px, DVec3::Y / unit_px, shift.extend(1.0))
        };
        Scaled {
            to_unit1: to_unit(center1),
            to_unit2: to_unit(center2),
            points1: points1.iter().map(|p| (*p - center1) / unit_px).collect(),
            points2: points2.iter().map(|p| (*p - center2) / unit_px).collect(),
            unit_px,
        }
    }

    /// RANSAC options for a model that matters only if it reaches a share of `inliers`: fewer trials settle that.
    fn trials_to_reach(&self, share: f64, inliers: usize, total: usize) -> super::ransac::RansacOptions {
        let mut ransac = self.options.relative_pose.ransac;
        ransac.min_inlier_ratio = ransac.min_inlier_ratio.max((share * inliers as f64 / total as f64).min(1.0));
        ransac
    }

    fn calibrated(&self, view: &CalibratedPair) -> Option<TwoViewGeometry> {
        let options = self.options;
        let ransac_options = &options.relative_pose.ransac;
        let total = view.pairs.len();
        let estimator = EssentialEstimator::new(&view.pairs, ransac_options.max_error_px);
        let e = ransac(&estimator, ransac_options, None, self.seed.wrapping_add(1));
        let n_e = count(&e);

        let (k1, k2) = (calibration_matrix(self.camera1), calibration_matrix(self.camera2));
        let mut f_px = None;
        let mut f: Report = None;
        if self.is_perspective() {
            let s = self.scaled(view);
            let (from_unit1, from_unit2) = (s.to_unit1.inverse(), s.to_unit2.inverse());
            let start = e.as_ref().map(|e| {
                let in_px = k2.inverse().transpose() * e.model * k1.inverse();
                unit_norm(from_unit2.transpose() * in_px * from_unit1)
            });
            let wanted = self.trials_to_reach(1.0 / options.min_e_f_inlier_ratio, n_e, total);
            let fundamental = FundamentalEstimator::new(s.points1, s.points2, s.unit_px);
            f = ransac(&fundamental, &wanted, start.as_ref(), self.seed.wrapping_add(2));
            f_px = f.as_ref().map(|f| unit_norm(s.to_unit2.transpose() * f.model * s.to_unit1));
        }
        let n_f = count(&f);
        let essential_holds = n_e >= options.min_num_inliers && n_e as f64 > options.min_e_f_inlier_ratio * n_f as f64;
        let epipolar = if essential_holds { n_e } else { n_f };
        let wanted = self.trials_to_reach(options.max_h_inlier_ratio, epipolar, total);
        let h = ransac(&HomographyEstimator::new(&view.pairs), &wanted, None, self.seed.wrapping_add(3));
        let n_h = count(&h);

        let planar = n_h >= options.min_num_inliers && n_h as f64 > options.max_h_inlier_ratio * epipolar as f64;
        let config = if planar {
            TwoViewConfig::PlanarOrPanoramic
        } else if essential_holds {
            TwoViewConfig::Calibrated
        } else if n_f >= options.min_num_inliers {
            TwoViewConfig::Uncalibrated
        } else {
            return None;
        };
        let rays_to_px = |h: DMat3| unit_norm(k2 * h * k1.inverse());
        let mut geometry = TwoViewGeometry {
            config,
            essential: e.as_ref().map(|e| e.model),
            fundamental: f_px,
            homography: h.as_ref().map(|h| rays_to_px(h.model)),
            ..TwoViewGeometry::degenerate()
        };
        let pose = match config {
            TwoViewConfig::Calibrated => {
                let e = e?;
                view.pose_from_essential(&e.model, &e.inliers, &options.relative_pose)
            }
            TwoViewConfig::Uncalibrated => {
                let f = f?;
                let pose = view.pose_from_essential(&(k2.transpose() * f_px? * k1), &f.inliers, &options.relative_pose);
                self.set_matrix_inliers(&mut geometry, view, &f.inliers, pose);
                return Some(geometry);
            }
            _ => {
                let h = h?;
                let e = e.filter(|_| essential_holds);
                let chosen =
                    e.as_ref().map_or(&h.inliers, |e| if e.inliers.len() >= n_h { &e.inliers } else { &h.inliers });
                view.pose_from_homography(&h.model, e.as_ref().map(|e| &e.model), chosen, &options.relative_pose)
            }
        };
        self.set_pose(&mut geometry, view, pose?);
        Some(geometry)
    }

    /// Pose, inliers of the pose, angle, and which of planar and panoramic it is.
    fn set_pose(&self, geometry: &mut TwoViewGeometry, view: &CalibratedPair, pose: Rigid3) {
        let source = super::relative_pose::PoseSource::Estimated;
        let result = view.finish(pose, source, &self.options.relative_pose);
        geometry.inliers = result.inliers;
        self.set_motion(geometry, pose);
        geometry.tri_angle_rad = result.tri_angle_rad;
    }

    fn set_motion(&self, geometry: &mut TwoViewGeometry, pose: Rigid3) {
        let turned_only = pose.translation.length_squared() < 1e-12;
        if geometry.config == TwoViewConfig::PlanarOrPanoramic {
            geometry.config = if turned_only { TwoViewConfig::Panoramic } else { TwoViewConfig::Planar };
        }
        if !turned_only {
            geometry.essential = Some(super::decompose::essential_from_pose(&pose));
        }
        geometry.cam2_from_cam1 = Some(pose);
    }

    fn uncalibrated(&self, view: &CalibratedPair) -> Option<TwoViewGeometry> {
        let options = self.options;
        let total = view.pairs.len();
        let s = self.scaled(view);
        let on_plane = s.points1.iter().zip(&s.points2).map(|(&p, &q)| {
            let (first, second) = (Bearing::from_plane(p, s.unit_px)?, Bearing::from_plane(q, s.unit_px)?);
            Some(BearingPair { first, second })
        });
        let on_plane: Vec<BearingPair> = on_plane.collect::<Option<_>>()?;
        let fundamental = FundamentalEstimator::new(s.points1, s.points2, s.unit_px);
        let f = ransac(&fundamental, &options.relative_pose.ransac, None, self.seed.wrapping_add(2));
        let n_f = count(&f);
        let wanted = self.trials_to_reach(options.max_h_inlier_ratio, n_f, total);
        let h = ransac(&HomographyEstimator::new(&on_plane), &wanted, None, self.seed.wrapping_add(3));
        let n_h = count(&h);
        if n_f.max(n_h) < options.min_num_inliers {
            return None;
        }
        let planar = n_h >= options.min_num_inliers && n_h as f64 > options.max_h_inlier_ratio * n_f as f64;
        let config = if planar { TwoViewConfig::PlanarOrPanoramic } else { TwoViewConfig::Uncalibrated };
        let from_unit2 = s.to_unit2.inverse();
        let f_px = f.as_ref().map(|f| unit_norm(s.to_unit2.transpose() * f.model * s.to_unit1));
        let h_px = h.as_ref().map(|h| unit_norm(from_unit2 * h.model * s.to_unit1));
        let chosen = match (&f, &h) {
            (Some(_), Some(h)) if planar && n_h > n_f => h.inliers.clone(),
            (Some(f), _) => f.inliers.clone(),
            (None, Some(h)) => h.inliers.clone(),
            (None, None) => return None,
        };
        let mut geometry =
            TwoViewGeometry { config, fundamental: f_px, homography: h_px, ..TwoViewGeometry::degenerate() };

        let (k1, k2) = (calibration_matrix(self.camera1), calibration_matrix(self.camera2));
        let pose = if planar {
            let between_rays = k2.inverse() * h_px? * k1;
            view.pose_from_homography(&between_rays, None, &chosen, &options.relative_pose)
        } else {
            view.pose_from_essential(&(k2.transpose() * f_px? * k1), &chosen, &options.relative_pose)
        };
        self.set_matrix_inliers(&mut geometry, view, &chosen, pose);
        Some(geometry)
    }

    /// The inliers of F or H, and the pose that the present focal lengths make of it. The focal lengths are guesses, or
    /// contradict the matches: F or H is what the data say, so they keep the inliers and there is no E.
    fn set_matrix_inliers(
        &self,
        geometry: &mut TwoViewGeometry,
        view: &CalibratedPair,
        chosen: &[usize],
        pose: Option<Rigid3>,
    ) {
        geometry.inliers = chosen.iter().map(|&i| view.matches[i] as u32).collect();
        geometry.inliers.sort_unstable();
        if let Some(pose) = pose {
            self.set_motion(geometry, pose);
            geometry.tri_angle_rad = view.median_parallax_rad(pose.rotation, chosen);
        }
        geometry.essential = None;
    }
}
