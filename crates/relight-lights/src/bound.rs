//! Bounds of what a light can add to a tile, so that lights which can't be seen there are not evaluated.

use crate::scene::{Attenuation, Lamp, Light};
use relight_core::basis::ptm_exponents;
use relight_core::vectors::{difference, dot, length, scaled};
use relight_core::{
    Basis, CpuLevel, PlaneRole, PositionMap, RelightingMap, RelightingMaps, SKY, Space, Texels, Vectorized,
    linear_from_srgb,
};
use std::f64::consts::PI;

/// The largest absolute value that a relit sample of each channel can have in the asset's own space, whatever
/// the direction: the sum over functions of max |b_j| max |c_j|, times the largest base colour.
///
/// |b_j| is at most 1 for SRBF and PTM (monomials of numbers up to 1), sqrt((2l + 1) / 4 pi) for SH (addition
/// theorem) and sqrt((2l + 1) / 2 pi) for HSH, which are SH with a stretched angle; of a table it is at most
/// that of its nodes. Coefficients lie between
/// the ends of 8-bit ranges; those of halves and floats are looked at.
pub(crate) fn largest_samples(maps: &RelightingMaps) -> [f64; 3] {
    let functions: Vec<f64> =
        (0..maps.model.basis.count()).map(|j| largest_value(&maps.model.basis, j)).collect();
    let mean = |function: Option<u16>| function.map_or(0.0, |f| functions[usize::from(f)]);
    let (mut sums, mut factors) = (maps.model.mean_functions().map(mean), [1.0; 3]);
    for (role, plane) in maps.model.roles().into_iter().zip(&maps.planes) {
        let largest = largest_coefficient(plane);
        match role {
            PlaneRole::Coefficient { functions: by_channel } => {
                for (sum, function) in sums.iter_mut().zip(by_channel) {
                    *sum += function.map_or(0.0, |f| functions[usize::from(f)] * largest);
                }
            }
            PlaneRole::BaseColor { channel } => factors[usize::from(channel)] = largest,
        }
    }
    if maps.model.channels() == 1 {
        sums = [sums[0]; 3];
    }
    [0, 1, 2].map(|c| {
        let sample = sums[c] * factors[c];
        match maps.model.space {
            Space::Linear => sample,
            Space::Encoded => f64::from(linear_from_srgb(sample as f32)) * (1.0 + 1e-5),
        }
    })
}

fn largest_value(basis: &Basis, j: usize) -> f64 {
    let l = j.isqrt() as f64;
    match basis {
        Basis::Srbf(_) => 1.0,
        Basis::Ptm(_) => {
            // |u|^p |v|^q on the unit circle is largest where u^2 : v^2 = p : q.
            let (p, q) = ptm_exponents(j);
            let (p, q, sum) = (f64::from(p), f64::from(q), f64::from(p + q));
            let part = |e: f64| if e == 0.0 { 1.0 } else { libm::pow(e / sum, 0.5 * e) };
            part(p) * part(q)
        }
        Basis::Sh(_) => ((2.0 * l + 1.0) / (4.0 * PI)).sqrt(),
        Basis::Hsh(_) => ((2.0 * l + 1.0) / (2.0 * PI)).sqrt(),
        Basis::Learned(learned) => {
            let column = learned.table().iter().skip(j).step_by(basis.count());
            column.fold(0.0, |largest, value| largest.max(f64::from(value.abs())))
        }
    }
}

fn largest_coefficient(plane: &RelightingMap) -> f64 {
    let (scale, bias) = (f64::from(plane.scale), f64::from(plane.bias));
    let of = |values: &mut dyn Iterator<Item = f32>| {
        values.fold(0.0f64, |largest, q| largest.max((scale * f64::from(q) + bias).abs()))
    };
    match &plane.texels {
        Texels::U8(_) => of(&mut [0.0, 1.0].into_iter()),
        Texels::F16(texels) => of(&mut texels.iter().map(|q| q.to_f32())),
        Texels::F32(texels) => of(&mut texels.iter().copied()),
    }
}

/// Where the surfaces of a tile are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    /// Least and largest coordinates of the pixels that are neither sky nor without a surface.
    near: Option<([f64; 3], [f64; 3])>,
    /// Whether some pixels are sky.
    sky: bool,
}

impl Box3 {
    pub(crate) fn new() -> Self {
        Self { near: None, sky: false }
    }

    /// Adds rows of `pixels` pixels, of which the first begins at `first`.
    pub(crate) fn add(
        &mut self,
        level: CpuLevel,
        map: &PositionMap,
        first: usize,
        (rows, pixels): (usize, usize),
    ) {
        let points = map.points[first..first + (rows - 1) * map.width + pixels].as_flattened();
        let ([least, largest], farthest) =
            level.run(Extent { points, row: 3 * pixels, stride: 3 * map.width });
        self.sky |= farthest > FAR;
        if least.iter().zip(&largest).all(|(least, largest)| least <= largest) {
            let (low, high) = (least.map(f64::from), largest.map(f64::from));
            let (least, largest) = self.near.get_or_insert((low, high));
            for i in 0..3 {
                least[i] = least[i].min(low[i]);
                largest[i] = largest[i].max(high[i]);
            }
        }
    }

    /// The strongest that `light` can be at a pixel of the box: intensity and attenuation together, 0 where
    /// a spot doesn't reach.
    pub(crate) fn strength(&self, light: &Light) -> f64 {
        let Some(position) = light.position() else { return light.intensity };
        let near = self.near.map_or(0.0, |(least, largest)| {
            let mut squared = 0.0;
            for i in 0..3 {
                let beyond = (least[i] - position[i]).max(position[i] - largest[i]).max(0.0);
                squared += beyond * beyond;
            }
            let distance = squared.sqrt();
            if self.is_beyond_the_cone(light, position) { 0.0 } else { strongest(light, distance) }
        });
        // From anywhere a lamp may stand, up to 1e9 from the origin, to the sky.
        let far = if self.sky { strongest(light, 0.5e-3 * SKY) } else { 0.0 };
        // Distances are rounded in f32 when the light is evaluated.
        near.max(far) * (1.0 + 1e-5)
    }

    /// Whether the sphere around the box lies outside the cone of a spot.
    fn is_beyond_the_cone(&self, light: &Light, position: [f64; 3]) -> bool {
        let (Lamp::Spot(spot), Some((least, largest))) = (&light.lamp, self.near) else { return false };
        let middle = [0, 1, 2].map(|i| 0.5 * (least[i] + largest[i]) - position[i]);
        let radius = 0.5 * length(difference(largest, least));
        let distance = length(middle);
        if distance <= radius {
            return false;
        }
        let axis = spot.axis.components();
        let along = dot(middle, axis);
        let across = length(difference(middle, scaled(axis, along)));
        // With a margin for rounding of f32.
        libm::atan2(across, along) - libm::asin((radius / distance).min(1.0)) > spot.cone + 1e-3
    }
}

/// Coordinates beyond this are the sky's.
const FAR: f32 = (SKY / 1e3) as f32;

/// Whole points in whole vectors.
const LANES: usize = 48;

/// What is known of the coordinates at each place of a vector.
struct Lanes {
    least: [f32; LANES],
    largest: [f32; LANES],
    farthest: [f32; LANES],
}

impl Lanes {
    /// All comparisons are false for NaN, which changes nothing.
    #[inline(always)]
    fn add(&mut self, points: &[f32; LANES]) {
        for (i, &value) in points.iter().enumerate() {
            let far = value.abs();
            let near = far <= FAR;
            self.least[i] = if near & (value < self.least[i]) { value } else { self.least[i] };
            self.largest[i] = if near & (value > self.largest[i]) { value } else { self.largest[i] };
            self.farthest[i] = if far > self.farthest[i] { far } else { self.farthest[i] };
        }
    }
}

/// The least and the largest coordinates of points, x, y, z one after another, by axis, and the largest
/// magnitude. Coordinates of the sky and what is no number are left out one by one: a sky's other
/// coordinates make the box only larger.
struct Extent<'a> {
    points: &'a [f32],
    /// Coordinates of a row, and from the beginning of one to that of the next.
    row: usize,
    stride: usize,
}

impl Vectorized for Extent<'_> {
    type Output = ([[f32; 3]; 2], f32);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let mut lanes = Lanes {
            least: [f32::INFINITY; LANES],
            largest: [f32::NEG_INFINITY; LANES],
            farthest: [0.0; LANES],
        };
        for row in self.points.chunks(self.stride) {
            let (whole, rest) = row[..self.row].as_chunks();
            for points in whole {
                lanes.add(points);
            }
            if !rest.is_empty() {
                let mut points = [f32::NAN; LANES];
                points[..rest.len()].copy_from_slice(rest);
                lanes.add(&points);
            }
        }
        let Lanes { least, largest, farthest } = lanes;
        let of_axis = |values: [f32; LANES], choose: fn(f32, f32) -> f32| {
            [0, 1, 2].map(|axis| values[axis..].iter().step_by(3).copied().fold(values[axis], choose))
        };
        ([of_axis(least, f32::min), of_axis(largest, f32::max)], farthest.into_iter().fold(0.0, f32::max))
    }
}

/// Intensity and attenuation at `distance` or further.
fn strongest(light: &Light, distance: f64) -> f64 {
    let factor = match (light.attenuation, &light.lamp) {
        // The disc's solid angle at its surface is all that it can be: 2 / r^2, and at least 1 / d^2 beyond.
        (Attenuation::InverseSquare { .. }, Lamp::Sphere { radius, .. }) => {
            let sine2 = (radius / distance.max(*radius)).powi(2);
            2.0 / (radius * radius) * sine2 / (1.0 + (1.0 - sine2).sqrt())
        }
        (attenuation, _) => attenuation.factor(distance.max(f64::from(crate::lamps::AT_THE_SURFACE))),
    };
    let gobo = match &light.lamp {
        Lamp::Spot(spot) => spot.gobo.as_ref().filter(|gobo| gobo.on).map_or(1.0, |gobo| {
            gobo.picture.samples.iter().fold(0.0f64, |largest, value| largest.max(f64::from(value.abs())))
        }),
        _ => 1.0,
    };
    light.intensity * factor * gobo
}

/// Which of the lights with these bounds need not be evaluated: the weakest, as long as all of them together
/// stay within `allowed`.
pub(crate) fn negligible(bounds: &[f64], allowed: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..bounds.len()).collect();
    order.sort_by(|&a, &b| bounds[a].total_cmp(&bounds[b]));
    let (mut skipped, mut sum) = (vec![false; bounds.len()], 0.0);
    for index in order {
        sum += bounds[index];
        // Not true for NaN: such a light is evaluated.
        if sum <= allowed {
            skipped[index] = true;
        } else {
            break;
        }
    }
    skipped
}
