//! Discs as sums over their area, side by side in f32.

use super::harmonics::MOST_BANDS;
use super::lanes::{LANES, Lanes, RECURSION, lanes};
use super::projector::{Totals, lane_sum};
use super::quadrature::gauss_legendre;
use super::{Light, Source};
use relight_core::vectors::{difference, dot, frame_around, length};
use relight_core::{CpuLevel, Vectorized};
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Nodes of a disc of radius 1.
struct Rule {
    /// Least distance of the middle in radii for errors below 1e-4 of the largest coefficient or slope of 6 bands.
    nearest: f64,
    /// x, y, and share of the area.
    nodes: Vec<[Lanes; 3]>,
}

impl Rule {
    /// Gauss's nodes in the squared radius by equal steps around; turned from ring to ring.
    fn new<const RINGS: usize>(nearest: f64, spokes: usize) -> Self {
        let mut nodes = vec![[[0.0; LANES]; 3]; RINGS * spokes / LANES];
        for (ring, (node, weight)) in gauss_legendre::<RINGS>().into_iter().enumerate() {
            for spoke in 0..spokes {
                let turn = (spoke as f64 + 0.5 * (ring % 2) as f64) / spokes as f64;
                let (sin, cos) = libm::sincos(2.0 * PI * turn);
                let at = ring * spokes + spoke;
                let values = [node.sqrt() * cos, node.sqrt() * sin, weight / spokes as f64];
                for (row, value) in nodes[at / LANES].iter_mut().zip(values) {
                    row[at % LANES] = value as f32;
                }
            }
        }
        Self { nearest, nodes }
    }
}

/// From few nodes to many.
static RULES: LazyLock<[Rule; 4]> = LazyLock::new(|| {
    [Rule::new::<2>(9.0, 8), Rule::new::<3>(4.0, 16), Rule::new::<6>(2.0, 24), Rule::new::<8>(1.5, 32)]
});

/// A disc and what it takes to sum over it.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    light: Light,
    centre: [f64; 3],
    normal: [f64; 3],
    radius: f64,
    across: [[f64; 3]; 2],
}

impl Disc {
    pub(super) fn new(centre: [f64; 3], normal: [f64; 3], radius: f64, color: [f64; 3]) -> Self {
        let light = Light { name: String::new(), source: Source::Disc { centre, normal, radius }, color };
        Self { light, centre, normal, radius, across: frame_around(normal) }
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
        let Some(rule) = RULES.iter().find(|rule| distance >= rule.nearest * self.radius) else {
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
        let bands = if GRADIENT { self.bands + 1 } else { self.bands };
        let mut functions = [[0.0f32; LANES]; MOST];
        let (mut values, mut slopes) = ([[0.0f32; LANES]; MOST], [[0.0f32; LANES]; MOST]);
        for [u, v, share] in &self.rule.nodes {
            let [a, b] = &self.across;
            let towards =
                [0, 1, 2].map(|axis| lanes!(|i| self.towards[axis] + (u[i] * a[axis] + v[i] * b[axis])));
            let [x, y, z] = &towards;
            let inverse = lanes!(|i| 1.0 / (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt());
            let [x, y, z] = &towards.map(|t| lanes!(|i| t[i] * inverse[i]));
            RECURSION.evaluate(bands, [x, y, z], &mut functions);
            let weight = lanes!(|i| share[i] * inverse[i] * (inverse[i] * inverse[i]));
            for (sum, function) in values.iter_mut().zip(&functions).take(self.bands * self.bands) {
                *sum = lanes!(|i| sum[i] + weight[i] * function[i]);
            }
            if GRADIENT {
                let weight = lanes!(|i| weight[i] * inverse[i]);
                for (sum, function) in slopes.iter_mut().zip(&functions).take(bands * bands) {
                    *sum = lanes!(|i| sum[i] + weight[i] * function[i]);
                }
            }
        }
        let sum = |lanes: &[Lanes; MOST], count: usize| {
            let mut sums = [0.0; MOST];
            for (sum, lanes) in sums.iter_mut().zip(lanes).take(count) {
                *sum = lane_sum(lanes);
            }
            sums
        };
        Sums { values: sum(&values, self.bands * self.bands), slopes: sum(&slopes, bands * bands) }
    }
}
