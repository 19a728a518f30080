//! What kernels are compiled for: flags that a problem raises and that conditions in shaders ask for.

/// A set of flags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Variant(u32);

/// Names of the flags in shaders, the lowest bit first.
const FLAGS: [&str; 2] = ["wide", "depth"];

impl Variant {
    /// Cameras of every model, with up to [`MAX_PARAMS`](epipole_geometry::camera::MAX_PARAMS) parameters; without it
    /// the pinhole and radial models and OPENCV, with eight.
    pub const WIDE: Self = Self(1);
    /// Observations carry measured depths: a third row.
    pub const DEPTH: Self = Self(2);
    /// Every flag.
    pub const ALL_FLAGS: Self = Self((1 << FLAGS.len()) - 1);

    /// The flag of a name, if there is one.
    pub fn from_flag(name: &str) -> Option<Self> {
        FLAGS.iter().position(|flag| *flag == name).map(|bit| Self(1 << bit))
    }

    /// Both sets together.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The flags that both sets have.
    #[must_use]
    pub const fn common(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Whether every flag of another set is in this one.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Every set of flags of this one, the empty set first, this one last.
    pub fn subsets(self) -> impl Iterator<Item = Self> {
        (0..=self.0).filter(move |bits| bits & !self.0 == 0).map(Self)
    }

    /// The flags' names, in the order of their declaration.
    pub fn flags(self) -> impl Iterator<Item = &'static str> {
        FLAGS.iter().zip(0..).filter(move |(_, bit)| self.0 >> bit & 1 == 1).map(|(name, _)| *name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subsets_are_complete_and_names_round_trip() {
        let both = Variant::WIDE.with(Variant::DEPTH);
        assert_eq!(both.subsets().collect::<Vec<_>>(), [Variant::default(), Variant::WIDE, Variant::DEPTH, both]);
        assert_eq!(Variant::DEPTH.subsets().collect::<Vec<_>>(), [Variant::default(), Variant::DEPTH]);
        for name in Variant::ALL_FLAGS.flags() {
            let flag = Variant::from_flag(name).expect("a flag's own name");
            assert_eq!(flag.flags().collect::<Vec<_>>(), [name]);
            assert!(Variant::ALL_FLAGS.has(flag) && !Variant::default().has(flag));
        }
        assert_eq!(Variant::from_flag("broad"), None);
    }
}
