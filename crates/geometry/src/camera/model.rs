//! The table of camera models: identifiers, names and the role of every parameter.

/// The largest number of parameters of any model (RAD_TAN_THIN_PRISM_FISHEYE).
pub const MAX_PARAMS: usize = 16;

/// COLMAP's camera models; the discriminant is COLMAP's model id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(i32)]
#[allow(missing_docs)]
pub enum CameraModel {
    SimplePinhole = 0,
    Pinhole = 1,
    SimpleRadial = 2,
    Radial = 3,
    OpenCv = 4,
    OpenCvFisheye = 5,
    FullOpenCv = 6,
    Fov = 7,
    SimpleRadialFisheye = 8,
    RadialFisheye = 9,
    ThinPrismFisheye = 10,
    RadTanThinPrismFisheye = 11,
    SimpleDivision = 12,
    Division = 13,
    SimpleFisheye = 14,
    Fisheye = 15,
    Eucm = 16,
    Equirectangular = 17,
}

/// What a model projects onto before it distorts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraFamily {
    /// The plane z = 1; an uncalibrated pair of such cameras has a fundamental matrix.
    Perspective,
    /// The angle from the optical axis.
    Fisheye,
    /// Longitude and latitude; every direction has a pixel.
    Spherical,
}

impl CameraModel {
    /// Every model, in the order of the ids.
    pub const ALL: [Self; 18] = [
        Self::SimplePinhole,
        Self::Pinhole,
        Self::SimpleRadial,
        Self::Radial,
        Self::OpenCv,
        Self::OpenCvFisheye,
        Self::FullOpenCv,
        Self::Fov,
        Self::SimpleRadialFisheye,
        Self::RadialFisheye,
        Self::ThinPrismFisheye,
        Self::RadTanThinPrismFisheye,
        Self::SimpleDivision,
        Self::Division,
        Self::SimpleFisheye,
        Self::Fisheye,
        Self::Eucm,
        Self::Equirectangular,
    ];

    /// The model with COLMAP's id, if there is one.
    pub fn from_id(id: i32) -> Option<Self> {
        usize::try_from(id).ok().and_then(|i| Self::ALL.get(i).copied())
    }

    /// COLMAP's id.
    pub const fn id(self) -> i32 {
        self as i32
    }

    /// The model with COLMAP's name (as in `cameras.txt`, upper case), if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// COLMAP's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::OpenCv => "OPENCV",
            Self::OpenCvFisheye => "OPENCV_FISHEYE",
            Self::FullOpenCv => "FULL_OPENCV",
            Self::Fov => "FOV",
            Self::SimpleRadialFisheye => "SIMPLE_RADIAL_FISHEYE",
            Self::RadialFisheye => "RADIAL_FISHEYE",
            Self::ThinPrismFisheye => "THIN_PRISM_FISHEYE",
            Self::RadTanThinPrismFisheye => "RAD_TAN_THIN_PRISM_FISHEYE",
            Self::SimpleDivision => "SIMPLE_DIVISION",
            Self::Division => "DIVISION",
            Self::SimpleFisheye => "SIMPLE_FISHEYE",
            Self::Fisheye => "FISHEYE",
            Self::Eucm => "EUCM",
            Self::Equirectangular => "EQUIRECTANGULAR",
        }
    }

    /// Names of the parameters in COLMAP's order (source: `algorithms.md` §3.5).
    pub const fn param_names(self) -> &'static [&'static str] {
        match self {
            Self::SimplePinhole | Self::SimpleFisheye => &["f", "cx", "cy"],
            Self::Pinhole | Self::Fisheye => &["fx", "fy", "cx", "cy"],
            Self::SimpleRadial | Self::SimpleRadialFisheye | Self::SimpleDivision => &["f", "cx", "cy", "k"],
            Self::Radial | Self::RadialFisheye => &["f", "cx", "cy", "k1", "k2"],
            Self::OpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"],
            Self::OpenCvFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"],
            Self::FullOpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            Self::Fov => &["fx", "fy", "cx", "cy", "omega"],
            Self::ThinPrismFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
            Self::RadTanThinPrismFisheye => {
                &["fx", "fy", "cx", "cy", "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"]
            }
            Self::Division => &["fx", "fy", "cx", "cy", "k"],
            Self::Eucm => &["fx", "fy", "cx", "cy", "alpha", "beta"],
            Self::Equirectangular => &["w", "h"],
        }
    }

    /// Number of parameters.
    pub const fn num_params(self) -> usize {
        self.param_names().len()
    }

    /// What the model projects onto.
    pub const fn family(self) -> CameraFamily {
        match self {
            Self::OpenCvFisheye
            | Self::SimpleRadialFisheye
            | Self::RadialFisheye
            | Self::ThinPrismFisheye
            | Self::RadTanThinPrismFisheye
            | Self::SimpleFisheye
            | Self::Fisheye => CameraFamily::Fisheye,
            Self::Equirectangular => CameraFamily::Spherical,
            _ => CameraFamily::Perspective,
        }
    }

    /// Indices of the focal lengths: one, two (x, y), or none for the equirectangular model.
    pub const fn focal_params(self) -> &'static [usize] {
        match self {
            Self::SimplePinhole
            | Self::SimpleRadial
            | Self::Radial
            | Self::SimpleRadialFisheye
            | Self::RadialFisheye
            | Self::SimpleDivision
            | Self::SimpleFisheye => &[0],
            Self::Equirectangular => &[],
            _ => &[0, 1],
        }
    }

    /// Indices of the principal point (x, y); none for the equirectangular model.
    pub const fn principal_point_params(self) -> &'static [usize] {
        match self.focal_params().len() {
            0 => &[],
            1 => &[1, 2],
            _ => &[2, 3],
        }
    }

    /// Indices of the remaining parameters (distortion), a contiguous range after the principal point.
    pub const fn extra_params(self) -> &'static [usize] {
        const INDICES: &[usize] = &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
        let focals = self.focal_params().len();
        if focals == 0 {
            return &[];
        }
        let (used, _) = INDICES.split_at(self.num_params());
        let (_, extra) = used.split_at(focals + 2);
        extra
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_names_round_trip() {
        for (i, model) in CameraModel::ALL.into_iter().enumerate() {
            assert_eq!(model.id(), i as i32);
            assert_eq!(CameraModel::from_id(i as i32), Some(model));
            assert_eq!(CameraModel::from_name(model.name()), Some(model));
            assert!(model.num_params() <= MAX_PARAMS);
        }
        assert_eq!(CameraModel::from_id(18), None);
        assert_eq!(CameraModel::from_id(-1), None);
        assert_eq!(CameraModel::from_name("pinhole"), None);
    }

    #[test]
    fn the_names_agree_with_the_roles() {
        for model in CameraModel::ALL {
            let names = model.param_names();
            for &i in model.focal_params() {
                assert!(names[i].starts_with('f'), "{model:?}");
            }
            for (&i, name) in model.principal_point_params().iter().zip(["cx", "cy"]) {
                assert_eq!(names[i], name, "{model:?}");
            }
            for &i in model.extra_params() {
                assert!(!names[i].starts_with(['f', 'c']), "{model:?}");
            }
            let roles = model.focal_params().len() + model.principal_point_params().len() + model.extra_params().len();
            let without_role = if model == CameraModel::Equirectangular { 2 } else { 0 };
            assert_eq!(roles + without_role, model.num_params(), "{model:?}");
        }
    }
}
