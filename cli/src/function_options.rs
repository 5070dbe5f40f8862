//! Which functions of light, and how many: options of whoever fits.

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use relight_core::Family;
use relight_core::basis::{Domain, FAMILIES, Kernel, PointSet, Spread, SrbfDesign};

/// How many functions, and where those of SRBF lie.
#[derive(Args, Clone, Debug)]
pub(crate) struct FunctionOptions {
    /// Number of functions of light; of pca, planes
    #[arg(short, long, value_name = "N", conflicts_with_all = ["order", "degree"], value_parser = size_of, allow_negative_numbers = true)]
    k: Option<usize>,
    /// Order of sh and hsh, instead of -k
    #[arg(long, value_name = "N", conflicts_with = "degree", value_parser = size_of, allow_negative_numbers = true)]
    order: Option<usize>,
    /// Degree of ptm, instead of -k
    #[arg(long, value_name = "N", value_parser = size_of, allow_negative_numbers = true)]
    degree: Option<usize>,
    /// SRBF: where centres come from [default: fibonacci]
    #[arg(long, value_name = "SET", value_enum)]
    points: Option<Points>,
    /// SRBF: the part of the sphere that centres cover [default: auto]
    #[arg(long, value_name = "DOMAIN", value_enum)]
    domain: Option<DomainChoice>,
    /// SRBF: spread as a factor of the centres' mean nearest distance, or 'paper' for the least
    /// [default: 0.85]
    #[arg(long, value_name = "FACTOR", value_parser = spread_of, allow_negative_numbers = true)]
    spread: Option<Spread>,
    /// SRBF: the functions' shape [default: geodesic]
    #[arg(long, value_name = "KERNEL", value_enum)]
    kernel: Option<KernelChoice>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Points {
    Hammersley2,
    Hammersley3,
    Fibonacci,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DomainChoice {
    Auto,
    Sphere,
    Cap,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum KernelChoice {
    Geodesic,
    Spherical,
}

/// A whole number.
pub(crate) fn size_of(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "write a whole number such as 9".to_owned())
}

fn spread_of(text: &str) -> Result<Spread, String> {
    match text.parse::<f64>() {
        _ if text == "paper" => Ok(Spread::LeastDistance),
        Ok(factor) if (0.1..=10.0).contains(&factor) => Ok(Spread::OfMean(factor)),
        _ => Err("write paper or a factor from 0.1 to 10".to_owned()),
    }
}

/// The largest --order or --degree that is counted out; all families end far below.
const LARGEST_SIZE: usize = 20;

/// The family of that name.
///
/// # Errors
/// Exit code 2 with the names that there are.
pub(crate) fn family_of_name(name: &str) -> Result<&'static Family, Failure> {
    Family::by_name(name).ok_or_else(|| {
        let names: Vec<_> = FAMILIES.iter().map(|family| family.name).collect();
        Failure::usage(format!("unknown basis '{name}'; there are: {}", names.join(", ")))
    })
}

impl FunctionOptions {
    /// These options for `count` functions.
    pub(crate) fn with_count(&self, count: usize) -> Self {
        Self { k: Some(count), order: None, degree: None, ..self.clone() }
    }

    /// Whether the SRBF functions' places or shape are asked for.
    pub(crate) fn shapes_srbf(&self) -> bool {
        self.points.is_some() || self.domain.is_some() || self.spread.is_some() || self.kernel.is_some()
    }

    /// The number of functions asked for by -k, --order or --degree; `None` for the default.
    pub(crate) fn asked_count(&self, family: &Family) -> Result<Option<usize>, Failure> {
        let sized = |word: &str, size: Option<usize>| match (size, family.size) {
            (None, _) => Ok(None),
            (Some(size), Some(named)) if named.word == word && size <= LARGEST_SIZE => {
                Ok(Some((named.count_of)(size)))
            }
            (Some(size), Some(named)) if named.word == word => Err(Failure::usage(format!(
                "basis {} has no --{word} {size}; it has -k {}",
                family.name, family.counts
            ))),
            (Some(_), named) => {
                let takes = named.map_or("-k".to_owned(), |named| format!("-k or --{}", named.word));
                Err(Failure::usage(format!("basis {} takes no --{word}; use {takes}", family.name)))
            }
        };
        Ok(self.k.or(sized("order", self.order)?).or(sized("degree", self.degree)?))
    }

    /// The choices of the SRBF family; an error when they are given for another one.
    pub(crate) fn srbf(&self, basis: &str) -> Result<SrbfDesign, Failure> {
        let given = [
            ("points", self.points.is_some()),
            ("domain", self.domain.is_some()),
            ("spread", self.spread.is_some()),
            ("kernel", self.kernel.is_some()),
        ];
        if let Some((flag, _)) = given.iter().find(|(_, given)| *given).filter(|_| basis != "srbf") {
            return Err(Failure::usage(format!(
                "--{flag} belongs to --basis srbf; {basis} has no such choice"
            )));
        }
        let default = SrbfDesign::default();
        Ok(SrbfDesign {
            points: self.points.map_or(default.points, |points| match points {
                Points::Hammersley2 => PointSet::Hammersley2,
                Points::Hammersley3 => PointSet::Hammersley3,
                Points::Fibonacci => PointSet::Fibonacci,
            }),
            domain: self.domain.map_or(default.domain, |domain| match domain {
                DomainChoice::Auto => Domain::Auto,
                DomainChoice::Sphere => Domain::Sphere,
                DomainChoice::Cap => Domain::Cap,
            }),
            spread: self.spread.unwrap_or(default.spread),
            kernel: self.kernel.map_or(default.kernel, |kernel| match kernel {
                KernelChoice::Geodesic => Kernel::Geodesic,
                KernelChoice::Spherical => Kernel::Spherical,
            }),
        })
    }
}
