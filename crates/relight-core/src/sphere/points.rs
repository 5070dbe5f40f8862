//! Evenly spread points on the sphere and on caps.

use super::Cap;
use crate::Direction;
use std::f64::consts::PI;

/// The golden angle, pi (3 - sqrt 5).
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// The van der Corput radical inverse of `k` in `base`.
fn radical_inverse(mut k: usize, base: usize) -> f64 {
    let (mut inverse, mut digit) = (0.0, 1.0 / base as f64);
    while k > 0 {
        inverse += (k % base) as f64 * digit;
        k /= base;
        digit /= base as f64;
    }
    inverse
}

/// The point at height z and azimuth phi; z is clamped so that rounding never leaves the sphere.
fn point(z: f64, phi: f64) -> Direction {
    let radius = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
    let (sin, cos) = libm::sincos(phi);
    Direction::new(radius * cos, radius * sin, z).unwrap_or(Direction::OUT)
}

/// `count` Hammersley points on the sphere: z = 2t - 1, phi = 2 pi (k + 1/2) / count, t the radical
/// inverse of k in `base` (2 in the paper, 3 in the authors' program). Point 0 is the south pole.
///
/// Source: Wong, Luk, Heng, *Sampling with Hammersley and Halton Points*, 1997, `udpoint.c`.
///
/// # Panics
/// When `base` is below 2.
pub fn hammersley(count: usize, base: usize) -> Vec<Direction> {
    assert!(base >= 2, "a radical inverse needs a base of at least 2");
    (0..count)
        .map(|k| point(2.0 * radical_inverse(k, base) - 1.0, 2.0 * PI * (k as f64 + 0.5) / count as f64))
        .collect()
}

/// The first `count` points inside `cap` of the smallest Hammersley set that has as many there.
///
/// Source: the authors' `rbfcal.cpp` (MATH.md section 1.2) raises the set's size the same way.
pub fn hammersley_in(cap: Cap, count: usize, base: usize) -> Vec<Direction> {
    let mut size = count;
    loop {
        let inside: Vec<_> = hammersley(size, base).into_iter().filter(|&p| cap.contains(p)).collect();
        if inside.len() >= count {
            return inside.into_iter().take(count).collect();
        }
        // A cap of area fraction f needs about count / f points: jump close, then step.
        size += 1 + (count - inside.len()) / 2;
    }
}

/// `count` points of the golden-angle spiral on the sphere.
pub fn fibonacci(count: usize) -> Vec<Direction> {
    fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, count)
}

/// `count` points of the golden-angle spiral on `cap`, each with the same share of its area.
pub fn fibonacci_in(cap: Cap, count: usize) -> Vec<Direction> {
    let height = 1.0 - libm::cos(cap.radius);
    (0..count)
        .map(|i| {
            let z = 1.0 - height * (i as f64 + 0.5) / count as f64;
            cap.from_pole(point(z, GOLDEN_ANGLE * i as f64))
        })
        .collect()
}

/// For each point the geodesic distance to the nearest other one, radians; empty below two points.
pub fn nearest_neighbour_distances(points: &[Direction]) -> Vec<f64> {
    if points.len() < 2 {
        return Vec::new();
    }
    let nearest = |i: usize| {
        let others = points.iter().enumerate().filter(|&(j, _)| j != i);
        others.map(|(_, q)| points[i].angle_to(*q)).fold(PI, f64::min)
    };
    (0..points.len()).map(nearest).collect()
}
