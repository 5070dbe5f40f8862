//! Heights from normals.

use crate::NormalMap;
use crate::poisson::{BYTES_PER_PIXEL, Differences, solve};

/// The least z of a normal that is believed: steeper slopes than 20 would pull the whole height along.
const LEAST_Z: f32 = 0.05;

/// Weight of differences at pixels without normal: they follow their surroundings.
const LEAST_WEIGHT: f32 = 1e-3;

/// Bytes that [`heights_from_normals`] takes for `pixels` pixels.
pub fn height_bytes(pixels: u64) -> u64 {
    pixels * BYTES_PER_PIXEL
}

/// The height whose slopes come nearest to those of `map`'s normals in the sense of least squares: pixels of height
/// (a slope of 45 degrees rises one pixel a pixel), z out of the picture, mean 0, rows from the top.
///
/// Differences between neighbours are the mean of their slopes; the boundary is natural. Pixels whose normal was not found hardly
/// count. `check` is called now and then, to call the work off.
///
/// Source: Frankot and Chellappa, *A method for enforcing integrability in shape from shading algorithms*, 1988, whose Fourier
/// transform makes opposite edges meet; solved as a Poisson problem instead.
///
/// # Errors
/// Those of `check`.
pub fn heights_from_normals<E>(map: &NormalMap, check: impl Fn() -> Result<(), E>) -> Result<Vec<f32>, E> {
    let NormalMap { width, normals, found, .. } = map;
    let (width, count) = (*width, normals.len());
    let slope = |at: usize| {
        let [x, y, z] = normals[at];
        let z = z.max(LEAST_Z);
        // y is up and rows go down.
        [-x / z, y / z]
    };
    let difference = |a: usize, b: usize, axis: usize| match (found[a], found[b]) {
        (true, true) => (0.5 * (slope(a)[axis] + slope(b)[axis]), 1.0),
        _ => (0.0, LEAST_WEIGHT),
    };
    let right =
        (0..count).map(|at| if at % width + 1 < width { difference(at, at + 1, 0) } else { (0.0, 0.0) });
    let down =
        (0..count).map(|at| if at + width < count { difference(at, at + width, 1) } else { (0.0, 0.0) });
    let differences = Differences { width, right: right.collect(), down: down.collect() };
    let heights = solve(differences, check)?;
    Ok(heights.into_iter().map(|height| height as f32).collect())
}
