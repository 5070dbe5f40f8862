//! f32 values side by side: no branch, no table, no library call, so that loops over them become vector instructions,
//! with the same bits at every CPU level.

use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

/// Values that go through a function together.
pub(crate) const LANES: usize = 16;

/// [`LANES`] values.
pub(crate) type Lanes = [f32; LANES];

/// `expression` for each lane `i`.
macro_rules! lanes {
    (|$i:ident| $expression:expr) => {{
        let mut out = [0.0f32; LANES];
        for $i in 0..LANES {
            out[$i] = $expression;
        }
        out
    }};
}
pub(crate) use lanes;

/// `expression` for each axis or channel `a`. Closures, which `map` takes, may be compiled without the CPU level's instructions.
macro_rules! three {
    (|$a:ident| $expression:expr) => {{
        [
            {
                let $a = 0;
                $expression
            },
            {
                let $a = 1;
                $expression
            },
            {
                let $a = 2;
                $expression
            },
        ]
    }};
}
pub(super) use three;

/// (atan(x) - x) / x^3 from x^2, 0 to 1, within 2e-7 of it relatively.
///
/// Source: coefficients of least relative error, 4.4e-8 before rounding (Lawson's iteration).
#[inline(always)]
pub(super) fn arctangent_rest(x2: f32) -> f32 {
    let p = -0.002_423_562_3 * x2 + 0.013_655_92;
    let p = p * x2 - 0.036_115_903;
    let p = p * x2 + 0.062_712_14;
    let p = p * x2 - 0.086_669_56;
    let p = p * x2 + 0.110_363_96;
    let p = p * x2 - 0.142_789_08;
    let p = p * x2 + 0.199_997_56;
    p * x2 - 0.333_333_3
}

/// The angle of (x, y) for y from 0 up: 0 to pi.
#[inline(always)]
pub(super) fn angle(y: f32, x: f32) -> f32 {
    let side = x.abs();
    let (least, most) = if y < side { (y, side) } else { (side, y) };
    let ratio = least / most.max(f32::MIN_POSITIVE);
    let square = ratio * ratio;
    let small = ratio + ratio * (square * arctangent_rest(square));
    let right = if y < side { small } else { FRAC_PI_2 - small };
    if x < 0.0 { PI - right } else { right }
}

/// Most bands of harmonics: those of a probe.
pub(super) const MOST_LANE_BANDS: usize = 11;

/// Factors of the recursion that gives Y_lm; `relight_core::basis::evaluate_sh` is the same in f64.
///
/// Source: MATH.md section 1.1, stable form.
pub(crate) struct Recursion {
    /// Legendre's P_m^m, by m; sqrt(2) of m > 0 included.
    pub(super) sectoral: [f32; MOST_LANE_BANDS],
    /// (a, a b) of the step from l to l + 1, by m, then l.
    pub(super) steps: [[(f32, f32); MOST_LANE_BANDS]; MOST_LANE_BANDS],
}

/// The factors, in f64 until they are rounded.
pub(crate) static RECURSION: LazyLock<Recursion> = LazyLock::new(|| {
    let mut recursion = Recursion {
        sectoral: [0.0; MOST_LANE_BANDS],
        steps: [[(0.0, 0.0); MOST_LANE_BANDS]; MOST_LANE_BANDS],
    };
    let mut sectoral = (0.25 / std::f64::consts::PI).sqrt();
    for m in 0..MOST_LANE_BANDS {
        let scale = if m == 0 { 1.0 } else { 2.0f64.sqrt() };
        recursion.sectoral[m] = (scale * sectoral) as f32;
        sectoral *= -((2 * m + 3) as f64 / (2 * m + 2) as f64).sqrt();
        for l in m..MOST_LANE_BANDS {
            let (mm, l1, l0) = ((m * m) as f64, ((l + 1) * (l + 1)) as f64, (l * l) as f64);
            let a = ((4.0 * l1 - 1.0) / (l1 - mm)).sqrt();
            let b = if l == m { 0.0 } else { ((l0 - mm) / (4.0 * l0 - 1.0)).sqrt() };
            recursion.steps[m][l] = (a as f32, (a * b) as f32);
        }
    }
    recursion
});

impl Recursion {
    /// Writes Y_lm of unit vectors to `out[l * l + l + m]` for `bands` bands.
    #[inline(always)]
    pub(crate) fn evaluate(&self, bands: usize, [x, y, z]: &[Lanes; 3], out: &mut [Lanes]) {
        let (mut cos_m, mut sin_m) = ([1.0f32; LANES], [0.0f32; LANES]);
        for m in 0..bands {
            let (mut before, mut current) = ([0.0f32; LANES], [self.sectoral[m]; LANES]);
            for l in m..bands {
                let at = l * l + l;
                if m == 0 {
                    out[at] = current;
                } else {
                    out[at + m] = lanes!(|i| current[i] * cos_m[i]);
                    out[at - m] = lanes!(|i| current[i] * sin_m[i]);
                }
                let (a, ab) = self.steps[m][l];
                let next = lanes!(|i| a * (z[i] * current[i]) - ab * before[i]);
                before = current;
                current = next;
            }
            let next = lanes!(|i| x[i] * cos_m[i] - y[i] * sin_m[i]);
            sin_m = lanes!(|i| y[i] * cos_m[i] + x[i] * sin_m[i]);
            cos_m = next;
        }
    }
}
