//! Which instruction set the kernels are compiled for: an argument, so that tests choose it.

use std::fmt;
use std::str::FromStr;

/// An instruction set level that this machine has.
///
/// All levels give the same bits (no fused multiply-add, the same order of summation); they
/// differ in speed only. A value can be made only for a level that the machine supports, which
/// is what makes calling the kernels sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuLevel(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Baseline,
    Avx2,
    Avx512,
}

/// Names of all levels, slowest first.
const NAMES: [(&str, Kind); 3] =
    [("baseline", Kind::Baseline), ("avx2", Kind::Avx2), ("avx512", Kind::Avx512)];

/// A level that this machine lacks, or a name that is none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnsupportedCpuLevel {
    /// What was asked for.
    pub name: String,
    /// Whether it is a level that other machines have.
    pub is_level: bool,
}

impl fmt::Display for UnsupportedCpuLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let available: Vec<_> = CpuLevel::available().map(CpuLevel::name).collect();
        write!(
            f,
            "CPU level '{}' is not available here; this machine has: {}",
            self.name,
            available.join(", ")
        )
    }
}

impl std::error::Error for UnsupportedCpuLevel {}

impl CpuLevel {
    /// What every machine of this architecture has (SSE2 on x86-64, NEON on aarch64).
    pub const BASELINE: Self = Self(Kind::Baseline);

    /// The fastest level of this machine.
    pub fn detect() -> Self {
        Self::available().last().unwrap_or(Self::BASELINE)
    }

    /// All levels that this machine has, slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        NAMES.into_iter().map(|(_, kind)| kind).filter(|kind| kind.is_supported()).map(Self)
    }

    /// The level's name: `baseline`, `avx2` or `avx512`.
    pub fn name(self) -> &'static str {
        NAMES.into_iter().find(|(_, kind)| *kind == self.0).map_or("baseline", |(name, _)| name)
    }

    pub(crate) fn kind(self) -> Kind {
        self.0
    }

    /// Runs `work` compiled for this level.
    pub fn run<W: Vectorized>(self, work: W) -> W::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a `CpuLevel` exists only for instruction sets that this machine has.
            Kind::Avx2 => unsafe { with_avx2(work) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Kind::Avx512 => unsafe { with_avx512(work) },
            _ => work.run(),
        }
    }
}

/// Loops over slices that the compiler turns into vector instructions of whatever level they are
/// compiled for: elementwise ones, without sums across elements, whose bits are the same in all.
pub trait Vectorized {
    /// What comes of it.
    type Output;

    /// The loops; `#[inline(always)]`, so that they are compiled again for each level.
    fn run(self) -> Self::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<W: Vectorized>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
fn with_avx512<W: Vectorized>(work: W) -> W::Output {
    work.run()
}

impl Kind {
    fn is_supported(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return match self {
            Self::Baseline => true,
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
            }
        };
        #[cfg(not(target_arch = "x86_64"))]
        return self == Self::Baseline;
    }
}

impl FromStr for CpuLevel {
    type Err = UnsupportedCpuLevel;

    fn from_str(name: &str) -> Result<Self, UnsupportedCpuLevel> {
        if name == "auto" {
            return Ok(Self::detect());
        }
        Self::available().find(|level| level.name() == name).ok_or_else(|| UnsupportedCpuLevel {
            name: name.to_owned(),
            is_level: NAMES.iter().any(|(level, _)| *level == name),
        })
    }
}
