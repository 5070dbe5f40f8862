//! Polynomial texture maps: polynomials in the light's picture-plane components u = x, v = y.
//!
//! Source: Malzbender, Gelb, Wolters, *Polynomial Texture Maps*, 2001; MATH.md section 1.3.
//! Degree 2 comes first and in the order of `.ptm` files, so that its planes are theirs.

use super::{BasisError, Counts, FunctionsOfLight};
use crate::Direction;
use serde::{Deserialize, Serialize};

/// Numbers of functions of degrees 2, 3 and 4.
pub(super) const COUNTS: [usize; 3] = [6, 10, 15];

/// Exponents of u and v, by function.
const EXPONENTS: [(u8, u8); 15] = [
    (2, 0),
    (0, 2),
    (1, 1),
    (1, 0),
    (0, 1),
    (0, 0),
    (3, 0),
    (2, 1),
    (1, 2),
    (0, 3),
    (4, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 4),
];

/// Exponents of u and v in PTM function `j`, 0 to 14.
///
/// # Panics
/// When there is no such function.
pub fn ptm_exponents(j: usize) -> (u8, u8) {
    EXPONENTS[j]
}

pub(super) fn count_of_degree(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// All monomials in u and v up to a degree of 2, 3 or 4: u^2, v^2, uv, u, v, 1, then u^3, u^2 v,
/// u v^2, v^3, then u^4 .. v^4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Record", into = "Record")]
pub struct Ptm {
    degree: u8,
}

#[derive(Serialize, Deserialize)]
struct Record {
    degree: u8,
}

impl Ptm {
    /// The PTM of 6, 10 or 15 functions.
    ///
    /// # Errors
    /// [`BasisError::Count`] for any other number.
    pub fn with_count(count: usize) -> Result<Self, BasisError> {
        let row = COUNTS.iter().position(|&c| c == count);
        let row = row.ok_or(BasisError::Count { family: "ptm", count, counts: Counts::Listed(&COUNTS) })?;
        Ok(Self { degree: row as u8 + 2 })
    }

    /// 2, 3 or 4.
    pub fn degree(self) -> u8 {
        self.degree
    }
}

impl TryFrom<Record> for Ptm {
    type Error = BasisError;

    fn try_from(record: Record) -> Result<Self, BasisError> {
        Self::with_count(count_of_degree(usize::from(record.degree)))
    }
}

impl From<Ptm> for Record {
    fn from(ptm: Ptm) -> Self {
        Self { degree: ptm.degree }
    }
}

impl FunctionsOfLight for Ptm {
    fn count(&self) -> usize {
        count_of_degree(usize::from(self.degree))
    }

    fn evaluate(&self, light: Direction, weights: &mut [f64]) {
        let power = |base: f64, exponent: u8| (0..exponent).fold(1.0, |product, _| product * base);
        for (weight, &(i, j)) in weights[..self.count()].iter_mut().zip(&EXPONENTS) {
            *weight = power(light.x(), i) * power(light.y(), j);
        }
    }

    fn label(&self, j: usize) -> String {
        match EXPONENTS[j] {
            (0, 0) => "1".to_owned(),
            (i, j) => "u".repeat(usize::from(i)) + &"v".repeat(usize::from(j)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monomials_stand_in_the_order_of_ptm_files() {
        let light = Direction::new(0.3, -0.4, 0.8).unwrap();
        let (u, v) = (light.x(), light.y());
        let mut weights = [0.0; 15];
        Ptm::with_count(15).unwrap().evaluate(light, &mut weights);
        let expected = [
            u * u,
            v * v,
            u * v,
            u,
            v,
            1.0,
            u * u * u,
            u * u * v,
            u * v * v,
            v * v * v,
            u * u * u * u,
            u * u * u * v,
            u * u * v * v,
            u * v * v * v,
            v * v * v * v,
        ];
        for (j, (a, b)) in weights.iter().zip(expected).enumerate() {
            assert!((a - b).abs() < 1e-16, "{j}: {a} {b}");
        }
        assert_eq!(Ptm::with_count(15).unwrap().label(7), "uuv");
    }
}
