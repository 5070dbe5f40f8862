//! Which bases a light set can carry.

use crate::{Decomposition, FitError, LightWeights};
use relight_core::basis::SrbfDesign;
use relight_core::{Basis, BasisError, Design, Family, LightSet};

/// The worst condition number of a usable basis: coefficients then stay within a few hundred
/// times the pictures' values, which the ridge brings down to what 8 bits hold.
///
/// Source: MATH.md section 1.1 (spherical harmonics on a hemisphere: 4e2 at order 4, 3e3 at 5).
pub const WORST_CONDITION: f64 = 1e3;

/// Lights wanted for each function, so that something is left to tell noise from shape.
pub const LIGHTS_PER_FUNCTION: f64 = 1.25;

/// How a basis stands on a light set.
#[derive(Clone, Debug)]
pub struct Usability {
    /// The basis.
    pub basis: Basis,
    /// How many of its functions the lights determine.
    pub rank: usize,
    /// Ratio of largest to smallest singular value, weights included; infinite below full rank.
    pub condition: f64,
    /// Whether rank, condition and number of lights all suffice.
    pub usable: bool,
}

/// Examines `basis` on `lights`.
///
/// # Errors
/// [`FitError::NoLights`].
pub fn usability(basis: Basis, lights: &LightSet) -> Result<Usability, FitError> {
    let decomposition = Decomposition::new(&basis, &lights.directions(), LightWeights::Voronoi)?;
    let (rank, condition) = (decomposition.rank(), decomposition.condition());
    let enough = lights.len() as f64 >= LIGHTS_PER_FUNCTION * basis.count() as f64;
    Ok(Usability { basis, rank, condition, usable: enough && condition <= WORST_CONDITION })
}

/// The usable basis of `family` with the most functions up to `limit`, `None` when not even its
/// smallest is usable. Families of any count are tried at squares.
///
/// # Errors
/// [`BasisError`] of a parameter in `srbf` that is out of range.
pub fn largest_usable(
    family: &Family,
    lights: &LightSet,
    srbf: SrbfDesign,
    limit: usize,
) -> Result<Option<Usability>, BasisError> {
    let counts = family.counts_up_to(limit);
    let stepped = counts.len() > 20;
    let tried =
        counts.into_iter().rev().filter(|&count| !stepped || count == limit || count.isqrt().pow(2) == count);
    for count in tried {
        if (lights.len() as f64) < LIGHTS_PER_FUNCTION * count as f64 {
            continue;
        }
        let basis = family.build(&Design { count, lights, srbf })?;
        if let Ok(found) = usability(basis, lights)
            && found.usable
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}
