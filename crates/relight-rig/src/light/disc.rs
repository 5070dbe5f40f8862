//! Discs that shine on one side: vector irradiance, and irradiance clipped by the receiver's horizon, both in closed form.

use super::quadrature::{Node, gauss_legendre};
use relight_core::vectors::{cross, difference, dot, frame_around, length, scaled};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

/// A disc as a point before it sees it, in units of its radius and in axes of its own.
///
/// The rim is `offset x + height z + cos(angle) x + sin(angle) y`.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// x away from the foot of the perpendicular through the point, towards the middle; z from the point towards the disc.
    pub(super) axes: [[f64; 3]; 3],
    /// Distance of the disc's plane, above 0.
    pub(super) height: f64,
    /// Distance of the middle from the foot, 0 or more.
    pub(super) offset: f64,
}

impl View {
    /// `None` from the plane of the disc and from behind.
    pub(super) fn new(centre: [f64; 3], normal: [f64; 3], radius: f64, point: [f64; 3]) -> Option<Self> {
        let middle = difference(centre, point).map(|c| c / radius);
        let height = -dot(middle, normal);
        if height.is_nan() || height <= 0.0 {
            return None;
        }
        let z = scaled(normal, -1.0);
        let across = difference(middle, scaled(z, height));
        // What is left of a long vector has a component along z by rounding.
        let across = difference(across, scaled(z, dot(across, z)));
        let offset = length(across);
        let x = if offset > 0.0 { across.map(|c| c / offset) } else { frame_around(z)[0] };
        Some(Self { axes: [x, cross(z, x), z], height, offset })
    }

    /// Squared distance of the nearest point of the rim.
    pub(super) fn nearest2(&self) -> f64 {
        self.height * self.height + (self.offset - 1.0) * (self.offset - 1.0)
    }

    /// Squared distance of the farthest point of the rim.
    fn farthest2(&self) -> f64 {
        self.height * self.height + (self.offset + 1.0) * (self.offset + 1.0)
    }

    /// Distance of the middle.
    pub(super) fn distance(&self) -> f64 {
        length([self.height, self.offset, 0.0])
    }

    /// A vector in the disc's axes.
    fn turned(&self, v: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| dot(axis, v))
    }

    /// The integral of the unit vector towards the disc over all directions that meet it, in the scene's axes.
    ///
    /// Source: MATH.md section 1.4, by Lambert's contour integral.
    pub(super) fn vector_irradiance(&self) -> [f64; 3] {
        let (h, a) = (self.height, self.offset);
        let delta = self.nearest2().sqrt() * self.farthest2().sqrt();
        // h^2 + a^2 - 1 without loss near the rim.
        let outside = h * h + (a - 1.0) * (a + 1.0);
        let along = if outside > 0.0 {
            2.0 * PI * (h / delta) * (h / (delta + outside))
        } else {
            FRAC_PI_2 * (1.0 - outside / delta)
        };
        let sum = h * h + a * a + 1.0;
        let across = 2.0 * PI * a * (h / delta) / (sum + delta);
        [0, 1, 2].map(|i| along * self.axes[2][i] + across * self.axes[0][i])
    }

    /// Irradiance for radiance 1 on a surface of unit normal `normal`, of the part above its horizon.
    pub(super) fn irradiance(&self, normal: [f64; 3]) -> f64 {
        let n = self.turned(normal);
        let tilt = (n[0] * n[0] + n[1] * n[1]).sqrt();
        let middle = self.offset * n[0] + self.height * n[2];
        if middle >= tilt {
            return dot(normal, self.vector_irradiance()).max(0.0);
        }
        if middle <= -tilt {
            return 0.0;
        }
        let half = libm::acos(-middle / tilt);
        if self.distance() > FAR {
            self.segment_by_quadrature(n, tilt, half)
        } else {
            self.segment_by_contour(n, half)
        }
    }

    /// Lambert's integral along the visible arc and back along the horizon, `half` the angle from the arc's middle to its ends.
    ///
    /// Along the arc it is that of `(p + q cos + r sin) / (A + B cos)`. Derived for this program; checked against quadrature.
    fn segment_by_contour(&self, n: [f64; 3], half: f64) -> f64 {
        let (h, a) = (self.height, self.offset);
        let top = libm::atan2(n[1], n[0]);
        let ends = [top - half, top + half];
        let (p, q, r) = (n[2], a * n[2] - h * n[0], -h * n[1]);
        let arc = Arc::new(self);
        let [constant, cosine] = [0, 1].map(|i| arc.integrals(ends[1])[i] - arc.integrals(ends[0])[i]);
        let sine = arc.sine_integral(ends, top, half);
        let [start, end] = ends.map(|angle| {
            let (sin, cos) = libm::sincos(angle);
            [a + cos, sin, h]
        });
        let chord = libm::atan2(dot(n, cross(end, start)), dot(end, start));
        (0.5 * (p * constant + q * cosine + r * sine + chord)).max(0.0)
    }

    /// The sum over the visible segment, in strips along the horizon.
    ///
    /// From afar the two parts of the contour cancel, and grazing the horizon they do; here neither matters.
    fn segment_by_quadrature(&self, n: [f64; 3], tilt: f64, half: f64) -> f64 {
        let (up, side) = ([n[0] / tilt, n[1] / tilt], [-n[1] / tilt, n[0] / tilt]);
        let mut sum = 0.0;
        for &(node, weight) in STRIPS.iter() {
            let angle = half * node;
            let (sin, cos) = libm::sincos(angle);
            // Cosine at the receiver times distance: tilt (cos(angle) - cos(half)).
            let rise = 2.0 * tilt * libm::sin(0.5 * (half + angle)) * libm::sin(0.5 * (half - angle));
            let mut strip = 0.0;
            for &(place, share) in ALONG.iter() {
                let along = sin * (2.0 * place - 1.0);
                let [x, y] = [0, 1].map(|i| cos * up[i] + along * side[i]);
                let d = length([self.offset + x, y, self.height]);
                strip += share / d / d / d * (self.height / d);
            }
            sum += weight * half * 2.0 * sin * sin * rise * strip;
        }
        sum
    }
}

/// Distance in radii from which clipped discs are summed strip by strip.
const FAR: f64 = 8.0;

static STRIPS: LazyLock<[Node; 24]> = LazyLock::new(gauss_legendre);
static ALONG: LazyLock<[Node; 10]> = LazyLock::new(gauss_legendre);

/// Integrals along the rim over |r|^2 = A + B cos(angle).
struct Arc {
    a: f64,
    b: f64,
    /// sqrt(A^2 - B^2).
    root: f64,
    /// sqrt((A - B) / (A + B)).
    ratio: f64,
    nearest2: f64,
}

impl Arc {
    fn new(view: &View) -> Self {
        let (near2, far2) = (view.nearest2(), view.farthest2());
        let (a, b) = (0.5 * (near2 + far2), 2.0 * view.offset);
        Self { a, b, root: near2.sqrt() * far2.sqrt(), ratio: (near2 / far2).sqrt(), nearest2: near2 }
    }

    /// Of 1 and of the cosine, from angle 0 to one between -2 pi and 2 pi.
    fn integrals(&self, angle: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(0.5 * angle);
        let constant = 2.0 / self.root * libm::atan2(self.ratio * sin, cos);
        if self.b > 0.5 * self.a {
            return [constant, (angle - self.a * constant) / self.b];
        }
        // Two half angles are apart by eta = atan(B x), which is 0 where the disc is right above: over B it is x there.
        let sum = self.a + self.b;
        let x = 2.0 * sin * cos / (sum * (1.0 + self.ratio) * (cos * cos + self.ratio * sin * sin));
        let eta = if self.b * x.abs() > 1e-4 {
            libm::atan(self.b * x) / self.b
        } else {
            x * (1.0 - (self.b * x) * (self.b * x) / 3.0)
        };
        let cosine = (2.0 * self.a * eta - self.b * angle / (self.root + self.a)) / self.root;
        [constant, cosine]
    }

    /// Of the sine, along the arc around `top`.
    fn sine_integral(&self, [start, end]: [f64; 2], top: f64, half: f64) -> f64 {
        let distance2 = |angle: f64| {
            let cos = libm::cos(0.5 * angle);
            self.nearest2 + 2.0 * self.b * cos * cos
        };
        let first = distance2(start);
        // (|end|^2 - |start|^2) / B, relative to |start|^2.
        let step = -2.0 * libm::sin(top) * libm::sin(half) / first;
        let change = self.b * step;
        if change.abs() < 1e-8 {
            -step * (1.0 - 0.5 * change)
        } else if change.abs() < 0.5 {
            -libm::log1p(change) / self.b
        } else {
            -libm::log(distance2(end) / first) / self.b
        }
    }
}
