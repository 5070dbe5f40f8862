//! PTM, SH and HSH at many directions at once, in f32.

use crate::path::Directions;
use relight_core::{CpuLevel, Vectorized};
use std::f64::consts::PI;

/// Factors of the recursion that gives Y_lm, by m, then l.
///
/// Source: MATH.md section 1.1, stable form; `relight_core::basis::evaluate_sh` is the same in f64.
#[derive(Clone, Debug)]
pub(crate) struct Recursion {
    order: usize,
    /// Legendre's P_m^m, by m.
    sectoral: Vec<f32>,
    /// (a, b) of the step from l to l + 1, by m, then l from m.
    steps: Vec<Vec<(f32, f32)>>,
}

impl Recursion {
    pub(crate) fn new(order: usize) -> Self {
        let mut sectoral = vec![(1.0 / (4.0 * PI)).sqrt()];
        for m in 0..order {
            let factor = -((2 * m + 3) as f64 / (2 * m + 2) as f64).sqrt();
            sectoral.push(sectoral[m] * factor);
        }
        let step = |m: usize, l: usize| {
            let (mm, l1, l0) = ((m * m) as f64, ((l + 1) * (l + 1)) as f64, (l * l) as f64);
            let a = ((4.0 * l1 - 1.0) / (l1 - mm)).sqrt();
            let b = if l == m { 0.0 } else { ((l0 - mm) / (4.0 * l0 - 1.0)).sqrt() };
            (a as f32, b as f32)
        };
        Self {
            order,
            sectoral: sectoral.into_iter().map(|p| p as f32).collect(),
            steps: (0..=order).map(|m| (m..order).map(|l| step(m, l)).collect()).collect(),
        }
    }

    /// Writes Y_lm of direction i to `rows[(l * l + l + m) * n + i]`.
    pub(crate) fn evaluate(&self, level: CpuLevel, directions: Directions<'_>, rows: &mut [f32]) {
        level.run(Harmonics { recursion: self, directions, rows });
    }
}

struct Harmonics<'a> {
    recursion: &'a Recursion,
    directions: Directions<'a>,
    rows: &'a mut [f32],
}

/// Directions that go through the recursion together: what it carries stays in registers.
const LANES: usize = 16;

impl Vectorized for Harmonics<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Directions { x, y, z } = self.directions;
        let n = x.len();
        for first in (0..n).step_by(LANES) {
            let lanes = LANES.min(n - first);
            let load = |from: &[f32]| {
                let mut to = [0.0f32; LANES];
                to[..lanes].copy_from_slice(&from[first..first + lanes]);
                to
            };
            let (x, y, z) = (load(x), load(y), load(z));
            let (mut cos_m, mut sin_m) = ([std::f32::consts::SQRT_2; LANES], [0.0f32; LANES]);
            for (m, (&sectoral, steps)) in
                self.recursion.sectoral.iter().zip(&self.recursion.steps).enumerate()
            {
                let (mut before, mut current) = ([0.0f32; LANES], [sectoral; LANES]);
                for l in m..=self.recursion.order {
                    let at = l * l + l;
                    let mut store = |row: usize, values: [f32; LANES]| {
                        self.rows[row * n + first..][..lanes].copy_from_slice(&values[..lanes]);
                    };
                    if m == 0 {
                        store(at, current);
                    } else {
                        store(at + m, product(current, cos_m));
                        store(at - m, product(current, sin_m));
                    }
                    if let Some(&(a, b)) = steps.get(l - m) {
                        for i in 0..LANES {
                            (before[i], current[i]) = (current[i], a * (z[i] * current[i] - b * before[i]));
                        }
                    }
                }
                for i in 0..LANES {
                    (cos_m[i], sin_m[i]) =
                        (x[i] * cos_m[i] - y[i] * sin_m[i], y[i] * cos_m[i] + x[i] * sin_m[i]);
                }
            }
        }
    }
}

#[inline(always)]
fn product(a: [f32; LANES], b: [f32; LANES]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = a[i] * b[i];
    }
    out
}

/// The monomials of a PTM in the order of its functions.
pub(crate) struct Monomials<'a> {
    pub(crate) directions: Directions<'a>,
    pub(crate) rows: &'a mut [f32],
    /// 6, 10 or 15.
    pub(crate) count: usize,
}

impl Vectorized for Monomials<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.directions.x.len();
        let (u, v) = (&self.directions.x[..n], &self.directions.y[..n]);
        for (j, row) in self.rows.chunks_exact_mut(n).take(self.count).enumerate() {
            let (p, q) = relight_core::basis::ptm_exponents(j);
            for i in 0..n {
                row[i] = power(u[i], p) * power(v[i], q);
            }
        }
    }
}

#[inline(always)]
fn power(base: f32, exponent: u8) -> f32 {
    match exponent {
        0 => 1.0,
        1 => base,
        2 => base * base,
        3 => base * base * base,
        _ => (base * base) * (base * base),
    }
}

/// Hemispherical harmonics; directions below the horizon are taken at it.
///
/// Source: `relight_core::basis`, `Hsh`, the same in f64.
pub(crate) struct Hemispherical<'a> {
    pub(crate) directions: Directions<'a>,
    pub(crate) rows: &'a mut [f32],
    /// 1, 4, 9 or 16.
    pub(crate) count: usize,
}

impl Vectorized for Hemispherical<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.directions.x.len();
        let factors = [
            1.0 / (2.0 * PI),
            6.0 / PI,
            3.0 / (2.0 * PI),
            30.0 / PI,
            5.0 / (2.0 * PI),
            35.0 / PI,
            210.0 / PI,
            21.0 / PI,
            7.0 / (2.0 * PI),
        ]
        .map(|square: f64| square.sqrt() as f32);
        let [f0, f1, f1z, f2, f2z, f3, f3b, f3a, f3z] = factors;
        for i in 0..n {
            let c = self.directions.z[i].max(0.0);
            let r = (c / (1.0 + c)).sqrt();
            let (x, y) = (self.directions.x[i] * r, self.directions.y[i] * r);
            let (x2, y2) = (x * x - y * y, 2.0 * x * y);
            let (x3, y3) = (x * x2 - y * y2, x * y2 + y * x2);
            let t = 2.0 * c - 1.0;
            let all = [
                f0,
                f1 * x,
                f1z * t,
                f1 * y,
                -f2 * x2,
                f2 * t * x,
                f2z * (1.0 - 6.0 * c + 6.0 * c * c),
                f2 * t * y,
                -f2 * y2,
                2.0 * f3 * x3,
                -f3b * t * x2,
                2.0 * f3a * (1.0 - 5.0 * c + 5.0 * c * c) * x,
                f3z * (20.0 * c * c * c - 30.0 * c * c + 12.0 * c - 1.0),
                2.0 * f3a * (1.0 - 5.0 * c + 5.0 * c * c) * y,
                -f3b * t * y2,
                2.0 * f3 * y3,
            ];
            for (j, value) in all.iter().take(self.count).enumerate() {
                self.rows[j * n + i] = *value;
            }
        }
    }
}
