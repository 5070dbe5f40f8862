//! Ways to evaluate a basis at every pixel's own light direction, and which is the cheapest that is good
//! enough.

use crate::cube_map::CubeMaps;
use crate::elementary::{FINE_SQUARED_ANGLE, LANES, Lanes, NARROW, exp, fine_exp2, lanes, squared_angle};
use crate::harmonics;
use crate::square_table::SquareTable;
use crate::table::{Argument, Table};
use relight_core::basis::{Kernel, Srbf};
use relight_core::{Basis, CpuLevel, Vectorized};
use std::fmt;

/// How wrong a function of light may be, in units of the function itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Accuracy {
    /// To the rounding of f32.
    #[default]
    Exact,
    /// 1e-4.
    Fine,
    /// 1e-3.
    Coarse,
}

impl Accuracy {
    /// All, the best first.
    pub const ALL: [Self; 3] = [Self::Exact, Self::Fine, Self::Coarse];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Fine => "1e-4",
            Self::Coarse => "1e-3",
        }
    }

    /// The largest error; 0 for exact.
    pub fn error(self) -> f64 {
        match self {
            Self::Exact => 0.0,
            Self::Fine => 1e-4,
            Self::Coarse => 1e-3,
        }
    }
}

/// How functions are evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Path {
    /// By their formulas: SRBF through the squared angle and a polynomial exponential, SH
    /// by recursion, PTM and HSH as polynomials, learned functions from their own table; to the rounding of f32.
    Exact,
    /// SRBF up to a spread of 0.6 with shorter polynomials, within 6e-5 of a function's peak.
    Fine,
    /// The same as powers of the shortest, within 2e-4.
    Coarse,
    /// SRBF by the papers' 1-D table over the cosine, linear between so many nodes.
    CosineTable {
        /// At least 2.
        nodes: usize,
    },
    /// SRBF by a table over sqrt((1 - cosine) / 2), the sine of half the angle.
    HalfSineTable {
        /// At least 2.
        nodes: usize,
    },
    /// Any basis by the papers' cube maps, bilinear between texel centres.
    CubeMap {
        /// Texels along an edge of a face, at least 1.
        size: usize,
    },
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exact => write!(f, "formulas"),
            Self::Fine => write!(f, "short polynomials"),
            Self::Coarse => write!(f, "powers of cubics"),
            Self::CosineTable { nodes } => write!(f, "table of {nodes} over the cosine"),
            Self::HalfSineTable { nodes } => write!(f, "table of {nodes} over the half-angle's sine"),
            Self::CubeMap { size } => write!(f, "cube maps of {size} x {size}"),
        }
    }
}

impl Path {
    /// The cheapest that errs by no more than `accuracy`.
    ///
    /// Polynomials in vector registers are cheaper than any table (docs/accuracy.md), so what an error buys
    /// is their length, where Gaussians are narrow enough for them. PTM, SH and HSH have none to shorten.
    pub fn of_accuracy(basis: &Basis, accuracy: Accuracy) -> Self {
        match (basis, accuracy) {
            (Basis::Srbf(srbf), Accuracy::Coarse) if srbf.spread() <= NARROW => Self::Coarse,
            (Basis::Srbf(srbf), Accuracy::Fine) if srbf.spread() <= NARROW => Self::Fine,
            _ => Self::Exact,
        }
    }

    /// Nodes of the papers' table over the cosine that err by no more than `error` between them:
    /// 2 / (spread^2 sqrt(8 error)).
    ///
    /// Source: MATH.md section 1.2: linear interpolation errs by h^2 / 8 R'', and R''(1) ~ 1 / spread^4.
    pub fn cosine_nodes(spread: f64, error: f64) -> usize {
        (2.0 / (spread * spread * (8.0 * error).sqrt())).ceil().clamp(2.0, 1e6) as usize
    }

    /// Nodes of the table over the half-angle's sine u: R = exp(-2 asin(u)^2 / spread^2) bends most at
    /// u = 0, by 4 / spread^2.
    pub fn half_sine_nodes(spread: f64, error: f64) -> usize {
        (2.0 / spread / (8.0 * error).sqrt()).ceil().clamp(2.0, 1e6) as usize + 1
    }
}

/// Unit vectors of a run of pixels, towards the light.
#[derive(Clone, Copy, Debug)]
pub struct Directions<'a> {
    /// To the right.
    pub x: &'a [f32],
    /// Upwards.
    pub y: &'a [f32],
    /// Out of the picture.
    pub z: &'a [f32],
}

/// A basis made ready for one way of evaluation.
#[derive(Clone, Debug)]
pub struct Evaluator {
    count: usize,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Srbf { centres: Vec<[f32; 3]>, spread: f64, kernel: Kernel, accuracy: Accuracy, power: Power },
    Table { centres: Vec<[f32; 3]>, table: Table },
    CubeMaps(CubeMaps),
    SquareTable(SquareTable),
    Ptm,
    Sh(harmonics::Recursion),
    Hsh,
}

/// A path that a basis doesn't have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoSuchPath {
    /// The path.
    pub path: Path,
    /// The basis' family.
    pub family: &'static str,
}

impl fmt::Display for NoSuchPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "functions of {} can't be evaluated by a {}; tables are for srbf", self.family, self.path)
    }
}

impl std::error::Error for NoSuchPath {}

impl Evaluator {
    /// Prepares `basis` for `path`.
    ///
    /// # Errors
    /// [`NoSuchPath`] for tables of anything but SRBF.
    pub fn new(basis: &Basis, path: Path) -> Result<Self, NoSuchPath> {
        let kind = match (basis, path) {
            (_, Path::CubeMap { size }) => Kind::CubeMaps(CubeMaps::new(basis, size)),
            (Basis::Srbf(srbf), Path::CosineTable { nodes }) => Kind::Table {
                centres: centres_of(srbf),
                table: Table::new(srbf.spread(), srbf.kernel(), Argument::Cosine, nodes),
            },
            (Basis::Srbf(srbf), Path::HalfSineTable { nodes }) => Kind::Table {
                centres: centres_of(srbf),
                table: Table::new(srbf.spread(), srbf.kernel(), Argument::HalfSine, nodes),
            },
            (_, Path::CosineTable { .. } | Path::HalfSineTable { .. }) => {
                return Err(NoSuchPath { path, family: basis.family().name });
            }
            (Basis::Srbf(srbf), Path::Exact | Path::Fine | Path::Coarse) => Kind::Srbf {
                centres: centres_of(srbf),
                spread: srbf.spread(),
                kernel: srbf.kernel(),
                power: Power::new(srbf.kernel(), srbf.spread()),
                accuracy: match path {
                    Path::Coarse if srbf.spread() <= NARROW => Accuracy::Coarse,
                    Path::Fine if srbf.spread() <= NARROW => Accuracy::Fine,
                    _ => Accuracy::Exact,
                },
            },
            (Basis::Ptm(_), _) => Kind::Ptm,
            (Basis::Sh(sh), _) => Kind::Sh(harmonics::Recursion::new(usize::from(sh.order()))),
            (Basis::Hsh(_), _) => Kind::Hsh,
            (Basis::Learned(learned), _) => Kind::SquareTable(SquareTable::new(learned)),
        };
        Ok(Self { count: basis.count(), kind })
    }

    /// k, the number of functions.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Writes b_j of direction i to `weights[j * n + i]`, n the number of directions.
    ///
    /// # Panics
    /// When `weights` is shorter than that.
    pub fn evaluate(&self, level: CpuLevel, directions: Directions<'_>, weights: &mut [f32]) {
        let Directions { x, y, z } = directions;
        let n = x.len();
        assert!(y.len() == n && z.len() == n && weights.len() >= self.count * n, "shapes of directions");
        if n == 0 {
            return;
        }
        let rows = &mut weights[..self.count * n];
        match &self.kind {
            &Kind::Srbf { ref centres, spread, kernel, accuracy, power } => {
                let squared = spread * spread;
                let factor = match kernel {
                    Kernel::Geodesic => -0.5 / squared,
                    Kernel::Spherical => -2.0 / squared,
                };
                let exponent = exponent_of(kernel, factor);
                for (&centre, row) in centres.iter().zip(rows.chunks_exact_mut(n)) {
                    let to = To { directions, centre, row };
                    let factor = factor as f32;
                    match (kernel, accuracy) {
                        (Kernel::Geodesic, Accuracy::Exact) if spread > WIDE => {
                            level.run(Gaussian::<true, true> { to, factor });
                        }
                        (Kernel::Geodesic, Accuracy::Exact) => {
                            level.run(Gaussian::<false, true> { to, factor })
                        }
                        (Kernel::Spherical, Accuracy::Exact) => {
                            level.run(Gaussian::<false, false> { to, factor })
                        }
                        (_, Accuracy::Fine) => level.run(ShortGaussian { to, exponent }),
                        (_, Accuracy::Coarse) => level.run(PowerGaussian { to, power }),
                    }
                }
            }
            Kind::Table { centres, table } => {
                for (centre, row) in centres.iter().zip(rows.chunks_exact_mut(n)) {
                    table.evaluate(level, directions, *centre, row);
                }
            }
            Kind::CubeMaps(maps) => maps.evaluate(directions, rows),
            Kind::SquareTable(table) => table.evaluate(directions, rows),
            Kind::Ptm => level.run(harmonics::Monomials { directions, rows, count: self.count }),
            Kind::Sh(recursion) => recursion.evaluate(level, directions, rows),
            Kind::Hsh => level.run(harmonics::Hemispherical { directions, rows, count: self.count }),
        }
    }
}

fn centres_of(srbf: &Srbf) -> Vec<[f32; 3]> {
    srbf.centres().iter().map(|centre| centre.components().map(|c| c as f32)).collect()
}

/// Gaussians wider than this are not negligible opposite to their centre, where 1 - s has lost the angle's
/// digits.
const WIDE: f64 = 0.5;

/// The exponent of 2 of a Gaussian, a polynomial in the squared sine of half the angle from the first power on.
fn exponent_of(kernel: Kernel, factor: f64) -> [f32; 5] {
    let coefficients: &[f64] = match kernel {
        Kernel::Spherical => &[1.0],
        Kernel::Geodesic => &FINE_SQUARED_ANGLE,
    };
    let mut exponent = [0.0; 5];
    for (to, from) in exponent.iter_mut().zip(coefficients) {
        *to = (from * factor * std::f64::consts::LOG2_E) as f32;
    }
    exponent
}

/// A Gaussian as the eighth power of a cubic in u, the squared sine of half the angle over that at which the
/// Gaussian has fallen to [`Power::LEAST`]; beyond that it stays where it is. Within 2e-4 of it up to a spread
/// of [`NARROW`].
///
/// An eighth root falls to no less than a third over all that range, which is why a cubic follows it; three
/// squarings cost less than what an exponential of the same error does.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Power {
    /// One over the squared sine at which u is 1.
    scale: f64,
    /// From the constant on.
    cubic: [f32; 4],
}

impl Power {
    /// What is left of a Gaussian where it is no longer followed.
    const LEAST: f64 = 1e-4;

    /// Share of the range of u over which the cubic interpolates the root: an error near the peak counts eightfold,
    /// one beyond hardly. Its errors are the least over all spreads.
    const SHARE: f64 = 0.46;

    fn new(kernel: Kernel, spread: f64) -> Self {
        // Squared angles (or what stands for them) in units of twice the spread's square.
        let farthest = -libm::log(Self::LEAST);
        let units = 2.0 * spread * spread;
        let end = match kernel {
            Kernel::Geodesic => {
                let sine = libm::sin((0.5 * (farthest * units).sqrt()).min(std::f64::consts::FRAC_PI_2));
                sine * sine
            }
            Kernel::Spherical => (0.25 * farthest * units).min(1.0),
        };
        let root = |u: f64| {
            let sine2 = u * end;
            let squared = match kernel {
                Kernel::Geodesic => {
                    let angle = 2.0 * libm::asin(sine2.sqrt());
                    angle * angle
                }
                Kernel::Spherical => 4.0 * sine2,
            };
            libm::exp(-squared / units / 8.0)
        };
        // Newton's form on Chebyshev's nodes, expanded.
        let nodes = [0, 1, 2, 3].map(|i| {
            let angle = std::f64::consts::PI * (2 * i + 1) as f64 / 8.0;
            Self::SHARE * 0.5 * (1.0 - libm::cos(angle))
        });
        let mut differences = nodes.map(root);
        for order in 1..4 {
            for i in (order..4).rev() {
                differences[i] = (differences[i] - differences[i - 1]) / (nodes[i] - nodes[i - order]);
            }
        }
        let mut cubic = [0.0; 4];
        for i in (0..4).rev() {
            // cubic = cubic (u - node) + difference.
            for power in (0..4).rev() {
                let below = if power > 0 { cubic[power - 1] } else { differences[i] };
                cubic[power] = below - nodes[i] * cubic[power];
            }
        }
        Self { scale: 1.0 / end, cubic: cubic.map(|c| c as f32) }
    }
}

/// A centre and where its function goes.
struct To<'a> {
    directions: Directions<'a>,
    centre: [f32; 3],
    row: &'a mut [f32],
}

impl To<'_> {
    /// Writes what `of` makes of x, y and z.
    #[inline(always)]
    fn fill(self, of: impl LaneFunction) {
        let Self { directions: Directions { x, y, z }, row, .. } = self;
        let n = row.len();
        let whole = n / LANES * LANES;
        let mut first = 0;
        while first < whole {
            let lanes = first..first + LANES;
            if let (Some(x), Some(y), Some(z), Some(row)) = (
                x[lanes.clone()].first_chunk(),
                y[lanes.clone()].first_chunk(),
                z[lanes.clone()].first_chunk(),
                row[lanes].first_chunk_mut(),
            ) {
                *row = of.value(x, y, z);
            }
            first += LANES;
        }
        if whole < n {
            let (mut a, mut b, mut c) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            a[..n - whole].copy_from_slice(&x[whole..n]);
            b[..n - whole].copy_from_slice(&y[whole..n]);
            c[..n - whole].copy_from_slice(&z[whole..n]);
            let values = of.value(&a, &b, &c);
            row[whole..].copy_from_slice(&values[..n - whole]);
        }
    }
}

/// A function of direction. A trait rather than a closure: its function is inlined into what is compiled for a CPU
/// level, which a closure need not be.
trait LaneFunction {
    fn value(&self, x: &Lanes, y: &Lanes, z: &Lanes) -> Lanes;
}

/// exp(factor x squared angle), or of four times the squared sine of its half where not `GEODESIC`.
///
/// From the difference of the two unit vectors (and, where `BOTH`, from their sum) rather than from their
/// dot product, which near 1 and -1 has lost half the digits of the angle.
struct Gaussian<'a, const BOTH: bool, const GEODESIC: bool> {
    to: To<'a>,
    factor: f32,
}

struct ExactShape<const BOTH: bool, const GEODESIC: bool> {
    centre: [f32; 3],
    factor: f32,
}

impl<const BOTH: bool, const GEODESIC: bool> Vectorized for Gaussian<'_, BOTH, GEODESIC> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let shape = ExactShape::<BOTH, GEODESIC> { centre: self.to.centre, factor: self.factor };
        self.to.fill(shape);
    }
}

impl<const BOTH: bool, const GEODESIC: bool> LaneFunction for ExactShape<BOTH, GEODESIC> {
    #[inline(always)]
    fn value(&self, x: &Lanes, y: &Lanes, z: &Lanes) -> Lanes {
        let ([a, b, c], factor) = (self.centre, self.factor);
        let (dx, dy, dz) = (lanes!(|i| x[i] - a), lanes!(|i| y[i] - b), lanes!(|i| z[i] - c));
        let sine2 = lanes!(|i| dx[i] * dx[i] + dy[i] * dy[i] + dz[i] * dz[i]);
        let sine2 = lanes!(|i| (0.25 * sine2[i]).min(1.0));
        if !GEODESIC {
            return exp(&lanes!(|i| factor * sine2[i]));
        }
        let cosine2 = if BOTH {
            let (dx, dy, dz) = (lanes!(|i| x[i] + a), lanes!(|i| y[i] + b), lanes!(|i| z[i] + c));
            let cosine2 = lanes!(|i| dx[i] * dx[i] + dy[i] * dy[i] + dz[i] * dz[i]);
            lanes!(|i| (0.25 * cosine2[i]).min(1.0))
        } else {
            lanes!(|i| 1.0 - sine2[i])
        };
        let squared = squared_angle(&sine2, &cosine2);
        exp(&lanes!(|i| factor * squared[i]))
    }
}

/// 2 to a polynomial in the squared sine of half the angle, which the dot product gives to 6e-8: as short as 1e-4
/// allows.
struct ShortGaussian<'a> {
    to: To<'a>,
    exponent: [f32; 5],
}

struct ShortShape {
    centre: [f32; 3],
    exponent: [f32; 5],
}

impl Vectorized for ShortGaussian<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let shape = ShortShape { centre: self.to.centre, exponent: self.exponent };
        self.to.fill(shape);
    }
}

impl LaneFunction for ShortShape {
    #[inline(always)]
    fn value(&self, x: &Lanes, y: &Lanes, z: &Lanes) -> Lanes {
        let s = half_sine2(self.centre, 1.0, [x, y, z]);
        let [e1, e2, e3, e4, e5] = self.exponent;
        let p = lanes!(|i| e5 * s[i] + e4);
        let p = lanes!(|i| p[i] * s[i] + e3);
        let p = lanes!(|i| p[i] * s[i] + e2);
        let p = lanes!(|i| p[i] * s[i] + e1);
        fine_exp2(&lanes!(|i| p[i] * s[i]))
    }
}

/// `scale` x the squared sine of half the angle between unit vectors.
#[inline(always)]
fn half_sine2(centre: [f32; 3], scale: f32, [x, y, z]: [&Lanes; 3]) -> Lanes {
    let half = 0.5 * scale;
    let [a, b, c] = [-half * centre[0], -half * centre[1], -half * centre[2]];
    let s = lanes!(|i| x[i] * a + half);
    let s = lanes!(|i| s[i] + y[i] * b);
    lanes!(|i| s[i] + z[i] * c)
}

/// [`Power`] at each direction.
struct PowerGaussian<'a> {
    to: To<'a>,
    power: Power,
}

struct PowerShape {
    centre: [f32; 3],
    scale: f32,
    cubic: [f32; 4],
}

impl Vectorized for PowerGaussian<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Power { scale, cubic } = self.power;
        let shape = PowerShape { centre: self.to.centre, scale: scale as f32, cubic };
        self.to.fill(shape);
    }
}

impl LaneFunction for PowerShape {
    #[inline(always)]
    fn value(&self, x: &Lanes, y: &Lanes, z: &Lanes) -> Lanes {
        let u = half_sine2(self.centre, self.scale, [x, y, z]);
        let u = lanes!(|i| if u[i] < 1.0 { u[i] } else { 1.0 });
        let [c0, c1, c2, c3] = self.cubic;
        let root = lanes!(|i| c3 * u[i] + c2);
        let root = lanes!(|i| root[i] * u[i] + c1);
        let root = lanes!(|i| root[i] * u[i] + c0);
        let square = lanes!(|i| root[i] * root[i]);
        let fourth = lanes!(|i| square[i] * square[i]);
        lanes!(|i| fourth[i] * fourth[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_follow_gaussians_of_all_narrow_spreads() {
        for kernel in [Kernel::Geodesic, Kernel::Spherical] {
            for spread in (5..=60).map(|percent| 0.01 * f64::from(percent)) {
                let shape = Power::new(kernel, spread);
                let shape =
                    PowerShape { centre: [0.0, 0.0, 1.0], scale: shape.scale as f32, cubic: shape.cubic };
                for i in 0..=3_142 {
                    let angle = 1e-3 * f64::from(i);
                    let (sin, cos) = libm::sincos(angle);
                    let [x, z] = [sin, cos].map(|c| [c as f32; LANES]);
                    let found = shape.value(&x, &[0.0; LANES], &z)[9];
                    let squared = match kernel {
                        Kernel::Geodesic => angle * angle,
                        Kernel::Spherical => 2.0 - 2.0 * cos,
                    };
                    let exact = libm::exp(-squared / (2.0 * spread * spread));
                    let error = (f64::from(found) - exact).abs();
                    assert!(error < 2e-4, "{kernel:?} of {spread} at {angle}: {found} for {exact}");
                }
            }
        }
    }
}
