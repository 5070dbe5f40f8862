//! Pictures as if each lamp had been as far from every pixel as from the middle of the surface, and the lens clear.

use super::NearLamps;
use relight_core::{
    CpuLevel, Space, Stack, StackError, StackRows, Vectorized, linear_from_srgb, srgb_from_linear,
};
use std::ops::Range;

/// Pictures without fall-off and vignetting: linear light is multiplied by d^2 / r^2 / t, d the pixel's distance from the
/// lamp, r that of the middle, t the lens's [`NearLamps::transmission`].
///
/// Nothing is rounded to codes again and nothing is cut at 1. Encoded values are never below 0.
pub struct LevelledStack<'a, S> {
    /// The pictures.
    pub stack: S,
    /// Whose pictures, of the same size.
    pub lamps: &'a NearLamps,
    /// What the pictures' values are.
    pub space: Space,
    /// Instruction set.
    pub level: CpuLevel,
}

impl<S: Stack> Stack for LevelledStack<'_, S> {
    fn lights(&self) -> usize {
        self.stack.lights()
    }

    fn width(&self) -> usize {
        self.stack.width()
    }

    fn height(&self) -> usize {
        self.stack.height()
    }

    fn channels(&self) -> usize {
        self.stack.channels()
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        let channels = self.channels();
        let (first, end) = (samples.start / channels, samples.end.div_ceil(channels));
        let mut places =
            Places { axes: [(); 3].map(|()| Vec::with_capacity(end - first)), clearing: Vec::new() };
        for pixel in first..end {
            let point = self.lamps.surface.point(pixel);
            places.axes.iter_mut().zip(point).for_each(|(axis, c)| axis.push(c));
            places.clearing.push((1.0 / self.lamps.transmission(pixel)) as f32);
        }
        let phase = samples.start % channels;
        Ok(Box::new(LevelledRows { stack: self, places, phase, rows: self.stack.rows(samples)? }))
    }
}

/// What the pixels of a run have of their own.
struct Places {
    axes: [Vec<f32>; 3],
    /// 1 / transmission.
    clearing: Vec<f32>,
}

struct LevelledRows<'a, S> {
    stack: &'a LevelledStack<'a, S>,
    places: Places,
    /// Channel of the run's first sample.
    phase: usize,
    rows: Box<dyn StackRows + 'a>,
}

impl<S: Stack> StackRows for LevelledRows<'_, S> {
    fn copy(&self, light: usize, first: usize, out: &mut [f32]) {
        self.rows.copy(light, first, out);
        let LevelledStack { lamps, space, level, .. } = self.stack;
        let channels = self.stack.channels();
        let from = self.phase + first;
        let pixels = from / channels..(from + out.len()).div_ceil(channels);
        let mut gains = vec![0.0; pixels.len()];
        let distance = lamps.distances[light];
        level.run(Gains {
            axes: self.places.axes.each_ref().map(|axis| &axis[pixels.clone()]),
            clearing: &self.places.clearing[pixels],
            lamp: lamps.positions[light].map(|c| c as f32),
            per_square: (1.0 / (distance * distance)) as f32,
            gains: &mut gains,
        });
        let phase = from % channels;
        match space {
            Space::Linear => {
                let gains = by_sample(&gains, channels, phase);
                out.iter_mut().zip(gains).for_each(|(value, gain)| *value *= gain);
            }
            Space::Encoded => {
                let mut roots = vec![0.0; gains.len()];
                level.run(Roots { gains: &gains, roots: &mut roots });
                let [gains, roots] = [gains, roots].map(|of_pixels| by_sample(&of_pixels, channels, phase));
                level.run(Encoded { gains: &gains, roots: &roots, values: out });
            }
        }
    }
}

/// A number for each sample from one for each pixel; the first sample is of channel `phase`.
fn by_sample(of_pixels: &[f32], channels: usize, phase: usize) -> Vec<f32> {
    let mut of_samples = vec![0.0; of_pixels.len() * channels];
    match channels {
        3 => of_samples.as_chunks_mut().0.iter_mut().zip(of_pixels).for_each(|(rgb, v)| *rgb = [*v; 3]),
        _ => of_samples.copy_from_slice(of_pixels),
    }
    if phase > 0 {
        of_samples.drain(..phase);
    }
    of_samples
}

/// Gains of linear light along pixels.
struct Gains<'a> {
    axes: [&'a [f32]; 3],
    clearing: &'a [f32],
    lamp: [f32; 3],
    per_square: f32,
    gains: &'a mut [f32],
}

impl Vectorized for Gains<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { axes: [x, y, z], clearing, lamp, per_square, gains } = self;
        for ((((gain, x), y), z), clearing) in gains.iter_mut().zip(x).zip(y).zip(z).zip(clearing) {
            let (x, y, z) = (lamp[0] - x, lamp[1] - y, lamp[2] - z);
            *gain = (x * x + y * y + z * z) * per_square * clearing;
        }
    }
}

/// `gain^(1 / 2.4)`.
struct Roots<'a> {
    gains: &'a [f32],
    roots: &'a mut [f32],
}

impl Vectorized for Roots<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.roots.iter_mut().zip(self.gains).for_each(|(root, gain)| *root = root_2_4(*gain));
    }
}

/// Up to here the sRGB curve is a line.
const LINE_END: f32 = 0.04045;

/// Encoded values, as if linear light had been multiplied by a gain each.
///
/// On the curve's power that is a product and a sum: `((v + 0.055) / 1.055)^2.4 g` is encoded as
/// `g^(1 / 2.4) (v + 0.055) - 0.055`, so that a sample takes no power of its own.
struct Encoded<'a> {
    gains: &'a [f32],
    roots: &'a [f32],
    values: &'a mut [f32],
}

impl Vectorized for Encoded<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { gains, roots, values } = self;
        let mut crossings = 0u32;
        for ((value, gain), root) in values.iter_mut().zip(gains).zip(roots) {
            let before = *value;
            let by_power = root * (before + 0.055) - 0.055;
            let by_line = before * gain;
            let after = if before > LINE_END { by_power } else { by_line };
            let crosses = (before > LINE_END) != (after > LINE_END);
            crossings |= u32::from(crosses);
            // Negative for those that are yet to be done: no value is.
            *value = if crosses { -1.0 - before } else { after };
        }
        if crossings != 0 {
            for (value, gain) in values.iter_mut().zip(gains).filter(|(value, _)| **value <= -1.0) {
                *value = srgb_from_linear(linear_from_srgb(-1.0 - *value) * gain);
            }
        }
    }
}

/// `x^(1 / 2.4)` of x from 0 to 1e30, to 3e-7 of itself: the fourth root times the sixth, the latter by two of Halley's
/// steps from a guess by the exponent.
#[inline(always)]
fn root_2_4(x: f32) -> f32 {
    let square_root = x.max(1e-30).sqrt();
    // A third of the exponent; 0x2a51_4067 makes up for the bias (Turkowski, *Computing the cube root*, 1998).
    let mut root = f32::from_bits(square_root.to_bits() / 3 + 0x2a51_4067);
    for _ in 0..2 {
        let cube = root * root * root;
        root = root * (cube + 2.0 * square_root) / (2.0 * cube + square_root);
    }
    square_root.sqrt() * root
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NearSurface, Vignetting};

    #[test]
    fn the_root_is_that_of_the_library() {
        for i in 0..40_000 {
            let x = libm::pow(10.0, -8.0 + f64::from(i) * 4e-4) as f32;
            let expected = libm::pow(f64::from(x), 1.0 / 2.4);
            assert!((f64::from(root_2_4(x)) / expected - 1.0).abs() < 3e-7, "{x}");
        }
        assert!(root_2_4(0.0) < 1e-12);
    }

    struct Codes(Vec<Vec<f32>>);

    impl Stack for Codes {
        fn lights(&self) -> usize {
            self.0.len()
        }
        fn width(&self) -> usize {
            5
        }
        fn height(&self) -> usize {
            3
        }
        fn channels(&self) -> usize {
            3
        }
        fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
            Ok(Box::new(CodeRows(self, samples.start)))
        }
    }

    struct CodeRows<'a>(&'a Codes, usize);

    impl StackRows for CodeRows<'_> {
        fn copy(&self, light: usize, first: usize, out: &mut [f32]) {
            out.copy_from_slice(&self.0.0[light][self.1 + first..][..out.len()]);
        }
    }

    #[test]
    fn samples_are_levelled_in_linear_light_from_any_sample_on() {
        // Dark and bright values, so that some cross from the curve's line to its power and back.
        let stack =
            Codes((0..2).map(|l| (0..45).map(|i| ((i * 7 + l * 3) % 45) as f32 / 120.0).collect()).collect());
        let positions = vec![[2.0, -1.0, 3.0], [-4.0, 0.5, 1.0]];
        let plane = NearSurface::Plane { width: 5, height: 3, first: [-1.0, 0.5], pixel: 0.5 };
        let vignetting = Vignetting { focal: 4.0, axis: [2.5, 1.0] };
        let lamps = NearLamps::new(positions.clone(), plane, Some(vignetting)).unwrap();
        for space in [Space::Linear, Space::Encoded] {
            for level in CpuLevel::available() {
                let levelled = LevelledStack { stack: &stack, lamps: &lamps, space, level };
                for (start, first, count) in [(0, 0, 45), (7, 4, 11), (12, 1, 1), (3, 0, 40)] {
                    for (light, lamp) in positions.iter().enumerate() {
                        let mut out = vec![0.0; count];
                        levelled.rows(start..45).unwrap().copy(light, first, &mut out);
                        for (i, value) in out.iter().enumerate() {
                            let at = start + first + i;
                            let (x, y) = ((at / 3 % 5) as f64, (at / 15) as f64);
                            let to = [lamp[0] + 1.0 - 0.5 * x, lamp[1] - 0.5 + 0.5 * y, lamp[2]];
                            let square = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>();
                            let (right, down) = (x + 0.5 - 2.5, y + 0.5 - 1.0);
                            let lens = 1.0 + (right * right + down * down) / 16.0;
                            let gain = square(to) / square(*lamp) * lens * lens;
                            let code = stack.0[light][at];
                            let expected = match space {
                                Space::Linear => f64::from(code) * gain,
                                Space::Encoded => f64::from(srgb_from_linear(
                                    (f64::from(linear_from_srgb(code)) * gain) as f32,
                                )),
                            };
                            let off = (f64::from(*value) - expected).abs();
                            assert!(off < 3e-6 * expected.max(0.1), "{space:?} {at}: {value} {expected}");
                        }
                    }
                }
            }
        }
    }
}
