//! Spherical harmonics of light from around one direction, and their slopes, in f64.

use relight_core::Direction;
use relight_core::basis::evaluate_sh;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Most bands of a projection.
pub const MOST_BANDS: usize = 6;

/// Functions of one band more than [`MOST_BANDS`]: what slopes are made of.
pub(super) const MOST_FUNCTIONS: usize = (MOST_BANDS + 1) * (MOST_BANDS + 1);

/// Factor A_l of band l from radiance to irradiance: E_lm = A_l L_lm, the coefficients of `max(cos, 0)`.
///
/// pi, 2 pi / 3, pi / 4, 0, -pi / 24, 0, ..
/// Source: Ramamoorthi and Hanrahan, *An Efficient Representation for Irradiance Environment Maps*, eq. 8, as a recursion.
pub fn cosine_lobe(l: usize) -> f64 {
    match l {
        1 => 2.0 * PI / 3.0,
        l if l % 2 == 1 => 0.0,
        l => (0..l).step_by(2).fold(PI, |a, l| a * (1.0 - l as f64) / (l as f64 + 4.0)),
    }
}

/// Y_lm of the unit vector along `v` for `bands` bands; of +z where `v` is 0.
pub(super) fn harmonics(bands: usize, v: [f64; 3], out: &mut [f64; MOST_FUNCTIONS]) {
    let direction = Direction::new(v[0], v[1], v[2]).unwrap_or(Direction::OUT);
    evaluate_sh(bands - 1, direction, out);
}

/// A part of the slope of r^l Y_lm along an axis: `factor` r^(l-1) Y_(l-1)m'.
#[derive(Clone, Copy)]
pub(super) struct Slope {
    /// Index of Y_lm.
    pub(super) of: usize,
    /// Index of Y_(l-1)m'.
    pub(super) from: usize,
    pub(super) factor: f64,
}

/// The slopes of the homogeneous polynomials r^l Y_lm along x, y and z, l = 1 .. [`MOST_BANDS`], by rising l.
///
/// Source: the ladder operators of angular momentum, for real functions with Condon-Shortley phase.
pub(super) static SLOPES: LazyLock<[Vec<Slope>; 3]> = LazyLock::new(|| {
    let mut slopes = [const { Vec::new() }; 3];
    for l in 1..=MOST_BANDS as i64 {
        let scale = ((2 * l + 1) as f64 / (2 * l - 1) as f64).sqrt();
        for m in -l..=l {
            let k = m.abs();
            let mut add = |axis: usize, to: i64, factor: f64| {
                if to.abs() < l && factor != 0.0 {
                    let (of, from) = (l * l + l + m, l * l - l + to);
                    slopes[axis].push(Slope { of: of as usize, from: from as usize, factor });
                }
            };
            // Sectors next to m = 0 have no sqrt(2) in common with it.
            let root = |a: i64, pair: bool| (a as f64).sqrt() * if pair { 2.0f64.sqrt() } else { 1.0 };
            let outwards = 0.5 * scale * root((l - k) * (l - k - 1), k == 0);
            let inwards = 0.5 * scale * root((l + k) * (l + k - 1), k == 1);
            add(2, m, scale * root((l - k) * (l + k), false));
            if m >= 0 {
                add(0, k + 1, outwards);
                add(1, -(k + 1), outwards);
                if k > 0 {
                    add(0, k - 1, -inwards);
                }
                if k > 1 {
                    add(1, -(k - 1), inwards);
                }
            } else {
                add(0, -(k + 1), outwards);
                if k > 1 {
                    add(0, -(k - 1), -inwards);
                }
                add(1, k + 1, -outwards);
                add(1, k - 1, -inwards);
            }
        }
    }
    slopes
});

/// Light from around a direction: the coefficients z_l Y_lm that a point sees, and how they change as it moves.
#[derive(Clone, Copy)]
pub(super) struct Zonal {
    /// z_l.
    pub(super) values: [f64; MOST_BANDS],
    /// Distance times the slope of z_l as the point moves towards the light.
    pub(super) slopes: [f64; MOST_BANDS],
}

impl Zonal {
    /// Adds the coefficients; `functions` are those of the direction.
    pub(super) fn add(&self, functions: &[f64], color: [f64; 3], out: &mut [[f64; 3]]) {
        for (i, (out, function)) in out.iter_mut().zip(functions).enumerate() {
            let weight = self.values[i.isqrt()] * function;
            for channel in 0..3 {
                out[channel] += color[channel] * weight;
            }
        }
    }

    /// Adds their slopes along x, y and z, where `color` is divided by the distance; `functions` of one band more.
    ///
    /// With v = light - point and f_l(|v|) = z_l, the gradient of f_l Y_lm falls apart into bands l + 1 and l - 1:
    /// `(f' - l f / |v|) U Y_(l+1) + (f' + (l+1) f / |v|) / (2l+1) D Y_(l-1)`, D the slopes above and U its transpose
    /// from the band above by 2l + 3; no component along v has to be taken off.
    pub(super) fn add_gradient(&self, functions: &[f64], color: [f64; 3], out: &mut [[[f64; 3]; 3]]) {
        for (axis, slopes) in SLOPES.iter().enumerate() {
            for slope in slopes {
                let l = slope.of.isqrt();
                // Y_(l-1) gains from the band above, Y_l from the one below.
                let [above, below] = [self.above(l - 1), self.below(l)];
                let weights = [
                    (slope.from, above / (2 * l + 1) as f64 * functions[slope.of]),
                    (slope.of, below * functions[slope.from]),
                ];
                for (i, weight) in weights {
                    if let Some(out) = out.get_mut(i) {
                        for channel in 0..3 {
                            out[axis][channel] += color[channel] * weight * slope.factor;
                        }
                    }
                }
            }
        }
    }

    /// What band l + 1 gives to the slopes of band l.
    fn above(&self, l: usize) -> f64 {
        self.slopes[l] + l as f64 * self.values[l]
    }

    /// What band l - 1 gives to the slopes of band l; l may be [`MOST_BANDS`], which has none.
    fn below(&self, l: usize) -> f64 {
        if l == MOST_BANDS {
            return 0.0;
        }
        (self.slopes[l] - (l + 1) as f64 * self.values[l]) / (2 * l + 1) as f64
    }
}
