//! The outlines of spheres in a picture.
//!
//! Source: Duda and Hart, *Use of the Hough transformation to detect lines and curves in pictures*, 1972, with votes along the
//! gradient only; the circles it proposes are then measured at full size, and those kept whose edge goes nearly all around.

use super::{LuminancePicture, SphereOutline};
use crate::median;
use nalgebra::{Matrix3, Vector3};

/// An outline and how much of it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundOutline {
    /// The circle.
    pub outline: SphereOutline,
    /// The part of the circle, 0..1, along which an edge lies within 0.006 of the radius (at least a pixel).
    pub support: f64,
}

/// Outlines that are seen along less than this part aren't trusted: textures give circles of a half by chance.
pub const LEAST_SUPPORT: f64 = 0.7;

/// The longer side of the picture in which circles are proposed.
const PROPOSING: usize = 256;

/// The least radius there, in pixels.
const LEAST_RADIUS: usize = 5;

/// The part of pixels that are taken as edges.
const EDGES: f64 = 0.12;

/// Circles that are measured.
const PROPOSED: usize = 24;

/// Directions in which an outline is measured.
const RAYS: usize = 360;

/// Rounds of measuring and fitting.
const ROUNDS: usize = 4;

/// The part of the radius that is searched inwards and outwards of a proposed circle.
const SEARCHED: f64 = 0.15;

/// The same for circles about a middle that is known.
const NARROW: f64 = 0.035;

/// The part of the radius by which an edge may be off the circle; perspective makes ellipses of that order.
const ROUND: f64 = 0.006;

/// Support of a larger circle about the middle of one that is trusted; by chance edges make 0.3.
const OUTER_SUPPORT: f64 = 0.6;

/// Finds circles with an edge around at least [`LEAST_SUPPORT`] of them that don't overlap, those of most support first.
///
/// `picture` is the whole picture, best the mean of all.
pub fn find_outlines(picture: &LuminancePicture) -> Vec<FoundOutline> {
    // Roots spread dark tones as eyes and codes do.
    let values: Vec<f32> = picture.values.iter().map(|value| value.max(0.0).sqrt()).collect();
    let tones = Tones { width: picture.width, height: picture.height(), values };
    let factor = tones.width.max(tones.height).div_ceil(PROPOSING).max(1);
    let reach = |radius: f64| (SEARCHED * radius).max(2.0 * factor as f64 + 2.0);
    let mut found: Vec<FoundOutline> = proposals(&tones.reduced(factor))
        .into_iter()
        .map(|circle| circle.map(|length| length * factor as f64))
        .filter_map(|circle| measured(&tones, circle, reach(circle[2])))
        .filter(|found| found.support >= LEAST_SUPPORT)
        .collect();
    found.sort_by(|a, b| b.support.total_cmp(&a.support));
    let mut kept: Vec<FoundOutline> = Vec::new();
    for candidate in found {
        let outermost = outermost(&tones, candidate);
        let overlaps = |other: &FoundOutline| {
            let (a, b) = (&other.outline, &outermost.outline);
            let (x, y, reach) = (a.x - b.x, a.y - b.y, a.radius + b.radius);
            x * x + y * y < reach * reach
        };
        if !kept.iter().any(overlaps) {
            kept.push(outermost);
        }
    }
    kept
}

/// The largest circle about the middle of `found` that is seen along [`OUTER_SUPPORT`] of it: a sphere on a table shows the table's
/// horizon as a sharper circle than its rim, at 0.71 of its radius.
fn outermost(tones: &Tones, found: FoundOutline) -> FoundOutline {
    let SphereOutline { x, y, radius, .. } = found.outline;
    let (steps, mut best) = (60, found);
    for step in (1..=steps).rev() {
        let larger = radius * (1.05 + 0.75 * f64::from(step) / f64::from(steps));
        let Some(outer) = measured(tones, [x, y, larger], (NARROW * larger).max(3.5)) else { continue };
        let moved = (outer.outline.x - x).abs().max((outer.outline.y - y).abs());
        let is_outer = moved <= 0.05 * radius && outer.outline.radius > 1.04 * radius;
        if is_outer && outer.support >= OUTER_SUPPORT {
            best = FoundOutline { support: found.support, ..outer };
            break;
        }
    }
    best
}

/// A picture of tones.
struct Tones {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Tones {
    /// Means of `factor` by `factor` pixels; what is left over at the right and at the bottom is cut.
    fn reduced(&self, factor: usize) -> Self {
        let (width, height) = ((self.width / factor).max(1), (self.height / factor).max(1));
        let mean = |at: usize| {
            let (left, top) = (at % width * factor, at / width * factor);
            let rows = (top..(top + factor).min(self.height)).map(|y| y * self.width);
            let sum: f32 = rows
                .flat_map(|row| (left..(left + factor).min(self.width)).map(move |x| row + x))
                .map(|at| self.values[at])
                .sum();
            sum / (factor * factor) as f32
        };
        Self { width, height, values: (0..width * height).map(mean).collect() }
    }

    /// The tone at a place, bilinear between the pixels' middles; `None` outside them.
    fn at(&self, x: f64, y: f64) -> Option<f64> {
        let (x, y) = (x - 0.5, y - 0.5);
        if !(x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f64 && y <= (self.height - 1) as f64) {
            return None;
        }
        let (column, row) =
            ((x as usize).min(self.width.saturating_sub(2)), (y as usize).min(self.height.saturating_sub(2)));
        let (right, below) = (x - column as f64, y - row as f64);
        let tone = |dx: usize, dy: usize| {
            let (column, row) = ((column + dx).min(self.width - 1), (row + dy).min(self.height - 1));
            f64::from(self.values[row * self.width + column])
        };
        let upper = tone(0, 0) + right * (tone(1, 0) - tone(0, 0));
        let lower = tone(0, 1) + right * (tone(1, 1) - tone(0, 1));
        Some(upper + below * (lower - upper))
    }
}

/// Circles (x, y, radius) with the most votes for each of their pixels, no two alike.
fn proposals(tones: &Tones) -> Vec<[f64; 3]> {
    let Tones { width, height, values } = tones;
    let (width, height) = (*width, *height);
    let most = width.min(height) / 2;
    if most < LEAST_RADIUS + 1 {
        return Vec::new();
    }
    let mut edges = Vec::new();
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let tone = |dx: usize, dy: usize| f64::from(values[(y + dy - 1) * width + x + dx - 1]);
            let gx = tone(2, 0) + 2.0 * tone(2, 1) + tone(2, 2) - tone(0, 0) - 2.0 * tone(0, 1) - tone(0, 2);
            let gy = tone(0, 2) + 2.0 * tone(1, 2) + tone(2, 2) - tone(0, 0) - 2.0 * tone(1, 0) - tone(2, 0);
            let strength = (gx * gx + gy * gy).sqrt();
            if strength > 0.0 {
                edges.push((strength, x as f64, y as f64, gx / strength, gy / strength));
            }
        }
    }
    edges.sort_by(|a, b| b.0.total_cmp(&a.0));
    edges.truncate((EDGES * (width * height) as f64) as usize);

    let mut votes: Vec<([f64; 3], f64)> = Vec::new();
    let mut layers: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; width * height]);
    for radius in LEAST_RADIUS..=most + 1 {
        // Votes of three radii side by side make one score: an edge is rarely a whole number away.
        layers.rotate_left(1);
        layers[2].fill(0.0);
        for &(_, x, y, gx, gy) in &edges {
            for side in [-1.0, 1.0] {
                let (x, y) = (x + side * radius as f64 * gx + 0.5, y + side * radius as f64 * gy + 0.5);
                if x >= 0.0 && y >= 0.0 && (x as usize) < width && (y as usize) < height {
                    layers[2][y as usize * width + x as usize] += 1.0;
                }
            }
        }
        if radius < LEAST_RADIUS + 2 {
            continue;
        }
        let score = |at: usize| {
            let near = [
                at - width - 1,
                at - width,
                at - width + 1,
                at - 1,
                at,
                at + 1,
                at + width - 1,
                at + width,
                at + width + 1,
            ];
            let sum: f32 = layers.iter().map(|layer| near.iter().map(|&at| layer[at]).sum::<f32>()).sum();
            f64::from(sum) / (radius - 1) as f64
        };
        let places = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| y * width + x));
        let best = places.map(|at| (score(at), at)).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        if let Some((first, _)) = best {
            let near_best = (1..height - 1).flat_map(|y| (1..width - 1).map(move |x| y * width + x));
            let all = near_best.map(|at| (score(at), at)).filter(|&(score, _)| score >= 0.6 * first);
            votes.extend(all.map(|(score, at)| {
                ([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5, (radius - 1) as f64], score)
            }));
        }
    }
    votes.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut chosen: Vec<[f64; 3]> = Vec::new();
    for (circle, _) in votes {
        let alike = |other: &[f64; 3]| {
            let apart = (0..2).map(|c| (other[c] - circle[c]).powi(2)).sum::<f64>().sqrt();
            apart < 0.2 * circle[2] + 2.0 && (other[2] - circle[2]).abs() < 0.1 * circle[2] + 1.0
        };
        if !chosen.iter().any(alike) {
            chosen.push(circle);
            if chosen.len() == PROPOSED {
                break;
            }
        }
    }
    chosen
}

/// Fits a circle to the edge within `reach` pixels of a proposed one; `None` where there is none.
fn measured(tones: &Tones, [mut x, mut y, mut radius]: [f64; 3], reach: f64) -> Option<FoundOutline> {
    let mut support = 0.0;
    for round in 0..ROUNDS {
        let reach = match round {
            0 => reach,
            _ => (0.5 * reach).max(3.5),
        };
        let edge: Vec<[f64; 2]> =
            (0..RAYS).filter_map(|ray| edge_along(tones, [x, y], radius, reach, ray)).collect();
        if edge.len() < RAYS / 2 {
            return None;
        }
        let allowed = (ROUND * radius).max(1.0);
        let mut kept = edge.clone();
        for _ in 0..ROUNDS {
            [x, y, radius] = circle_through(&kept)?;
            let off = |at: &[f64; 2]| {
                let (dx, dy) = (at[0] - x, at[1] - y);
                ((dx * dx + dy * dy).sqrt() - radius).abs()
            };
            let mut distances: Vec<f64> = edge.iter().map(off).collect();
            let usual = median(&mut distances, f64::total_cmp)?;
            support = edge.iter().filter(|at| off(at) <= allowed).count() as f64 / RAYS as f64;
            kept = edge.iter().filter(|at| off(at) <= (2.5 * usual).max(0.5)).copied().collect();
        }
    }
    let inside = x - radius > -0.5
        && y - radius > -0.5
        && x + radius < tones.width as f64 + 0.5
        && y + radius < tones.height as f64 + 0.5;
    (inside && radius >= 4.0)
        .then_some(FoundOutline { outline: SphereOutline { x, y, radius, rise: None }, support })
}

/// Where tones change most along a ray from the middle, to a part of a pixel.
fn edge_along(tones: &Tones, [x, y]: [f64; 2], radius: f64, reach: f64, ray: usize) -> Option<[f64; 2]> {
    const STEP: f64 = 0.5;
    let (sine, cosine) = libm::sincos(ray as f64 * std::f64::consts::TAU / RAYS as f64);
    let first = (radius - reach).max(1.0);
    let steps = ((radius + reach - first) / STEP) as usize;
    let change = |step: usize| {
        let way = first + STEP * step as f64;
        let tone = |way: f64| tones.at(x + way * cosine, y + way * sine);
        Some((tone(way + 1.0)? - tone(way - 1.0)?).abs())
    };
    let changes: Vec<f64> = (0..=steps).map(|step| change(step).unwrap_or(0.0)).collect();
    let (best, &most) = changes.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)))?;
    if most <= 0.0 || best == 0 || best == steps {
        return None;
    }
    // The middle of what changes, as a parabola's top jumps with pixels.
    let (mut sum, mut weighted) = (0.0, 0.0);
    let window = (2.0 / STEP) as usize;
    for (step, change) in changes.iter().enumerate().take(best + window + 1).skip(best.saturating_sub(window))
    {
        sum += change;
        weighted += change * step as f64;
    }
    let way = first + STEP * weighted / sum;
    Some([x + way * cosine, y + way * sine])
}

/// The circle `x^2 + y^2 = a x + b y + c` of least squares through points.
///
/// Source: Kasa, *A circle fitting procedure and its error analysis*, 1976; its bias is small where points go all around.
fn circle_through(points: &[[f64; 2]]) -> Option<[f64; 3]> {
    let count = points.len() as f64;
    let middle: [f64; 2] = std::array::from_fn(|c| points.iter().map(|point| point[c]).sum::<f64>() / count);
    let mut matrix = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    for point in points {
        let row = Vector3::new(point[0] - middle[0], point[1] - middle[1], 1.0);
        matrix += row * row.transpose();
        right += row * (row[0] * row[0] + row[1] * row[1]);
    }
    let found = matrix.cholesky()?.solve(&right);
    let (x, y) = (0.5 * found[0], 0.5 * found[1]);
    let square = found[2] + x * x + y * y;
    (square > 0.0).then(|| [x + middle[0], y + middle[1], square.sqrt()])
}
