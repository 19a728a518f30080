//! COLMAP's labels for what two views turned out to be.

/// What a verified pair is; the discriminants are COLMAP's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(i32)]
pub enum TwoViewConfig {
    /// Not looked at.
    Undefined = 0,
    /// Too few inliers, or none of the models holds.
    Degenerate = 1,
    /// An essential matrix holds.
    Calibrated = 2,
    /// A fundamental matrix holds.
    Uncalibrated = 3,
    /// A homography holds: a plane seen from two places.
    Planar = 4,
    /// A homography holds: a camera that only turned.
    Panoramic = 5,
    /// A homography holds; which of the two is open.
    PlanarOrPanoramic = 6,
    /// A shift near the border.
    Watermark = 7,
    /// Several geometries with inliers of their own.
    Multiple = 8,
    /// Calibrated, from rigs with several cameras.
    CalibratedRig = 9,
}

impl TwoViewConfig {
    /// Every label, in the order of the ids.
    pub const ALL: [Self; 10] = [
        Self::Undefined,
        Self::Degenerate,
        Self::Calibrated,
        Self::Uncalibrated,
        Self::Planar,
        Self::Panoramic,
        Self::PlanarOrPanoramic,
        Self::Watermark,
        Self::Multiple,
        Self::CalibratedRig,
    ];

    /// The label with COLMAP's id, if there is one.
    pub fn from_id(id: i64) -> Option<Self> {
        usize::try_from(id).ok().and_then(|i| Self::ALL.get(i).copied())
    }

    /// Whether the label promises a relative pose.
    pub fn has_pose(self) -> bool {
        matches!(self, Self::Calibrated | Self::Uncalibrated | Self::CalibratedRig) || self.is_planar_or_panoramic()
    }

    /// Whether a homography explains the pair.
    pub fn is_planar_or_panoramic(self) -> bool {
        matches!(self, Self::Planar | Self::Panoramic | Self::PlanarOrPanoramic)
    }
}
