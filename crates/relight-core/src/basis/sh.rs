//! Real spherical harmonics by the factored, normalised recursion: no factorials, no trigonometry,
//! no division at the poles, good to order 100 and beyond in f64.
//!
//! Source: *Relightable Panoramas*, appendix, with every m in N and Q read as |m| (MATH.md section
//! 1.1); the recursion is MATH.md's "stable form". Orthonormal over the sphere, Condon-Shortley
//! phase included (as in the paper, D3DX and Sloan), index i = l*l + l + m.

use super::{BasisError, Counts, FunctionsOfLight};
use crate::Direction;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, SQRT_2};

/// Numbers of functions of orders 0 to 10.
pub(super) const COUNTS: [usize; 11] = [1, 4, 9, 16, 25, 36, 49, 64, 81, 100, 121];

pub(super) fn count_of_order(order: usize) -> usize {
    (order + 1) * (order + 1)
}

/// Real spherical harmonics Y_lm, l = 0..order, m = -l..l.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Record", into = "Record")]
pub struct Sh {
    order: u8,
}

#[derive(Serialize, Deserialize)]
struct Record {
    order: u8,
}

impl Sh {
    /// The harmonics of 1, 4, 9 .. 121 functions.
    ///
    /// # Errors
    /// [`BasisError::Count`] for any other number.
    pub fn with_count(count: usize) -> Result<Self, BasisError> {
        let order = COUNTS.iter().position(|&c| c == count);
        let order =
            order.ok_or(BasisError::Count { family: "sh", count, counts: Counts::Listed(&COUNTS) })?;
        Ok(Self { order: order as u8 })
    }

    /// The largest l, 0 to 10.
    pub fn order(self) -> u8 {
        self.order
    }
}

impl TryFrom<Record> for Sh {
    type Error = BasisError;

    fn try_from(record: Record) -> Result<Self, BasisError> {
        Self::with_count(count_of_order(usize::from(record.order)))
    }
}

impl From<Sh> for Record {
    fn from(sh: Sh) -> Self {
        Self { order: sh.order }
    }
}

impl FunctionsOfLight for Sh {
    fn count(&self) -> usize {
        count_of_order(usize::from(self.order))
    }

    fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        evaluate_sh(usize::from(self.order), light, weights);
    }

    fn label(&self, j: usize) -> String {
        let l = j.isqrt();
        let m = j as i64 - (l * l + l) as i64;
        format!("l{l}m{m}")
    }
}

/// Writes Y_lm(direction) to `out[l*l + l + m]` for l = 0..`order`, m = -l..l.
///
/// Source: MATH.md section 1.1, stable form. Against 50-digit values the error is below 1e-14 to
/// order 10 and 1e-13 at order 100, where the literal formula overflows from order 86.
///
/// # Panics
/// When `out` is shorter than (order + 1)^2.
pub fn evaluate_sh(order: usize, direction: Direction, out: &mut [f64]) {
    let [x, y, z] = direction.components();
    // sin^m(theta) cos(m phi) and sin^m(theta) sin(m phi), by the complex power (x + iy)^m.
    let (mut cos_m, mut sin_m) = (1.0, 0.0);
    // Legendre's P_m^m with sin^m kept out, normalised.
    let mut sectoral = (1.0 / (4.0 * PI)).sqrt();
    for m in 0..=order {
        let mm = (m * m) as f64;
        let (mut before, mut current) = (0.0, sectoral);
        for l in m..=order {
            let at = l * l + l;
            if m == 0 {
                out[at] = current;
            } else {
                out[at + m] = SQRT_2 * current * cos_m;
                out[at - m] = SQRT_2 * current * sin_m;
            }
            let (l1, l0) = (((l + 1) * (l + 1)) as f64, (l * l) as f64);
            let a = ((4.0 * l1 - 1.0) / (l1 - mm)).sqrt();
            let b = if l == m { 0.0 } else { ((l0 - mm) / (4.0 * l0 - 1.0)).sqrt() };
            (before, current) = (current, a * (z * current - b * before));
        }
        sectoral *= -((2 * m + 3) as f64 / (2 * m + 2) as f64).sqrt();
        (cos_m, sin_m) = (x * cos_m - y * sin_m, y * cos_m + x * sin_m);
    }
}
