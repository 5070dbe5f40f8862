//! Spheres that shine alike all over: their harmonics, and the irradiance of what the receiver's horizon leaves of them.
//!
//! Source: *Irradiance Rigs*, equations 2 and 3, in the forms of MATH.md section 1.4 that don't cancel.

use super::harmonics::{MOST_BANDS, Zonal};
use std::f64::consts::PI;

/// z_l over pi sine^2 by band, from sine^2 and cosine, in f32 or f64.
macro_rules! zonal_values {
    ($q:expr, $c:expr) => {{
        let (q, c) = ($q, $c);
        [
            2.0 / (1.0 + c),
            1.0,
            c,
            1.0 - 1.25 * q,
            c * (1.0 - 1.75 * q),
            1.0 + q * (2.625 * q - 3.5),
            c * (1.0 + q * (4.125 * q - 4.5)),
        ]
    }};
}
pub(super) use zonal_values;

/// The distance times g_l over 2 pi sine^2 by band, from sine^2: `$even` and `$odd` of a polynomial each. Over the cosine in even bands.
macro_rules! zonal_slopes {
    ($q:expr, |$p:ident| $even:expr, $odd:expr) => {{
        let q = $q;
        macro_rules! even {
            ($polynomial:expr) => {{
                let $p = $polynomial;
                $even
            }};
        }
        macro_rules! odd {
            ($polynomial:expr) => {{
                let $p = $polynomial;
                $odd
            }};
        }
        [
            even!(1.0),
            odd!(1.0),
            even!(1.0 - 1.5 * q),
            odd!(1.0 - 2.5 * q),
            even!(1.0 + q * (4.375 * q - 5.0)),
            odd!(1.0 + q * (7.875 * q - 7.0)),
            even!(1.0 + q * (q * (23.625 - 14.4375 * q) - 10.5)),
        ]
    }};
}
pub(super) use zonal_slopes;

/// What a sphere looks like from a distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Sine of half the angle that it fills, radius / distance; 1 for points on and in it.
    pub(super) sine: f64,
    /// Cosine of that; 0 for points on and in it.
    pub(super) cosine: f64,
}

impl Seen {
    pub(super) fn new(radius: f64, distance: f64) -> Self {
        if distance <= radius {
            return Self { sine: 1.0, cosine: 0.0 };
        }
        // 1 - sine^2 would lose all digits where the sphere is nearly touched; of the quotients none can overflow.
        let cosine = ((distance - radius) / distance * (1.0 + radius / distance)).sqrt();
        Self { sine: radius / distance, cosine }
    }

    /// z_l and the distance times g_l for radiance 1, both divided by sine^2: its square may be less than f64 holds.
    ///
    /// z_l is `2 pi sine^2 P_l'(cosine) / (l (l + 1))`, the integral of P_l over the cap without its cancellation. Even
    /// bands' slopes grow without bound towards the surface; on it and within nothing changes with distance.
    pub(super) fn zonal(self) -> Zonal {
        let (q, c) = (self.sine * self.sine, self.cosine);
        let slopes = if c == 0.0 { [0.0; MOST_BANDS] } else { zonal_slopes!(q, |p| p / c, p) };
        Zonal { values: zonal_values!(q, c).map(|z| PI * z), slopes: slopes.map(|g| 2.0 * PI * g) }
    }

    /// Irradiance / sine^2 for radiance 1, of the part above the horizon; `cosine` is that between the normal and the middle.
    ///
    /// On the sphere and within it is pi (1 + cosine) / 2: half of all directions shine.
    pub(super) fn irradiance(self, cosine: f64) -> f64 {
        let (s, c, ct) = (self.sine, self.cosine, cosine);
        if ct <= -s {
            return 0.0;
        }
        if c == 0.0 {
            return 0.5 * PI * (1.0 + ct.min(1.0));
        }
        if ct >= s {
            return PI * ct;
        }
        // Everything in units of the sine, so that radii of 1e-200 have a horizon, too.
        let t = ct / s;
        // Not (1 - t)(1 + t): t is rounded, and little is left of what just rises over the horizon.
        let u = ((s - ct) / s * ((s + ct) / s)).sqrt();
        let k = s * u / c;
        if t < 0.0 && u < -GRAZING * c * t {
            return s * grazing(s, t, u, c);
        }
        let lit = ct * libm::atan2(u, -c * t);
        if k < 0.35 {
            let ratio = u / c;
            lit + s * (ratio + ratio * ratio * ratio * arctangent_rest(k * k))
        } else {
            lit + (libm::atan2(s * u, c) - c * s * u) / (s * s)
        }
    }
}

/// Below it for u / (c |t|), a series is used for what just rises over the horizon.
const GRAZING: f64 = 0.3;

/// (atan(k) - k) / k^3 from k^2, up to 0.35^2.
fn arctangent_rest(k2: f64) -> f64 {
    -(1..=17).rev().fold(0.0, |sum, n| odd_reciprocal(n) - k2 * sum)
}

/// 1 / (2n + 1).
fn odd_reciprocal(n: i32) -> f64 {
    1.0 / f64::from(2 * n + 1)
}

/// Irradiance / sine^3 of a sphere of which little is above the horizon.
///
/// The closed form's terms are series in k = w / c and y = k / |cos|, whose first powers cancel: what is left is
/// `k y^2 w^2 / 3 + sum over n >= 2 of (-1)^n k / (2n + 1) (k^2n - s^2 y^2n)`.
fn grazing(s: f64, t: f64, u: f64, c: f64) -> f64 {
    let kappa = u / c;
    let (k2, y2) = (s * s * kappa * kappa, kappa * kappa / (t * t));
    let (mut kn, mut yn, mut sum) = (k2, y2, y2 * u * u / 3.0);
    let mut sign = 1.0;
    for n in 2..=16 {
        // k^2n / s^2 = kappa^2 k^(2n-2).
        let powers = kappa * kappa * kn;
        yn *= y2;
        sum += sign * odd_reciprocal(n) * (powers - yn);
        kn *= k2;
        sign = -sign;
    }
    kappa * sum
}
