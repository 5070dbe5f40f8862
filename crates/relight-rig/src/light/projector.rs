//! Harmonics of many lights at a point, side by side in f32.
//!
//! Differences of positions, and of squares where a sphere is nearly touched, are taken in f64; each light has a unit of
//! length of its own, a power of two, so that all else fits f32. Blocks of lights are summed in f32, in [`LANES`] sums
//! that are added in order, blocks in f64: the same bits at every CPU level.

use super::disc_nodes::Disc;
use super::harmonics::{MOST_BANDS, SLOPES};
use super::lanes::{LANES, Lanes, RECURSION, lanes};
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
    nearest2: Lanes,
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
        let mut discs = Vec::new();
        let mut emitters = Vec::new();
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
                    discs.push(Disc::new(*centre, *normal, *radius, color));
                }
                Source::Directional { .. } | Source::Probe(_) => {
                    Light { color, ..light.clone() }.add_projection(ball.0, bands, &mut constant);
                }
            }
        }
        let brightest = emitters.iter().flat_map(|e| e.color).fold(0.0f64, |a, c| a.max(c.abs()));
        let scale = if brightest > 0.0 { brightest } else { 1.0 };
        let batches = emitters.chunks(LANES).map(|emitters| Batch::new(emitters, scale)).collect();
        Self { bands, centre: ball.0, batches, scale, discs, constant }
    }

    /// Writes R, G, B of the coefficients that [`Light::add_projection`] would add up to, within 2e-6 of the largest
    /// (of a disc's within 1e-4).
    ///
    /// # Panics
    /// When `out` is not bands^2 long.
    pub fn project(&self, level: CpuLevel, point: [f64; 3], out: &mut [[f64; 3]]) {
        super::check(self.bands, out.len());
        out.copy_from_slice(&self.constant);
        let totals = self.totals::<false>(level, point, out, &mut []);
        totals.add_values(out);
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
        let totals = self.totals::<true>(level, point, values, gradients);
        totals.add_values(values);
        totals.add_gradients(gradients);
    }

    fn totals<const GRADIENT: bool>(
        &self,
        level: CpuLevel,
        point: [f64; 3],
        values: &mut [[f64; 3]],
        gradients: &mut [[[f64; 3]; 3]],
    ) -> Totals {
        let mut totals = Totals::NONE;
        let from = difference(point, self.centre);
        for block in self.batches.chunks(BLOCK) {
            let (bands, scale, totals) = (self.bands, self.scale, &mut totals);
            level.run(Block::<GRADIENT> { bands, block, from, scale, totals });
        }
        for disc in &self.discs {
            disc.add::<GRADIENT>(level, self.bands, point, &mut totals, values, gradients);
        }
        totals
    }
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
            batch.nearest2[i] = emitter.nearest2 as f32;
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
            1 => self.sum::<1>(),
            2 => self.sum::<2>(),
            3 => self.sum::<3>(),
            4 => self.sum::<4>(),
            5 => self.sum::<5>(),
            _ => self.sum::<6>(),
        }
    }
}

impl<const GRADIENT: bool> Block<'_, GRADIENT> {
    #[inline(always)]
    fn sum<const BANDS: usize>(self) {
        let mut values = [[[0.0f32; LANES]; 3]; FUNCTIONS];
        let mut above = [[[0.0f32; LANES]; 3]; ABOVE];
        let mut below = [[[0.0f32; LANES]; 3]; BELOW];
        let mut functions = [[0.0f32; LANES]; ABOVE];
        for batch in self.block {
            let seen = Seen::new(batch, self.from);
            let bands = if GRADIENT { BANDS + 1 } else { BANDS };
            let [x, y, z] = &seen.direction;
            RECURSION.evaluate(bands, [x, y, z], &mut functions);
            let zonal = seen.zonal();
            for (l, zonal) in zonal.iter().enumerate().take(BANDS) {
                let weight = lanes!(|i| seen.fall_off[i] * zonal[i]);
                add_band(&mut values, &functions, l, &batch.color, &weight);
            }
            if GRADIENT {
                for (l, (slopes, zonal)) in seen.slopes().iter().zip(&zonal).enumerate().take(BANDS) {
                    let up = l as f32;
                    let weight = lanes!(|i| seen.steepness[i] * (slopes[i] + up * zonal[i]));
                    add_band(&mut above, &functions, l + 1, &batch.color, &weight);
                    if l > 0 {
                        let (down, factor) = ((l + 1) as f32, 1.0 / (2 * l + 1) as f32);
                        let weight = lanes!(|i| factor * (seen.steepness[i] * (slopes[i] - down * zonal[i])));
                        add_band(&mut below, &functions, l - 1, &batch.color, &weight);
                    }
                }
            }
        }
        flush(&values[..BANDS * BANDS], self.scale, &mut self.totals.values);
        if GRADIENT {
            flush(&above[..(BANDS + 1) * (BANDS + 1)], self.scale, &mut self.totals.above);
            flush(&below[..(BANDS - 1) * (BANDS - 1)], self.scale, &mut self.totals.below);
        }
    }
}

/// Adds a band's functions by `color` and `weight`.
#[inline(always)]
fn add_band(
    sums: &mut [[Lanes; 3]],
    functions: &[Lanes; ABOVE],
    l: usize,
    color: &[Lanes; 3],
    weight: &Lanes,
) {
    let colors = [0, 1, 2].map(|c| lanes!(|i| color[c][i] * weight[i]));
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
fn flush(sums: &[[Lanes; 3]], scale: f64, totals: &mut [[f64; 3]]) {
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
    /// Squared sine of half the angle that a sphere fills, 0 for points.
    q: Lanes,
    /// The cosine that goes with it.
    c: Lanes,
    /// 1 / squared distance, held within `nearest`.
    fall_off: Lanes,
    /// That over the distance in the scene's units.
    steepness: Lanes,
    /// 1 where distance matters.
    outside: Lanes,
}

impl Seen {
    #[inline(always)]
    fn new(batch: &Batch, from: [f64; 3]) -> Self {
        let mut towards = [[0.0f32; LANES]; 3];
        let (mut d2, mut tangent2) = ([0.0f32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let unit = batch.unit[i];
            let v = [0, 1, 2].map(|a| batch.position[a][i] - from[a] * unit);
            let square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            for a in 0..3 {
                towards[a][i] = v[a] as f32;
            }
            d2[i] = square as f32;
            tangent2[i] = (square - batch.radius2[i]) as f32;
        }
        let inverse = lanes!(|i| 1.0 / d2[i].max(TOUCHING));
        let nearness = lanes!(|i| inverse[i].sqrt());
        let mut direction = [0, 1, 2].map(|a| lanes!(|i| towards[a][i] * nearness[i]));
        // In its very middle a light is seen towards +z and has no slope.
        direction[2] = lanes!(|i| if d2[i] > TOUCHING { direction[2][i] } else { 1.0 });
        let fall_off = lanes!(|i| 1.0 / d2[i].max(batch.nearest2[i]).max(TOUCHING));
        let steepness = lanes!(|i| {
            let steepness = fall_off[i] * nearness[i] * batch.unit[i] as f32;
            if d2[i] > TOUCHING { steepness } else { 0.0 }
        });
        Self {
            q: lanes!(|i| batch.radius2[i] as f32 * fall_off[i]),
            c: lanes!(|i| (tangent2[i].max(0.0) * inverse[i]).sqrt()),
            outside: lanes!(|i| if d2[i] > batch.nearest2[i] { 1.0 } else { 0.0 }),
            direction,
            fall_off,
            steepness,
        }
    }

    /// z_l over the squared sine and pi, as `sphere::Seen::zonal`.
    #[inline(always)]
    fn zonal(&self) -> [Lanes; MOST_BANDS] {
        let (q, c) = (&self.q, &self.c);
        [
            lanes!(|i| 2.0 / (1.0 + c[i])),
            [1.0; LANES],
            *c,
            lanes!(|i| 1.0 - 1.25 * q[i]),
            lanes!(|i| c[i] * (1.0 - 1.75 * q[i])),
            lanes!(|i| 1.0 + q[i] * (2.625 * q[i] - 3.5)),
        ]
    }

    /// Distance times g_l over the squared sine and pi.
    #[inline(always)]
    fn slopes(&self) -> [Lanes; MOST_BANDS] {
        let q = &self.q;
        let odd = lanes!(|i| 2.0 * self.outside[i]);
        let even = lanes!(|i| if self.c[i] > 0.0 { odd[i] / self.c[i] } else { 0.0 });
        [
            even,
            odd,
            lanes!(|i| even[i] * (1.0 - 1.5 * q[i])),
            lanes!(|i| odd[i] * (1.0 - 2.5 * q[i])),
            lanes!(|i| even[i] * (1.0 + q[i] * (4.375 * q[i] - 5.0))),
            lanes!(|i| odd[i] * (1.0 + q[i] * (7.875 * q[i] - 7.0))),
        ]
    }
}
