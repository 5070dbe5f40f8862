//! The highlight of a lamp on a mirror sphere, to a part of a pixel.

use super::{LuminancePicture, MirrorSphere, Ray, SphereOutline, Viewer};
use crate::median;
use relight_core::vectors::unit;
use std::collections::VecDeque;

/// A lamp as a sphere shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// From where on the sphere, and to where.
    pub ray: Ray,
    /// Its middle in pixels from the top left of the picture.
    pub at: [f64; 2],
    /// How much its brightest pixel exceeds the median of the sphere.
    pub contrast: f64,
    /// Light in the second brightest spot of the sphere as a part of this one's, 0..1.
    pub rival: f64,
}

/// The part of the outline's radius that is searched: the rim mixes with what lies behind.
const SEARCHED: f64 = 0.98;

/// A highlight is at least so many times as bright as the sphere's median.
const LEAST_RATIO: f64 = 2.0;

/// A spot of more than this part of the sphere's disc is no lamp but a bright room.
const LARGEST: f64 = 0.1;

/// Pixels around a spot whose light is counted, for its blurred rim.
const RIM: usize = 2;

/// Finds the brightest spot within `outline`: of the connected pixels above half of the contrast those with the most light.
///
/// Only the part of the sphere that shows what is above the plane z = 0 is searched: around it the sphere shows the plane itself,
/// which near a lamp can be as bright as its highlight and much larger.
///
/// The mean direction of all its pixels, each weighed by its light above the surroundings', is that of the lamp's middle also where
/// the sphere bends a large lamp to a crescent: seen from far a mirror sphere shows equal solid angles in equal areas.
///
/// `picture` holds the outline's disc as far as it is in the picture; `size` is that of the whole picture. `None` where nothing
/// stands out, or the spot is larger than a lamp.
pub fn find_highlight(
    picture: &LuminancePicture,
    outline: &SphereOutline,
    sphere: &MirrorSphere,
    size: (usize, usize),
    viewer: Viewer,
) -> Option<Highlight> {
    let (width, count) = (picture.width, picture.values.len());
    let middle =
        |at: usize| [(picture.left + at % width) as f64 + 0.5, (picture.top + at / width) as f64 + 0.5];
    let reach = SEARCHED * outline.radius;
    let inside: Vec<bool> = (0..count)
        .map(|at| {
            let place = middle(at);
            let (x, y) = (place[0] - outline.x, place[1] - outline.y);
            let ray =
                if x * x + y * y <= reach * reach { sphere.reflection(place, size, viewer) } else { None };
            ray.is_some_and(|ray| ray.direction[2] > 0.0)
        })
        .collect();
    let disc = || (0..count).filter(|&at| inside[at]);
    let mut values: Vec<f32> = disc().map(|at| picture.values[at]).collect();
    let middle_value = median(&mut values, f32::total_cmp)?;
    let peak = disc().map(|at| picture.values[at]).fold(f32::NEG_INFINITY, f32::max);
    let contrast = f64::from(peak) - f64::from(middle_value);
    if contrast <= 0.0 || f64::from(peak) < LEAST_RATIO * f64::from(middle_value) {
        return None;
    }
    let threshold = middle_value + 0.5 * (peak - middle_value);

    let mut spots = spots(width, &inside, |at| picture.values[at] >= threshold);
    let light = |spot: &Vec<usize>| -> f64 {
        spot.iter().map(|&at| f64::from(picture.values[at] - middle_value)).sum()
    };
    // The first of equals, in rows from the top.
    spots.sort_by(|a, b| light(b).total_cmp(&light(a)));
    let spot = spots.first()?;
    if spot.len() as f64 > LARGEST * disc().count() as f64 {
        return None;
    }
    let rival = spots.get(1).map_or(0.0, |second| light(second) / light(spot));

    let distance = distances(width, count, spot, 2 * RIM + 1);
    let ring = (0..count).filter(|&at| inside[at] && distance[at] > RIM && distance[at] <= 2 * RIM);
    let mut values: Vec<f32> = ring.map(|at| picture.values[at]).collect();
    let around = median(&mut values, f32::total_cmp).unwrap_or(middle_value);
    let (mut total, mut at_sum, mut origin, mut direction) = (0.0, [0.0; 2], [0.0; 3], [0.0; 3]);
    for at in (0..count).filter(|&at| inside[at] && distance[at] <= RIM) {
        let place = middle(at);
        let Some(ray) = sphere.reflection(place, size, viewer) else { continue };
        let weight = f64::from(picture.values[at]) - f64::from(around);
        total += weight;
        for c in 0..3 {
            origin[c] += weight * ray.origin[c];
            direction[c] += weight * ray.direction[c];
        }
        for c in 0..2 {
            at_sum[c] += weight * place[c];
        }
    }
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let ray = Ray { origin: origin.map(|c| c / total), direction: unit(direction)? };
    Some(Highlight { ray, at: at_sum.map(|c| c / total), contrast, rival })
}

/// Sets of pixels that touch each other, by an edge or a corner, in the order of their first pixels.
fn spots(width: usize, inside: &[bool], is_bright: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let mut taken: Vec<bool> = (0..inside.len()).map(|at| !(inside[at] && is_bright(at))).collect();
    let mut spots = Vec::new();
    for first in 0..taken.len() {
        if std::mem::replace(&mut taken[first], true) {
            continue;
        }
        let (mut spot, mut next) = (vec![first], 0);
        while let Some(&at) = spot.get(next) {
            next += 1;
            for neighbour in neighbours(width, taken.len(), at) {
                if !std::mem::replace(&mut taken[neighbour], true) {
                    spot.push(neighbour);
                }
            }
        }
        spots.push(spot);
    }
    spots
}

/// Steps from each pixel to `spot`, `limit` where they are as many or more.
fn distances(width: usize, count: usize, spot: &[usize], limit: usize) -> Vec<usize> {
    let mut distance = vec![limit; count];
    let mut queue = VecDeque::new();
    for &at in spot {
        distance[at] = 0;
        queue.push_back(at);
    }
    while let Some(at) = queue.pop_front() {
        for neighbour in neighbours(width, count, at) {
            if distance[at] + 1 < distance[neighbour] {
                distance[neighbour] = distance[at] + 1;
                queue.push_back(neighbour);
            }
        }
    }
    distance
}

/// The up to eight pixels around `at`.
fn neighbours(width: usize, count: usize, at: usize) -> impl Iterator<Item = usize> {
    let (x, y, height) = (at % width, at / width, count / width);
    (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |row| {
        (x.saturating_sub(1)..(x + 2).min(width)).map(move |column| row * width + column)
    })
}
