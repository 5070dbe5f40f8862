//! Bases: families of functions of light direction, one file each, and the table that lists them.
//!
//! To add one: a file beside this one with a type that implements [`FunctionsOfLight`], a variant
//! of [`Basis`] with its arm in `functions`, and a row in [`FAMILIES`]. The recovery test and the
//! command line take it from there.

mod hsh;
mod learned;
mod ptm;
mod sh;
mod srbf;

pub use hsh::Hsh;
pub use learned::Learned;
pub use ptm::{Ptm, ptm_exponents};
pub use sh::{Sh, evaluate_sh};
pub use srbf::{Domain, Kernel, PointSet, Spread, Srbf, SrbfDesign};

use crate::{Direction, LightSet};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Functions b_0 .. b_(k-1) of light direction.
pub trait FunctionsOfLight {
    /// k, the number of functions.
    fn count(&self) -> usize;

    /// Writes b_j(light) to `weights[j]`.
    ///
    /// # Panics
    /// When `weights` is shorter than [`Self::count`].
    fn evaluate(&self, light: Direction, weights: &mut [f64]);

    /// What function `j` is, in a word that suits a channel name.
    fn label(&self, j: usize) -> String;
}

/// A basis with its parameters, as assets store it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "family", rename_all = "lowercase")]
pub enum Basis {
    /// Polynomials in the light's picture-plane components.
    Ptm(Ptm),
    /// Real spherical harmonics.
    Sh(Sh),
    /// Hemispherical harmonics.
    Hsh(Hsh),
    /// Spherical radial basis functions.
    Srbf(Srbf),
    /// Functions learned from the pictures, as a table.
    Learned(Learned),
}

/// Which numbers of functions a family has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// Exactly these.
    Listed(&'static [usize]),
    /// Any from 1 to this.
    UpTo(usize),
}

/// What a family is built from.
#[derive(Clone, Debug)]
pub struct Design<'a> {
    /// k, the number of functions.
    pub count: usize,
    /// The lights to be fitted: families with local support place their functions there.
    pub lights: &'a LightSet,
    /// Choices of the SRBF family.
    pub srbf: SrbfDesign,
}

impl<'a> Design<'a> {
    /// `count` functions for `lights`, everything else at its default.
    pub fn new(count: usize, lights: &'a LightSet) -> Self {
        Self { count, lights, srbf: SrbfDesign::default() }
    }
}

/// The word for a family's size and what it means.
#[derive(Clone, Copy, Debug)]
pub struct SizeWord {
    /// `order` or `degree`.
    pub word: &'static str,
    /// The number of functions of each size.
    pub count_of: fn(usize) -> usize,
}

/// A row of the table of families.
#[derive(Clone, Copy, Debug)]
pub struct Family {
    /// The name on the command line and in files.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// The numbers of functions that it has.
    pub counts: Counts,
    /// k when none is given.
    pub default_count: usize,
    /// The least ridge, relative to the largest singular value squared: what keeps coefficients
    /// small enough for 8 bits without costing accuracy. Measured on five captures
    /// (docs/accuracy.md, "Ridge"); larger than MATH.md's for synthetic data.
    pub ridge: f64,
    /// How its size is named other than by the number of functions.
    pub size: Option<SizeWord>,
    /// Whether its functions are learned from pictures rather than built from the lights; its counts are
    /// then numbers of planes.
    pub learned: bool,
    make: fn(&Design<'_>) -> Result<Basis, BasisError>,
}

/// All families, in the order in which they are listed to users.
pub static FAMILIES: [Family; 5] = [
    Family {
        name: "ptm",
        about: "polynomial texture map: polynomials of degree 2, 3 or 4 in the light's x and y",
        counts: Counts::Listed(&ptm::COUNTS),
        default_count: 6,
        ridge: 1e-4,
        size: Some(SizeWord { word: "degree", count_of: ptm::count_of_degree }),
        learned: false,
        make: |design| Ptm::with_count(design.count).map(Basis::Ptm),
    },
    Family {
        name: "sh",
        about: "real spherical harmonics to order 10",
        counts: Counts::Listed(&sh::COUNTS),
        default_count: 9,
        ridge: 2e-4,
        size: Some(SizeWord { word: "order", count_of: sh::count_of_order }),
        learned: false,
        make: |design| Sh::with_count(design.count).map(Basis::Sh),
    },
    Family {
        name: "hsh",
        about: "hemispherical harmonics, the functions of .rti files",
        counts: Counts::Listed(&hsh::COUNTS),
        default_count: 9,
        ridge: 1e-4,
        size: Some(SizeWord { word: "order", count_of: sh::count_of_order }),
        learned: false,
        make: |design| Hsh::with_count(design.count).map(Basis::Hsh),
    },
    Family {
        name: "srbf",
        about: "spherical radial basis functions (Gaussians of the angle to centres)",
        counts: Counts::UpTo(srbf::MAX_COUNT),
        default_count: 25,
        ridge: 1e-3,
        size: None,
        learned: false,
        make: |design| Srbf::design(design).map(Basis::Srbf),
    },
    Family {
        name: "pca",
        about: "planes learned from the pictures: principal components over lights and channels",
        counts: Counts::UpTo(learned::MAX_PLANES),
        default_count: 18,
        ridge: 0.0,
        size: None,
        learned: true,
        make: |_| Err(BasisError::Learned),
    },
];

impl Family {
    /// The family of that name.
    pub fn by_name(name: &str) -> Option<&'static Self> {
        FAMILIES.iter().find(|family| family.name == name)
    }

    /// The basis of `design.count` functions.
    ///
    /// # Errors
    /// [`BasisError`] when the family does not have that number of functions or a parameter is
    /// out of range.
    pub fn build(&self, design: &Design<'_>) -> Result<Basis, BasisError> {
        if !self.counts.contains(design.count) {
            return Err(BasisError::Count { family: self.name, count: design.count, counts: self.counts });
        }
        (self.make)(design)
    }

    /// All numbers of functions up to `limit`, rising.
    pub fn counts_up_to(&self, limit: usize) -> Vec<usize> {
        match self.counts {
            Counts::Listed(list) => list.iter().copied().filter(|&count| count <= limit).collect(),
            Counts::UpTo(most) => (1..=most.min(limit)).collect(),
        }
    }
}

impl Counts {
    /// Whether `count` is among them.
    pub fn contains(self, count: usize) -> bool {
        match self {
            Self::Listed(list) => list.contains(&count),
            Self::UpTo(most) => (1..=most).contains(&count),
        }
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Listed(list) => {
                let words: Vec<_> = list.iter().map(ToString::to_string).collect();
                write!(f, "{}", words.join(", "))
            }
            Self::UpTo(most) => write!(f, "any from 1 to {most}"),
        }
    }
}

impl Basis {
    fn functions(&self) -> &dyn FunctionsOfLight {
        match self {
            Self::Ptm(basis) => basis,
            Self::Sh(basis) => basis,
            Self::Hsh(basis) => basis,
            Self::Srbf(basis) => basis,
            Self::Learned(basis) => basis,
        }
    }

    /// The row of this basis in [`FAMILIES`].
    pub fn family(&self) -> &'static Family {
        let row = match self {
            Self::Ptm(_) => 0,
            Self::Sh(_) => 1,
            Self::Hsh(_) => 2,
            Self::Srbf(_) => 3,
            Self::Learned(_) => 4,
        };
        &FAMILIES[row]
    }

    /// k, the number of functions.
    pub fn count(&self) -> usize {
        self.functions().count()
    }

    /// Writes b_j(light) to `weights[j]` for all k functions.
    ///
    /// # Panics
    /// When `weights` is shorter than [`Self::count`].
    pub fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        self.functions().evaluate(light, weights);
    }

    /// What function `j` is, in a word.
    pub fn label(&self, j: usize) -> String {
        self.functions().label(j)
    }
}

/// Why a basis can't be built.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum BasisError {
    /// The family does not have that number of functions.
    Count {
        /// The family's name.
        family: &'static str,
        /// What was asked for.
        count: usize,
        /// What it has.
        counts: Counts,
    },
    /// A spread outside its range.
    Spread {
        /// In radians.
        spread: f64,
    },
    /// A family that is learned from pictures was to be built from lights.
    Learned,
    /// A table of learned functions that is none.
    Table {
        /// What is wrong with it.
        problem: &'static str,
    },
    /// An SRBF without centres, or with more than the most.
    Centres {
        /// How many.
        count: usize,
    },
}

impl fmt::Display for BasisError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count { family, count, counts } => {
                write!(f, "basis {family} has no form with {count} functions; it has: {counts}")
            }
            Self::Spread { spread } => {
                write!(f, "SRBF spread {spread} rad is outside 0.001..10; give another --spread factor")
            }
            Self::Learned => {
                write!(
                    f,
                    "functions of pca are learned from pictures, not built from lights; use relight bake"
                )
            }
            Self::Table { problem } => write!(f, "a table of learned functions has {problem}"),
            Self::Centres { count } => {
                write!(f, "an SRBF basis with {count} centres is outside 1..{}", srbf::MAX_COUNT)
            }
        }
    }
}

impl std::error::Error for BasisError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_family_is_its_own_row_and_survives_json() {
        let lights = LightSet::from_directions((0..40).map(|i| sphere_direction(f64::from(i))).collect());
        for family in FAMILIES.iter().filter(|family| !family.learned) {
            for count in family.counts_up_to(30) {
                let basis = family.build(&Design::new(count, &lights)).unwrap();
                assert_eq!(basis.count(), count);
                assert_eq!(basis.family().name, family.name);
                let text = serde_json::to_string(&basis).unwrap();
                assert!(text.contains(family.name), "{text}");
                let back: Basis = serde_json::from_str(&text).unwrap();
                assert_eq!(back, basis);
            }
        }
    }

    fn sphere_direction(i: f64) -> Direction {
        Direction::new(libm::cos(i * 2.4), libm::sin(i * 2.4), 0.2 + i * 0.05).unwrap()
    }

    #[test]
    fn a_count_that_a_family_lacks_is_refused_with_those_it_has() {
        let lights = LightSet::default();
        let refused = Family::by_name("ptm").unwrap().build(&Design::new(7, &lights)).unwrap_err();
        assert_eq!(refused.to_string(), "basis ptm has no form with 7 functions; it has: 6, 10, 15");
        let refused = Family::by_name("srbf").unwrap().build(&Design::new(129, &lights)).unwrap_err();
        assert!(refused.to_string().contains("any from 1 to 128"), "{refused}");
    }

    #[test]
    fn damaged_parameters_are_refused() {
        for text in [
            r#"{"family":"ptm","degree":9}"#,
            r#"{"family":"sh","order":400}"#,
            r#"{"family":"hsh","order":4}"#,
            r#"{"family":"srbf","centres":[],"spread":0.5,"kernel":"geodesic"}"#,
            r#"{"family":"srbf","centres":[[0,0,1]],"spread":0,"kernel":"geodesic"}"#,
            r#"{"family":"srbf","centres":[[0,0,0]],"spread":1,"kernel":"geodesic"}"#,
        ] {
            assert!(serde_json::from_str::<Basis>(text).is_err(), "{text}");
        }
    }
}
