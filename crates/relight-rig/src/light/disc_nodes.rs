//! Discs as sums over their area, side by side in f32.

use super::harmonics::MOST_BANDS;
use super::lanes::{LANES, Lanes, RECURSION, three};
use super::projector::{Totals, lane_sum};
use super::quadrature::{Node, gauss_legendre};
use super::{Light, Source};
use relight_core::vectors::{difference, dot, frame_around, length};
use relight_core::{CpuLevel, Vectorized};
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Nodes of a disc of radius 1.
pub(super) struct Rule {
    /// Least distance of the middle in radii for errors below 1e-4 of the largest coefficient of 7 bands.
    pub(super) nearest: f64,
    /// The same for slopes.
    nearest_for_slopes: f64,
    count: usize,
    /// x, y, and share of the area; the last ones may have none.
    nodes: Vec<[Lanes; 3]>,
}

impl Rule {
    /// `rings` in the squared radius, a node at the middle and `spokes` of all others; turned from ring to ring.
    fn new(rings: &[Node], spokes: usize, [nearest, nearest_for_slopes]: [f64; 2]) -> Self {
        let mut places = Vec::new();
        for (ring, &(node, weight)) in rings.iter().enumerate() {
            let spokes = if node > 0.0 { spokes } else { 1 };
            for spoke in 0..spokes {
                let turn = (spoke as f64 + 0.5 * (ring % 2) as f64) / spokes as f64;
                let (sin, cos) = libm::sincos(2.0 * PI * turn);
                places.push([node.sqrt() * cos, node.sqrt() * sin, weight / spokes as f64]);
            }
        }
        let mut nodes = vec![[[0.0; LANES]; 3]; places.len().div_ceil(LANES)];
        for (at, place) in places.iter().enumerate() {
            for (row, &value) in nodes[at / LANES].iter_mut().zip(place) {
                row[at % LANES] = value as f32;
            }
        }
        Self { nearest, nearest_for_slopes, count: places.len(), nodes }
    }

    /// x, y and share of the area, a node after the other.
    #[inline(always)]
    pub(super) fn places(&self) -> impl Iterator<Item = [f32; 3]> {
        let places = self.nodes.iter().flat_map(|[x, y, share]| (0..LANES).map(|i| [x[i], y[i], share[i]]));
        places.take(self.count)
    }
}

/// How many [`RULES`] there are.
pub(super) const RULE_COUNT: usize = 7;

/// From few nodes to many.
pub(super) static RULES: LazyLock<[Rule; RULE_COUNT]> = LazyLock::new(|| {
    // Radau's nodes have one at the middle.
    let root = 6.0f64.sqrt();
    let two = [(0.0, 0.25), (2.0 / 3.0, 0.75)];
    let three = [
        (0.0, 1.0 / 9.0),
        (0.1 * (6.0 - root), (16.0 + root) / 36.0),
        (0.1 * (6.0 + root), (16.0 - root) / 36.0),
    ];
    [
        Rule::new(&[(0.5, 1.0)], 7, [15.2, 17.5]),
        Rule::new(&two, 7, [6.5, 7.1]),
        Rule::new(&gauss_legendre::<2>(), 10, [4.0, 4.35]),
        Rule::new(&three, 14, [2.85, 3.05]),
        Rule::new(&gauss_legendre::<3>(), 16, [2.55, 2.8]),
        Rule::new(&gauss_legendre::<4>(), 20, [2.13, 2.35]),
        Rule::new(&gauss_legendre::<8>(), 32, [1.62, 1.62]),
    ]
});

/// A disc and what it takes to sum over it.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    light: Light,
    centre: [f64; 3],
    pub(super) normal: [f64; 3],
    pub(super) radius: f64,
    /// Axes of unit length.
    pub(super) across: [[f64; 3]; 2],
    /// The middle from the ball's middle.
    pub(super) position: [f64; 3],
    /// Units in a length of the scene, a power of two.
    pub(super) unit: f64,
    /// Radiance times area, in its own units.
    pub(super) brightness: [f64; 3],
}

impl Disc {
    /// For points around `middle`.
    pub(super) fn new(
        centre: [f64; 3],
        normal: [f64; 3],
        radius: f64,
        color: [f64; 3],
        middle: [f64; 3],
    ) -> Self {
        let light = Light { name: String::new(), source: Source::Disc { centre, normal, radius }, color };
        let position = difference(centre, middle);
        let (_, exponent) = libm::frexp(length(position));
        let unit = libm::ldexp(1.0, -exponent.clamp(-1000, 1000));
        let size = radius * unit;
        let brightness = color.map(|c| c * (PI * size * size));
        Self { light, centre, normal, radius, across: frame_around(normal), position, unit, brightness }
    }

    /// Adds what a point sees of it: to `totals`, or to values and slopes themselves.
    pub(super) fn add<const GRADIENT: bool>(
        &self,
        level: CpuLevel,
        bands: usize,
        point: [f64; 3],
        totals: &mut Totals,
        values: &mut [[f64; 3]],
        gradients: &mut [[[f64; 3]; 3]],
    ) {
        let towards = difference(self.centre, point);
        let (distance, height) = (length(towards), -dot(towards, self.normal));
        if height.is_nan() || height <= 0.0 {
            return;
        }
        let nearest = |rule: &Rule| if GRADIENT { rule.nearest_for_slopes } else { rule.nearest };
        let Some(rule) = RULES.iter().find(|rule| distance >= nearest(rule) * self.radius) else {
            return if GRADIENT {
                self.light.add_projection_with_gradient(point, bands, values, gradients);
            } else {
                self.light.add_projection(point, bands, values);
            };
        };
        let size = self.radius / distance;
        let sums = level.run(Nodes::<GRADIENT> {
            bands,
            rule,
            towards: towards.map(|c| (c / distance) as f32),
            across: self.across.map(|axis| axis.map(|c| (c * size) as f32)),
        });
        // Radiance by the area's solid angle where it faces the point; its cosine is the height over the distance.
        let color = self.light.color.map(|c| c * PI * size * size);
        let facing = color.map(|c| c * (height / distance));
        for (total, value) in totals.values.iter_mut().zip(sums.values).take(bands * bands) {
            *total = [0, 1, 2].map(|c| total[c] + facing[c] * value);
        }
        if GRADIENT {
            for (gradient, value) in gradients.iter_mut().zip(sums.values) {
                for (gradient, axis) in gradient.iter_mut().zip(self.normal) {
                    *gradient = [0, 1, 2].map(|c| gradient[c] + color[c] * (axis / distance * value));
                }
            }
            // 1 / distance^3 and its slope, as `Zonal::add_gradient` has them.
            for i in 0..(bands + 1) * (bands + 1) {
                let (l, sum) = (i.isqrt() as f64, sums.slopes[i] / distance);
                if i > 0 {
                    let above = (3.0 + (l - 1.0)) * sum;
                    totals.above[i] = [0, 1, 2].map(|c| totals.above[i][c] + facing[c] * above);
                }
                if i < (bands - 1) * (bands - 1) {
                    let below = (3.0 - (l + 2.0)) / (2.0 * l + 3.0) * sum;
                    totals.below[i] = [0, 1, 2].map(|c| totals.below[i][c] + facing[c] * below);
                }
            }
        }
    }
}

const MOST: usize = (MOST_BANDS + 1) * (MOST_BANDS + 1);

/// Sums over the nodes of Y_lm by share of the area, in units of the middle's distance.
struct Sums {
    /// Over distance^3.
    values: [f64; MOST],
    /// Over distance^4.
    slopes: [f64; MOST],
}

struct Nodes<'a, const GRADIENT: bool> {
    bands: usize,
    rule: &'a Rule,
    towards: [f32; 3],
    across: [[f32; 3]; 2],
}

impl<const GRADIENT: bool> Vectorized for Nodes<'_, GRADIENT> {
    type Output = Sums;

    #[inline(always)]
    fn run(self) -> Sums {
        match self.bands {
            1 => self.sum::<1, 1, 4>(),
            2 => self.sum::<2, 4, 9>(),
            3 => self.sum::<3, 9, 16>(),
            4 => self.sum::<4, 16, 25>(),
            5 => self.sum::<5, 25, 36>(),
            6 => self.sum::<6, 36, 49>(),
            _ => self.sum::<7, 49, MOST>(),
        }
    }
}

impl<const GRADIENT: bool> Nodes<'_, GRADIENT> {
    /// `N` and `UP` are the squares of `BANDS` and of one more.
    #[inline(always)]
    fn sum<const BANDS: usize, const N: usize, const UP: usize>(self) -> Sums {
        let mut functions = [[0.0f32; LANES]; UP];
        let (mut values, mut slopes) = ([[0.0f32; LANES]; N], [[0.0f32; LANES]; UP]);
        let [a, b] = &self.across;
        for [u, v, share] in &self.rule.nodes {
            let mut direction = [[0.0f32; LANES]; 3];
            let (mut cubic, mut quartic) = ([0.0f32; LANES], [0.0f32; LANES]);
            for i in 0..LANES {
                let [x, y, z] = three!(|axis| self.towards[axis] + (u[i] * a[axis] + v[i] * b[axis]));
                let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
                direction[0][i] = x * inverse;
                direction[1][i] = y * inverse;
                direction[2][i] = z * inverse;
                cubic[i] = share[i] * inverse * (inverse * inverse);
                quartic[i] = cubic[i] * inverse;
            }
            RECURSION.evaluate(if GRADIENT { BANDS + 1 } else { BANDS }, &direction, &mut functions);
            for (sum, function) in values.iter_mut().zip(&functions) {
                for i in 0..LANES {
                    sum[i] += cubic[i] * function[i];
                }
            }
            if GRADIENT {
                for (sum, function) in slopes.iter_mut().zip(&functions) {
                    for i in 0..LANES {
                        sum[i] += quartic[i] * function[i];
                    }
                }
            }
        }
        let mut sums = Sums { values: [0.0; MOST], slopes: [0.0; MOST] };
        for (sum, lanes) in sums.values.iter_mut().zip(&values) {
            *sum = lane_sum(lanes);
        }
        if GRADIENT {
            for (sum, lanes) in sums.slopes.iter_mut().zip(&slopes) {
                *sum = lane_sum(lanes);
            }
        }
        sums
    }
}
