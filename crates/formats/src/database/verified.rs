//! A row of `two_view_geometries` (or `inlier_matches`, its name until 2018).

use epipole_geometry::Rigid3;
use epipole_scene::{Pair, PairConfig};
use glam::DMat3;
use rusqlite::Row;

use super::blob as blobs;
use super::pairs::{PairContext, PairKey, row_count, unverified};
use super::schema::{blob, optional_integer};
use crate::error::{Location, Problem, Warnings};

/// Columns after `pair_id` and `rows`; all but `data` came with later versions.
pub(super) const COLUMNS: &[&str] = &["data", "config", "F", "E", "H", "qvec", "tvec", "camera1", "camera2"];

/// Reads the pair. A matrix, pose or camera that makes no sense is left out alone: it can be estimated again.
pub(super) fn pair(
    row: &Row<'_>,
    key: PairKey,
    context: &PairContext<'_>,
    place: Location,
    warnings: &mut Warnings,
) -> Result<Pair, Problem> {
    let inliers = context.matches(row, key)?;
    let num_matches = row_count(row)? as usize;
    let config = match optional_integer(row, 3, "config")? {
        // Before the column existed every row with matches was a usable geometry of unknown kind.
        None => PairConfig::Undefined,
        Some(config) => config_from_id(config)?,
    };
    let mut mend = |problem: Problem| {
        warnings.push(place.clone(), problem, "the value is ignored and estimated again if it is needed");
        None
    };
    let mut matrix = |index: usize, column: &'static str| {
        blob(row, index, column).and_then(|b| blobs::matrix(b, column)).unwrap_or_else(&mut mend)
    };
    let (fundamental, essential, homography) = (matrix(4, "F"), matrix(5, "E"), matrix(6, "H"));
    let pose = blob(row, 7, "qvec").and_then(|q| blobs::pose(q, blob(row, 8, "tvec")?)).unwrap_or_else(|p| {
        mend(p);
        None
    });
    let mut camera = |index: usize, column: &'static str| {
        blob(row, index, column).and_then(|b| blobs::camera(b, column)).unwrap_or_else(|p| {
            mend(p);
            None
        })
    };
    let solver_cameras = [camera(9, "camera1"), camera(10, "camera2")];
    let pair = Pair {
        config,
        fundamental,
        essential,
        homography,
        cam2_from_cam1: pose,
        solver_cameras,
        inliers,
        num_matches,
        ..unverified(key)
    };
    Ok(if key.swapped { turned_round(pair) } else { pair })
}

/// The geometry of (2, 1) as that of (1, 2); matches and images are in order already.
fn turned_round(mut pair: Pair) -> Pair {
    pair.fundamental = pair.fundamental.map(|f| f.transpose());
    pair.essential = pair.essential.map(|e| e.transpose());
    pair.homography = pair.homography.map(|h| h.inverse()).filter(DMat3::is_finite);
    pair.cam2_from_cam1 = pair.cam2_from_cam1.map(|p: Rigid3| p.inverse());
    pair.solver_cameras.swap(0, 1);
    pair
}

fn config_from_id(id: i64) -> Result<PairConfig, Problem> {
    let found = PairConfig::from_id(id);
    found.ok_or_else(|| Problem::OutOfRange { what: "config".into(), found: id.to_string(), expected: "0 to 9".into() })
}
