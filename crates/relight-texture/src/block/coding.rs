//! How hard to look for good blocks, and who looks.

use super::FACTS;

/// How much time blocks may take: a step up costs two to eight times the former one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Quality {
    /// For trying things out.
    Fast,
    /// What a bake takes unless told otherwise.
    #[default]
    Normal,
    /// For a release.
    High,
    /// The last tenth of a decibel, at four to eight times the cost of `High`.
    Best,
}

/// Whose encoder makes the blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Encoder {
    /// The same bytes on every machine.
    #[default]
    Portable,
    /// Prebuilt ISPC kernels for BC7 (bc7e) and BC6H (Intel), which is faster by them. Their arithmetic depends on
    /// the processor, so bytes may too. Formats without a kernel are encoded as by `Portable`.
    Ispc,
}

/// How blocks are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct BlockCoding {
    /// How hard to look.
    pub quality: Quality,
    /// Who looks.
    pub encoder: Encoder,
}

static QUALITIES: [(Quality, &str); 4] =
    [(Quality::Fast, "fast"), (Quality::Normal, "normal"), (Quality::High, "high"), (Quality::Best, "best")];

static ENCODERS: [(Encoder, &str); 2] = [(Encoder::Portable, "portable"), (Encoder::Ispc, "ispc")];

impl Quality {
    /// All, from the fastest to the best.
    pub fn all() -> impl Iterator<Item = Self> {
        QUALITIES.iter().map(|row| row.0)
    }

    /// The quality of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        QUALITIES.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// `fast`, `normal`, `high` or `best`.
    pub fn name(self) -> &'static str {
        QUALITIES[self as usize].1
    }
}

impl Encoder {
    /// All, the default first.
    pub fn all() -> impl Iterator<Item = Self> {
        ENCODERS.iter().map(|row| row.0)
    }

    /// The encoder of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        ENCODERS.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// `portable` or `ispc`.
    pub fn name(self) -> &'static str {
        ENCODERS[self as usize].1
    }

    /// Whether this build has it: kernels need the feature `ispc` and a target they are built for.
    pub fn available(self) -> bool {
        match self {
            Self::Portable => true,
            Self::Ispc => FACTS.iter().any(|facts| facts.foreign.is_some()),
        }
    }
}
