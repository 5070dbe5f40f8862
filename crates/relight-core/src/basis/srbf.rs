//! Spherical radial basis functions: Gaussians of the angle between the light and a centre.
//!
//! Source: Wong, Leung, Choy, *Lighting Precomputation Using the Relighting Map*, eq. 1 and 2;
//! MATH.md section 1.2 for what "spread" and "uniform" have to mean.

use super::{BasisError, Design, FunctionsOfLight};
use crate::sphere::{self, Cap};
use crate::{Direction, LightSet};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The most centres a basis may have.
pub(super) const MAX_COUNT: usize = 128;

/// A cap wider than this is not worth restricting centres to.
const WIDEST_CAP: f64 = 2.0 * PI / 3.0;

/// How far centres reach beyond the outermost light (MATH.md section 5, "hull of lights + pad").
const CAP_MARGIN: f64 = 0.1;

/// Where centres come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointSet {
    /// Hammersley points in base 2, as the paper prints it.
    Hammersley2,
    /// Hammersley points in base 3, as the authors' program has it.
    Hammersley3,
    /// The golden-angle spiral: 25 to 40 % smaller holes than Hammersley.
    Fibonacci,
}

/// The part of the sphere that centres cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// The cap that holds all lights, or the sphere where that cap is wider than 120 degrees.
    Auto,
    /// The whole sphere.
    Sphere,
    /// The cap that holds all lights and a margin of 0.1 rad.
    Cap,
}

/// How the spread (the Gaussians' standard deviation) is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spread {
    /// This factor times the mean distance of centres to their nearest neighbour.
    OfMean(f64),
    /// The least distance between two centres: the paper read literally (15 to 85 % more error).
    LeastDistance,
}

/// The shape of a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kernel {
    /// exp(-angle^2 / (2 spread^2)), the paper's equation 2.
    Geodesic,
    /// exp((cosine - 1) / spread^2), the spherical Gaussian of engines.
    Spherical,
}

/// Choices of the SRBF family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SrbfDesign {
    /// Where centres come from.
    pub points: PointSet,
    /// The part of the sphere that they cover.
    pub domain: Domain,
    /// How wide the functions are.
    pub spread: Spread,
    /// Their shape.
    pub kernel: Kernel,
}

impl Default for SrbfDesign {
    fn default() -> Self {
        Self {
            points: PointSet::Fibonacci,
            domain: Domain::Auto,
            spread: Spread::OfMean(0.85),
            kernel: Kernel::Geodesic,
        }
    }
}

/// k Gaussians on the sphere with one spread.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Record", into = "Record")]
pub struct Srbf {
    centres: Vec<Direction>,
    spread: f64,
    kernel: Kernel,
}

#[derive(Serialize, Deserialize)]
struct Record {
    centres: Vec<Direction>,
    spread: f64,
    kernel: Kernel,
}

impl TryFrom<Record> for Srbf {
    type Error = BasisError;

    fn try_from(record: Record) -> Result<Self, BasisError> {
        Self::new(record.centres, record.spread, record.kernel)
    }
}

impl From<Srbf> for Record {
    fn from(srbf: Srbf) -> Self {
        Self { centres: srbf.centres, spread: srbf.spread, kernel: srbf.kernel }
    }
}

impl Srbf {
    /// Functions around `centres` with `spread` radians.
    ///
    /// # Errors
    /// [`BasisError`] without centres, with more than 128, or with a spread outside 0.001..10.
    pub fn new(centres: Vec<Direction>, spread: f64, kernel: Kernel) -> Result<Self, BasisError> {
        if centres.is_empty() || centres.len() > MAX_COUNT {
            return Err(BasisError::Centres { count: centres.len() });
        }
        if !(0.001..=10.0).contains(&spread) {
            return Err(BasisError::Spread { spread });
        }
        Ok(Self { centres, spread, kernel })
    }

    /// `design.count` centres on the domain that `design` asks for.
    pub(super) fn design(design: &Design<'_>) -> Result<Self, BasisError> {
        let SrbfDesign { points, domain, spread, kernel } = design.srbf;
        let cap = centre_cap(domain, design.lights);
        let centres = match points {
            PointSet::Hammersley2 => sphere::hammersley_in(cap, design.count, 2),
            PointSet::Hammersley3 => sphere::hammersley_in(cap, design.count, 3),
            PointSet::Fibonacci => sphere::fibonacci_in(cap, design.count),
        };
        let nearest = sphere::nearest_neighbour_distances(&centres);
        let spread = match spread {
            // A single centre has no neighbour: the cap's own radius is its scale.
            _ if nearest.is_empty() => cap.radius.min(1.0),
            Spread::OfMean(factor) => factor * nearest.iter().sum::<f64>() / nearest.len() as f64,
            Spread::LeastDistance => nearest.iter().fold(PI, |least, &d| least.min(d)),
        };
        Self::new(centres, spread, kernel)
    }

    /// Centres of the functions.
    pub fn centres(&self) -> &[Direction] {
        &self.centres
    }

    /// Standard deviation of the functions in radians.
    pub fn spread(&self) -> f64 {
        self.spread
    }

    /// Shape of the functions.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }
}

/// The cap that `domain` asks centres to cover.
fn centre_cap(domain: Domain, lights: &LightSet) -> Cap {
    let sphere = Cap { axis: Direction::OUT, radius: PI };
    let directions = lights.directions();
    let Some(cap) = Cap::enclosing(&directions) else {
        return sphere;
    };
    match domain {
        Domain::Sphere => sphere,
        Domain::Auto if cap.radius > WIDEST_CAP => sphere,
        Domain::Auto | Domain::Cap => Cap { axis: cap.axis, radius: (cap.radius + CAP_MARGIN).min(PI) },
    }
}

impl FunctionsOfLight for Srbf {
    fn count(&self) -> usize {
        self.centres.len()
    }

    fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        let squared = self.spread * self.spread;
        for (weight, centre) in weights[..self.centres.len()].iter_mut().zip(&self.centres) {
            *weight = match self.kernel {
                Kernel::Geodesic => {
                    let angle = light.angle_to(*centre);
                    libm::exp(-angle * angle / (2.0 * squared))
                }
                Kernel::Spherical => libm::exp((light.cosine(*centre) - 1.0) / squared),
            };
        }
    }

    fn label(&self, j: usize) -> String {
        format!("c{j}")
    }
}
