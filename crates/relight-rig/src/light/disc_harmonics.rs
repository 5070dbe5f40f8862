//! Harmonics of discs.
//!
//! A near disc is integrated along its rim: Y_lm is an eigenfunction of the sphere's Laplacian, so that its integral over a
//! region is that of its slope across the border, by -1 / (l (l + 1)), and the slope of that integral as the point moves is
//! the integral of Y_lm itself along the border, by how fast the border moves. Both are smooth but where the rim is near,
//! and there panels get shorter. A far disc is a sum over its area, where borders would cancel.
//! Derived for this program; checked against golden values and sums over the area.

use super::disc::View;
use super::harmonics::{MOST_FUNCTIONS, SLOPES, Zonal, harmonics};
use super::quadrature::{Node, gauss_legendre};
use relight_core::vectors::{dot, length, scaled};
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Distance in radii from which the area is summed.
const FAR: f64 = 16.0;

/// Nodes of a panel of the rim: relative errors below 1e-14.
const PANEL: usize = 14;

/// Nodes of the area along and around: errors fall as (1 / distance)^12.
const AROUND: usize = 14;

static ALONG_RIM: LazyLock<[Node; PANEL]> = LazyLock::new(gauss_legendre);
static OUTWARDS: LazyLock<[Node; 4]> = LazyLock::new(gauss_legendre);

/// Coefficients of a disc of radiance 1, and their slopes along x, y and z times its radius.
#[derive(Clone, Copy)]
pub(super) struct Projection {
    pub(super) values: [f64; MOST_FUNCTIONS],
    pub(super) slopes: [[f64; 3]; MOST_FUNCTIONS],
}

impl Projection {
    /// 0 in the disc's plane and behind.
    pub(super) const NONE: Self = Self { values: [0.0; MOST_FUNCTIONS], slopes: [[0.0; 3]; MOST_FUNCTIONS] };

    /// Of `bands` bands, within 1e-12 of the largest.
    pub(super) fn new(view: &View, bands: usize) -> Self {
        if view.distance() > FAR { Self::by_area(view, bands) } else { Self::by_rim(view, bands) }
    }

    fn by_rim(view: &View, bands: usize) -> Self {
        let (h, a) = (view.height, view.offset);
        let mut functions = [0.0; MOST_FUNCTIONS];
        let mut solid_angle = 0.0;
        // The integral of Y_lm times the normal of the strip that rim and point span.
        let mut sums = [[0.0; 3]; MOST_FUNCTIONS];
        let mut projection = Self::NONE;
        let count = bands * bands;
        for_each_rim_node(view, |angle, weight| {
            let (sin, cos) = libm::sincos(angle);
            let rim = in_scene(view, [a + cos, sin, h]);
            let d = length([a + cos, sin, h]);
            let strip = [-h * cos, -h * sin, a * cos + 1.0];
            solid_angle += weight * strip[2] / (d * (d + h));
            let strip = scaled(in_scene(view, strip), weight / (d * d));
            harmonics(bands, rim, &mut functions);
            for i in 0..count {
                for axis in 0..3 {
                    sums[i][axis] += functions[i] * strip[axis];
                    projection.slopes[i][axis] += functions[i] * strip[axis] / d;
                }
            }
        });
        projection.values[0] = (0.25 / PI).sqrt() * solid_angle;
        for (axis, slopes) in SLOPES.iter().enumerate() {
            for slope in slopes.iter().filter(|slope| slope.of < count) {
                let l = slope.of.isqrt();
                projection.values[slope.of] += slope.factor * sums[slope.from][axis] / (l * (l + 1)) as f64;
            }
        }
        projection
    }

    fn by_area(view: &View, bands: usize) -> Self {
        let mut projection = Self::NONE;
        let mut functions = [0.0; MOST_FUNCTIONS];
        // Intensity falls with the square of the distance, and with the cosine at the disc: height / distance.
        let mut zonal = Zonal { values: [0.0; 6], slopes: [0.0; 6] };
        let mut values = vec![[0.0; 3]; bands * bands];
        let mut slopes = vec![[[0.0; 3]; 3]; bands * bands];
        for (node, share) in OUTWARDS.iter() {
            for spoke in 0..AROUND {
                let (sin, cos) = libm::sincos(2.0 * PI * (spoke as f64 + 0.5) / AROUND as f64);
                let radius = node.sqrt();
                let place = [view.offset + radius * cos, radius * sin, view.height];
                let d = length(place);
                harmonics(bands + 1, in_scene(view, place), &mut functions);
                // Not d^3: far away it overflows, or its inverse underflows.
                let area = PI * share / AROUND as f64 / d / d;
                let weight = area * (view.height / d);
                zonal.values = [weight; 6];
                zonal.slopes = [3.0 * weight; 6];
                zonal.add(&functions, [1.0; 3], &mut values);
                zonal.add_gradient(&functions, [1.0 / d; 3], &mut slopes);
                for (slope, function) in projection.slopes.iter_mut().zip(&functions[..bands * bands]) {
                    // The height falls as the point moves towards the disc.
                    for (slope, towards) in slope.iter_mut().zip(view.axes[2]) {
                        *slope -= towards * area / d * function;
                    }
                }
            }
        }
        for (i, (value, slopes)) in values.iter().zip(&slopes).enumerate() {
            projection.values[i] = value[0];
            projection.slopes[i] = [0, 1, 2].map(|axis| projection.slopes[i][axis] + slopes[axis][0]);
        }
        projection
    }
}

/// A vector of the disc's axes in the scene's.
fn in_scene(view: &View, v: [f64; 3]) -> [f64; 3] {
    let axes = &view.axes;
    [0, 1, 2].map(|i| dot(v, [axes[0][i], axes[1][i], axes[2][i]]))
}

/// Angles all around with their weights, the closer to each other the nearer the rim.
fn for_each_rim_node(view: &View, mut node: impl FnMut(f64, f64)) {
    // The nearest point of the rim is at pi. Panels from there on double while they are longer than its distance.
    let nearest = view.nearest2().sqrt().max(1e-14);
    let mut end = PI;
    while end > 0.0 {
        let start = if end < nearest.min(1.0) { 0.0 } else { 0.5 * end };
        for &(place, weight) in ALONG_RIM.iter() {
            let from_nearest = start + (end - start) * place;
            for angle in [PI - from_nearest, PI + from_nearest] {
                node(angle, weight * (end - start));
            }
        }
        end = start;
    }
}
