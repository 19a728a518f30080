//! Which image of the estimate is which image of the reference.

use std::collections::BTreeMap;

use epipole_geometry::Rigid3;
use glam::DVec3;

use crate::Reconstruction;

/// What of an image's name is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MatchBy {
    /// The whole name with its folders.
    Name,
    /// The name without folders.
    #[default]
    Base,
    /// The name without folders and extension.
    Stem,
}

impl MatchBy {
    /// The part of a name that is compared.
    pub fn key(self, name: &str) -> &str {
        let base = name.rsplit('/').next().unwrap_or(name);
        match self {
            Self::Name => name,
            Self::Base => base,
            // A leading dot starts a hidden file's name, not an extension.
            Self::Stem => match base.rfind('.') {
                Some(dot) if base[..dot].chars().any(|c| c != '.') => &base[..dot],
                _ => base,
            },
        }
    }
}

/// Poses of the images that both reconstructions have, in the order of their names.
pub(super) struct Matched {
    /// Estimated and reference pose.
    pub(super) common: Vec<[Rigid3; 2]>,
    /// Images of the estimate with different names.
    pub(super) estimate_images: usize,
    /// Images of the reference with different names.
    pub(super) reference_images: usize,
    /// Camera centres of the reference.
    pub(super) reference_centers: Vec<DVec3>,
}

/// Matches images by name; of several with the same key the last counts.
pub(super) fn match_images(estimate: &Reconstruction, reference: &Reconstruction, by: MatchBy) -> Matched {
    let poses = |r: &Reconstruction| -> BTreeMap<String, Rigid3> {
        r.images.iter().map(|i| (by.key(&i.name).to_owned(), i.cam_from_world)).collect()
    };
    let (estimate, reference) = (poses(estimate), poses(reference));
    Matched {
        common: reference.iter().filter_map(|(name, pose)| Some([*estimate.get(name)?, *pose])).collect(),
        estimate_images: estimate.len(),
        reference_images: reference.len(),
        reference_centers: reference.values().map(Rigid3::center).collect(),
    }
}
