//! Harmonics of many lights at a point, side by side in f32.
//!
//! Differences of positions, and of squares where a sphere is nearly touched, are taken in f64; each light has a unit of
//! length of its own, a power of two, so that all else fits f32. Blocks of lights are summed in f32, in [`LANES`] sums
//! that are added in order, blocks in f64: the same bits at every CPU level.

use super::disc_nodes::Disc;
use super::disc_pairs::{DiscLook, POINTS};
use super::harmonics::{MOST_BANDS, SLOPES, cosine_lobe};
use super::lanes::{LANES, Lanes, RECURSION, lanes, three};
use super::sphere::{zonal_slopes, zonal_values};
use super::{Light, Source};
use relight_core::vectors::{difference, length};
use relight_core::{CpuLevel, Vectorized};
use std::f64::consts::PI;

/// Batches of lights that are summed in f32.
const BLOCK: usize = 16;

/// Lights, made ready for points within a ball.
#[derive(Clone, Debug)]
pub struct Projector {
    bands: usize,
    centre: [f64; 3],
    batches: Vec<Batch>,
    /// What the batches' sums are multiplied by.
    scale: f64,
    discs: Vec<Disc>,
    /// What the discs' sums are multiplied by.
    disc_scale: f64,
    /// By band: whether its coefficients are asked for.
    is_asked: [bool; MOST_BANDS],
    /// Of lights that are the same everywhere.
    constant: Vec<[f64; 3]>,
}

/// Spheres and points, in units of their own, from the ball's middle.
#[derive(Clone, Debug)]
struct Batch {
    position: [[f64; LANES]; 3],
    /// Units in a length of the scene.
    unit: [f64; LANES],
    /// 0 for points.
    radius2: [f64; LANES],
    /// Nothing changes with the distance within it: a sphere's radius, a point's `nearest`.
    nearest2: [f64; LANES],
    /// z_l times squared distance, where it is the same for all bands.
    color: [Lanes; 3],
}

impl Projector {
    /// Makes lights, each with a factor of its colour, ready for points in a ball (its middle and radius).
    ///
    /// Points beyond the ball get the same, less exactly where lights are much nearer to them than to the ball.
    ///
    /// # Panics
    /// When `bands` is not 1 to [`MOST_BANDS`].
    pub fn new(lights: &[(&Light, f64)], bands: usize, ball: ([f64; 3], f64)) -> Self {
        super::check(bands, bands * bands);
        let mut constant = vec![[0.0; 3]; bands * bands];
        let (mut discs, mut emitters) = (Vec::new(), Vec::new());
        for &(light, factor) in lights {
            let color = light.color.map(|c| c * factor);
            match &light.source {
                Source::Sphere { centre, radius } => {
                    emitters.push(Emitter::new(*centre, *radius, *radius, color.map(|c| c * PI), ball));
                }
                Source::Point { position, nearest } => {
                    emitters.push(Emitter::new(*position, 0.0, *nearest, color, ball));
                }
                Source::Disc { centre, normal, radius } => {
                    discs.push(Disc::new(*centre, *normal, *radius, color, ball.0));
                }
                Source::Directional { .. } | Source::Probe(_) => {
                    Light { color, ..light.clone() }.add_projection(ball.0, bands, &mut constant);
                }
            }
        }
        let scale = brightest(emitters.iter().map(|emitter| emitter.color));
        let disc_scale = brightest(discs.iter().map(|disc| disc.brightness));
        let batches = emitters.chunks(LANES).map(|emitters| Batch::new(emitters, scale)).collect();
        let is_asked = [true; MOST_BANDS];
        Self { bands, centre: ball.0, batches, scale, discs, disc_scale, is_asked, constant }
    }

    /// Leaves coefficients 0 that irradiance has none of: those of the odd bands from 3 on.
    pub fn for_irradiance(mut self) -> Self {
        self.is_asked = std::array::from_fn(|l| cosine_lobe(l) != 0.0);
        self
    }

    /// Writes R, G, B of the coefficients that [`Light::add_projection`] would add up to, within 2e-6 of the largest
    /// (of a disc's within 1e-4).
    ///
    /// # Panics
    /// When `out` is not bands^2 long.
    pub fn project(&self, level: CpuLevel, point: [f64; 3], out: &mut [[f64; 3]]) {
        self.project_all(level, &[point], out);
    }

    /// As [`Self::project`] for each of some points, one after the other in `out`.
    ///
    /// Points that follow each other look at discs together, so that bits depend on what else is among `points`.
    ///
    /// # Panics
    /// When `out` is not points x bands^2 long.
    pub fn project_all(&self, level: CpuLevel, points: &[[f64; 3]], out: &mut [[f64; 3]]) {
        let functions = self.bands * self.bands;
        assert_eq!(out.len(), points.len() * functions, "a coefficient a point and function");
        for (points, out) in points.chunks(POINTS).zip(out.chunks_mut(POINTS * functions)) {
            for out in out.chunks_exact_mut(functions) {
                out.copy_from_slice(&self.constant);
            }
            let mut from = [[0.0; 3]; POINTS];
            for (from, point) in from.iter_mut().zip(points) {
                *from = difference(*point, self.centre);
            }
            let near = match &self.discs[..] {
                [] => Vec::new(),
                discs => level.run(DiscLook {
                    bands: self.bands,
                    is_asked: self.is_asked,
                    discs,
                    scale: self.disc_scale,
                    points: &from[..points.len()],
                    out,
                }),
            };
            for (&point, out) in points.iter().zip(out.chunks_exact_mut(functions)) {
                let near = near.iter().map(|&disc| &self.discs[disc]);
                self.totals::<false>(level, point, near, out, &mut []).add_values(out);
                for l in (0..self.bands).filter(|&l| !self.is_asked[l]) {
                    out[l * l..(l + 1) * (l + 1)].fill([0.0; 3]);
                }
            }
        }
    }

    /// As [`Self::project`], and slopes of coefficient i along the axis a to `gradients[i][a]`.
    ///
    /// # Panics
    /// When `values` or `gradients` are not bands^2 long.
    pub fn project_with_gradient(
        &self,
        level: CpuLevel,
        point: [f64; 3],
        values: &mut [[f64; 3]],
        gradients: &mut [[[f64; 3]; 3]],
    ) {
        super::check(self.bands, values.len());
        super::check(self.bands, gradients.len());
        values.copy_from_slice(&self.constant);
        gradients.fill([[0.0; 3]; 3]);
        let totals = self.totals::<true>(level, point, self.discs.iter(), values, gradients);
        totals.add_values(values);
        totals.add_gradients(gradients);
    }

    /// Of spheres, points and `discs`.
    fn totals<'a, const GRADIENT: bool>(
        &self,
        level: CpuLevel,
        point: [f64; 3],
        discs: impl Iterator<Item = &'a Disc>,
        values: &mut [[f64; 3]],
        gradients: &mut [[[f64; 3]; 3]],
    ) -> Totals {
        let mut totals = Totals::NONE;
        let from = difference(point, self.centre);
        for block in self.batches.chunks(BLOCK) {
            let (bands, scale, totals) = (self.bands, self.scale, &mut totals);
            level.run(Block::<GRADIENT> { bands, block, from, scale, totals });
        }
        for disc in discs {
            disc.add::<GRADIENT>(level, self.bands, point, &mut totals, values, gradients);
        }
        totals
    }
}

/// The largest channel; 1 of nothing.
fn brightest(colors: impl Iterator<Item = [f64; 3]>) -> f64 {
    let largest = colors.flatten().fold(0.0f64, |most, c| most.max(c.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}

/// A sphere or a point, in a unit of its own.
struct Emitter {
    position: [f64; 3],
    unit: f64,
    radius2: f64,
    nearest2: f64,
    color: [f64; 3],
}

impl Emitter {
    fn new(
        position: [f64; 3],
        radius: f64,
        nearest: f64,
        color: [f64; 3],
        (centre, ball): ([f64; 3], f64),
    ) -> Self {
        let position = difference(position, centre);
        let (_, exponent) = libm::frexp(length(position).max(nearest).max(ball));
        let unit = libm::ldexp(1.0, -exponent.clamp(-1000, 1000));
        let (radius, nearest) = (radius * unit, nearest * unit);
        // Of spheres z_l holds the squared sine, of points the inverse square of the scene's distance.
        let size = if radius > 0.0 { radius } else { unit };
        Self {
            position: position.map(|c| c * unit),
            unit,
            radius2: radius * radius,
            nearest2: nearest * nearest,
            color: color.map(|c| c * size * size),
        }
    }
}

impl Batch {
    fn new(emitters: &[Emitter], scale: f64) -> Self {
        // Lanes without a light: a black point one unit away.
        let mut batch = Self {
            position: [[1.0; LANES]; 3],
            unit: [0.0; LANES],
            radius2: [0.0; LANES],
            nearest2: [0.0; LANES],
            color: [[0.0; LANES]; 3],
        };
        for (i, emitter) in emitters.iter().enumerate() {
            for axis in 0..3 {
                batch.position[axis][i] = emitter.position[axis];
                batch.color[axis][i] = (emitter.color[axis] / scale) as f32;
            }
            batch.unit[i] = emitter.unit;
            batch.radius2[i] = emitter.radius2;
            batch.nearest2[i] = emitter.nearest2;
        }
        batch
    }
}

const FUNCTIONS: usize = MOST_BANDS * MOST_BANDS;
const ABOVE: usize = (MOST_BANDS + 1) * (MOST_BANDS + 1);
const BELOW: usize = (MOST_BANDS - 1) * (MOST_BANDS - 1);

/// Sums over lights of what coefficients and their slopes are made of.
pub(super) struct Totals {
    pub(super) values: [[f64; 3]; FUNCTIONS],
    /// What Y_i of band l + 1 gives to the slopes of band l, by i.
    pub(super) above: [[f64; 3]; ABOVE],
    /// What Y_i of band l - 1 gives to the slopes of band l, by i.
    pub(super) below: [[f64; 3]; BELOW],
}

impl Totals {
    const NONE: Self =
        Self { values: [[0.0; 3]; FUNCTIONS], above: [[0.0; 3]; ABOVE], below: [[0.0; 3]; BELOW] };

    fn add_values(&self, out: &mut [[f64; 3]]) {
        for (out, value) in out.iter_mut().zip(&self.values) {
            *out = [0, 1, 2].map(|c| out[c] + value[c]);
        }
    }

    /// As `Zonal::add_gradient`, for all lights at once: slopes are linear in the sums.
    fn add_gradients(&self, out: &mut [[[f64; 3]; 3]]) {
        for (axis, slopes) in SLOPES.iter().enumerate() {
            for slope in slopes {
                let l = slope.of.isqrt();
                if let Some(out) = out.get_mut(slope.from) {
                    let factor = slope.factor / (2 * l + 1) as f64;
                    out[axis] = [0, 1, 2].map(|c| out[axis][c] + factor * self.above[slope.of][c]);
                }
                if let (Some(out), Some(below)) = (out.get_mut(slope.of), self.below.get(slope.from)) {
                    out[axis] = [0, 1, 2].map(|c| out[axis][c] + slope.factor * below[c]);
                }
            }
        }
    }
}

struct Block<'a, const GRADIENT: bool> {
    bands: usize,
    block: &'a [Batch],
    /// The point, from the ball's middle.
    from: [f64; 3],
    scale: f64,
    totals: &'a mut Totals,
}

impl<const GRADIENT: bool> Vectorized for Block<'_, GRADIENT> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        match self.bands {
            1 => self.sum::<1, 1, 4, 0>(),
            2 => self.sum::<2, 4, 9, 1>(),
            3 => self.sum::<3, 9, 16, 4>(),
            4 => self.sum::<4, 16, 25, 9>(),
            5 => self.sum::<5, 25, 36, 16>(),
            6 => self.sum::<6, 36, 49, 25>(),
            _ => self.sum::<7, FUNCTIONS, ABOVE, BELOW>(),
        }
    }
}

impl<const GRADIENT: bool> Block<'_, GRADIENT> {
    /// `N`, `UP` and `DOWN` are the squares of `BANDS`, one more and one less.
    #[inline(always)]
    fn sum<const BANDS: usize, const N: usize, const UP: usize, const DOWN: usize>(self) {
        let mut values = [[[0.0f32; LANES]; 3]; N];
        let mut above = [[[0.0f32; LANES]; 3]; UP];
        let mut below = [[[0.0f32; LANES]; 3]; DOWN];
        let mut functions = [[0.0f32; LANES]; UP];
        for batch in self.block {
            let seen = Seen::new::<GRADIENT>(batch, self.from);
            let bands = if GRADIENT { BANDS + 1 } else { BANDS };
            RECURSION.evaluate(bands, &seen.direction, &mut functions);
            for l in 0..BANDS {
                add_band(&mut values, &functions, l, &batch.color, &seen.values[l]);
                if GRADIENT {
                    add_band(&mut above, &functions, l + 1, &batch.color, &seen.above[l]);
                    if l > 0 {
                        add_band(&mut below, &functions, l - 1, &batch.color, &seen.below[l]);
                    }
                }
            }
        }
        flush(&values, self.scale, &mut self.totals.values);
        if GRADIENT {
            flush(&above, self.scale, &mut self.totals.above);
            flush(&below, self.scale, &mut self.totals.below);
        }
    }
}

/// Adds a band's functions by `color` and `weight`.
#[inline(always)]
fn add_band(sums: &mut [[Lanes; 3]], functions: &[Lanes], l: usize, color: &[Lanes; 3], weight: &Lanes) {
    let colors = three!(|c| lanes!(|i| color[c][i] * weight[i]));
    for at in l * l..(l + 1) * (l + 1) {
        for c in 0..3 {
            let sum = &mut sums[at][c];
            *sum = lanes!(|i| sum[i] + colors[c][i] * functions[at][i]);
        }
    }
}

/// The sum of all lanes, by halves.
#[inline(always)]
pub(super) fn lane_sum(lanes: &Lanes) -> f64 {
    let mut wide = [0.0f64; LANES];
    for (wide, &lane) in wide.iter_mut().zip(lanes) {
        *wide = f64::from(lane);
    }
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            wide[i] += wide[i + half];
        }
        half /= 2;
    }
    wide[0]
}

#[inline(always)]
pub(super) fn flush(sums: &[[Lanes; 3]], scale: f64, totals: &mut [[f64; 3]]) {
    for (total, sum) in totals.iter_mut().zip(sums) {
        for (total, sum) in total.iter_mut().zip(sum) {
            *total += scale * lane_sum(sum);
        }
    }
}

/// Squared distances below it count as 0.
const TOUCHING: f32 = 1e-36;

/// A batch as a point sees it.
struct Seen {
    direction: [Lanes; 3],
    /// z_l over pi and the batch's colours.
    values: [Lanes; MOST_BANDS],
    /// What band l + 1 gives to the slopes of band l.
    above: [Lanes; MOST_BANDS],
    /// What band l - 1 gives to them.
    below: [Lanes; MOST_BANDS],
}

impl Seen {
    #[inline(always)]
    fn new<const GRADIENT: bool>(batch: &Batch, from: [f64; 3]) -> Self {
        let mut seen = Self {
            direction: [[0.0; LANES]; 3],
            values: [[0.0; LANES]; MOST_BANDS],
            above: [[0.0; LANES]; MOST_BANDS],
            below: [[0.0; LANES]; MOST_BANDS],
        };
        let (mut d2, mut tangent2, mut beyond2) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let unit = batch.unit[i];
            let v = three!(|a| batch.position[a][i] - from[a] * unit);
            let square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            seen.direction[0][i] = v[0] as f32;
            seen.direction[1][i] = v[1] as f32;
            seen.direction[2][i] = v[2] as f32;
            d2[i] = square as f32;
            tangent2[i] = (square - batch.radius2[i]) as f32;
            beyond2[i] = (square - batch.nearest2[i]) as f32;
        }
        for i in 0..LANES {
            let away = d2[i] > TOUCHING;
            let inverse = 1.0 / d2[i].max(TOUCHING);
            let nearness = inverse.sqrt();
            seen.direction[0][i] *= nearness;
            seen.direction[1][i] *= nearness;
            let z = seen.direction[2][i] * nearness;
            // In its very middle a light is seen towards +z and has no slope.
            seen.direction[2][i] = if away { z } else { 1.0 };
            let fall_off = 1.0 / d2[i].max(batch.nearest2[i] as f32).max(TOUCHING);
            // The squared sine of half the angle that it fills, 0 for points, and the cosine.
            let q = batch.radius2[i] as f32 * fall_off;
            let c = (tangent2[i].max(0.0) * inverse).sqrt();
            let z = zonal_values!(q, c);
            for (values, z) in seen.values.iter_mut().zip(z) {
                values[i] = fall_off * z;
            }
            if GRADIENT {
                let odd = if beyond2[i] > 0.0 { 2.0 } else { 0.0 };
                let even = if c > 0.0 { odd / c } else { 0.0 };
                let g = zonal_slopes!(q, |p| even * p, odd * p);
                let steepness = fall_off * nearness * batch.unit[i] as f32;
                let steepness = if away { steepness } else { 0.0 };
                for (l, (g, z)) in g.into_iter().zip(z).enumerate() {
                    let (up, down) = (l as f32, (l + 1) as f32);
                    seen.above[l][i] = steepness * (g + up * z);
                    seen.below[l][i] = steepness * (g - down * z) * (1.0 / (up + down));
                }
            }
        }
        seen
    }
}
