//! Discs that stay well away from all points: many of them side by side, a node of each at a time.

use super::disc_nodes::{RULES, Rule};
use super::lanes::{LANES, Lanes, RECURSION, lanes, three};
use super::projector::{Totals, flush};
use relight_core::Vectorized;
use relight_core::vectors::{difference, frame_around, length};
use std::f64::consts::PI;

/// A disc as a projector is given it.
#[derive(Clone, Copy, Debug)]
pub(super) struct FarDisc {
    rule: usize,
    centre: [f64; 3],
    normal: [f64; 3],
    radius: f64,
    color: [f64; 3],
    unit: f64,
}

/// Discs with the same nodes, in units of their own, from the ball's middle.
#[derive(Clone, Debug)]
pub(super) struct DiscBatch {
    rule: usize,
    position: [[f64; LANES]; 3],
    unit: [f64; LANES],
    normal: [Lanes; 3],
    /// The disc's axes, as long as its radius.
    across: [[Lanes; 3]; 2],
    /// Radiance times area.
    color: [Lanes; 3],
}

impl FarDisc {
    /// `None` where points of the ball may be so near to the disc that each needs nodes of its own.
    pub(super) fn new(
        centre: [f64; 3],
        normal: [f64; 3],
        radius: f64,
        color: [f64; 3],
        (middle, ball): ([f64; 3], f64),
    ) -> Option<Self> {
        let centre = difference(centre, middle);
        let distance = length(centre);
        let rule = RULES.iter().position(|rule| distance - ball >= rule.nearest * radius)?;
        let (_, exponent) = libm::frexp(distance);
        let unit = libm::ldexp(1.0, -exponent.clamp(-1000, 1000));
        let size = radius * unit;
        Some(Self { rule, centre, normal, radius, color: color.map(|c| c * (PI * size * size)), unit })
    }

    /// The largest channel, in the disc's own units.
    pub(super) fn brightness(&self) -> f64 {
        self.color.iter().fold(0.0, |most, c| most.max(c.abs()))
    }
}

impl DiscBatch {
    /// Batches of discs by their rules, each rule's in order; colours are divided by `scale`.
    pub(super) fn of(discs: &[FarDisc], scale: f64) -> Vec<Self> {
        let of_rule = |rule: usize| -> Vec<Self> {
            let discs: Vec<_> = discs.iter().filter(|disc| disc.rule == rule).collect();
            discs.chunks(LANES).map(|discs| Self::new(rule, discs, scale)).collect()
        };
        (0..RULES.len()).flat_map(of_rule).collect()
    }

    fn new(rule: usize, discs: &[&FarDisc], scale: f64) -> Self {
        // Lanes without a disc: a black one a unit away.
        let mut batch = Self {
            rule,
            position: [[1.0; LANES]; 3],
            unit: [0.0; LANES],
            normal: [[0.0; LANES]; 3],
            across: [[[0.0; LANES]; 3]; 2],
            color: [[0.0; LANES]; 3],
        };
        for (i, disc) in discs.iter().enumerate() {
            let [a, b] = frame_around(disc.normal);
            let size = disc.radius * disc.unit;
            batch.unit[i] = disc.unit;
            for axis in 0..3 {
                batch.position[axis][i] = disc.centre[axis] * disc.unit;
                batch.normal[axis][i] = disc.normal[axis] as f32;
                batch.across[0][axis][i] = (a[axis] * size) as f32;
                batch.across[1][axis][i] = (b[axis] * size) as f32;
                batch.color[axis][i] = (disc.color[axis] / scale) as f32;
            }
        }
        batch
    }
}

/// What a point sees of some batches.
pub(super) struct DiscBlock<'a> {
    pub(super) bands: usize,
    pub(super) block: &'a [DiscBatch],
    /// The point, from the ball's middle.
    pub(super) from: [f64; 3],
    pub(super) scale: f64,
    pub(super) totals: &'a mut Totals,
}

impl Vectorized for DiscBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        match self.bands {
            1 => self.sum::<1, 1>(),
            2 => self.sum::<2, 4>(),
            3 => self.sum::<3, 9>(),
            4 => self.sum::<4, 16>(),
            5 => self.sum::<5, 25>(),
            6 => self.sum::<6, 36>(),
            _ => self.sum::<7, 49>(),
        }
    }
}

impl DiscBlock<'_> {
    /// `N` is the square of `BANDS`.
    #[inline(always)]
    fn sum<const BANDS: usize, const N: usize>(self) {
        let mut values = [[[0.0f32; LANES]; 3]; N];
        for batch in self.block {
            let (mut towards, mut height) = ([[0.0f32; LANES]; 3], [0.0f32; LANES]);
            for i in 0..LANES {
                let unit = batch.unit[i];
                let v = three!(|axis| (batch.position[axis][i] - self.from[axis] * unit) as f32);
                let normal = three!(|axis| batch.normal[axis][i]);
                height[i] = -(v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]);
                for axis in 0..3 {
                    towards[axis][i] = v[axis];
                }
            }
            let mut sums = [[0.0f32; LANES]; N];
            let rule: &Rule = &RULES[batch.rule];
            for [u, v, share] in rule.places() {
                let mut direction = [[0.0f32; LANES]; 3];
                let mut weight = [0.0f32; LANES];
                for i in 0..LANES {
                    let [x, y, z] = three!(|axis| {
                        towards[axis][i] + (u * batch.across[0][axis][i] + v * batch.across[1][axis][i])
                    });
                    let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
                    direction[0][i] = x * inverse;
                    direction[1][i] = y * inverse;
                    direction[2][i] = z * inverse;
                    weight[i] = share * inverse * (inverse * inverse);
                }
                RECURSION.accumulate(BANDS, &direction, &weight, &mut sums);
            }
            // Radiance by the solid angle of the area where it faces the point; from behind nothing is seen.
            let mut colors = [[0.0f32; LANES]; 3];
            for (color, of_batch) in colors.iter_mut().zip(&batch.color) {
                *color = lanes!(|i| of_batch[i] * height[i].max(0.0));
            }
            for (value, sum) in values.iter_mut().zip(&sums) {
                for (value, color) in value.iter_mut().zip(&colors) {
                    *value = lanes!(|i| value[i] + color[i] * sum[i]);
                }
            }
        }
        flush(&values, self.scale, &mut self.totals.values);
    }
}
