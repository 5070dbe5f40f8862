//! Hemispherical harmonics, the sixteen functions of `.rti` files.
//!
//! Source: Gautron et al., *A Novel Hemispherical Basis for Accurate and Efficient Rendering*,
//! 2004, in the order and signs of `.rti` (FORMATS.md): l = 0..3, m = +l..-l. sqrt(c - c^2) is
//! written x sqrt(z / (1 + z)), which has no 0/0 at the pole and no NaN below the horizon.

use super::{BasisError, Counts, FunctionsOfLight};
use crate::Direction;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Numbers of functions of orders 0 to 3.
pub(super) const COUNTS: [usize; 4] = [1, 4, 9, 16];

/// Hemispherical harmonics of 1, 4, 9 or 16 functions, orthonormal over z >= 0.
///
/// Lights below the horizon are evaluated at it (z = 0), where the functions end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Record", into = "Record")]
pub struct Hsh {
    order: u8,
}

#[derive(Serialize, Deserialize)]
struct Record {
    order: u8,
}

impl Hsh {
    /// The harmonics of 1, 4, 9 or 16 functions.
    ///
    /// # Errors
    /// [`BasisError::Count`] for any other number.
    pub fn with_count(count: usize) -> Result<Self, BasisError> {
        let order = COUNTS.iter().position(|&c| c == count);
        let order =
            order.ok_or(BasisError::Count { family: "hsh", count, counts: Counts::Listed(&COUNTS) })?;
        Ok(Self { order: order as u8 })
    }
}

impl TryFrom<Record> for Hsh {
    type Error = BasisError;

    fn try_from(record: Record) -> Result<Self, BasisError> {
        Self::with_count(super::sh::count_of_order(usize::from(record.order)))
    }
}

impl From<Hsh> for Record {
    fn from(hsh: Hsh) -> Self {
        Self { order: hsh.order }
    }
}

impl FunctionsOfLight for Hsh {
    fn count(&self) -> usize {
        super::sh::count_of_order(usize::from(self.order))
    }

    fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        let c = light.z().max(0.0);
        // sqrt(c - c^2) cos(phi) and sin(phi); the root is x sqrt(c / (1 + c)) since
        // sin^2(theta) = (1 - c)(1 + c).
        let r = (c / (1.0 + c)).sqrt();
        let (x, y) = (light.x() * r, light.y() * r);
        // (c - c^2) cos(2 phi), sin(2 phi) and (c - c^2)^1.5 cos(3 phi), sin(3 phi).
        let (x2, y2) = (x * x - y * y, 2.0 * x * y);
        let (x3, y3) = (x * x2 - y * y2, x * y2 + y * x2);
        let t = 2.0 * c - 1.0;
        let all = [
            (1.0 / (2.0 * PI)).sqrt(),
            (6.0 / PI).sqrt() * x,
            (3.0 / (2.0 * PI)).sqrt() * t,
            (6.0 / PI).sqrt() * y,
            -(30.0 / PI).sqrt() * x2,
            (30.0 / PI).sqrt() * t * x,
            (5.0 / (2.0 * PI)).sqrt() * (1.0 - 6.0 * c + 6.0 * c * c),
            (30.0 / PI).sqrt() * t * y,
            -(30.0 / PI).sqrt() * y2,
            2.0 * (35.0 / PI).sqrt() * x3,
            -(210.0 / PI).sqrt() * t * x2,
            2.0 * (21.0 / PI).sqrt() * (1.0 - 5.0 * c + 5.0 * c * c) * x,
            (7.0 / (2.0 * PI)).sqrt() * (20.0 * c * c * c - 30.0 * c * c + 12.0 * c - 1.0),
            2.0 * (21.0 / PI).sqrt() * (1.0 - 5.0 * c + 5.0 * c * c) * y,
            -(210.0 / PI).sqrt() * t * y2,
            2.0 * (35.0 / PI).sqrt() * y3,
        ];
        let count = self.count();
        weights[..count].copy_from_slice(&all[..count]);
    }

    fn label(&self, j: usize) -> String {
        let l = j.isqrt();
        let m = (l * l + l) as i64 - j as i64;
        format!("l{l}m{m}")
    }
}
