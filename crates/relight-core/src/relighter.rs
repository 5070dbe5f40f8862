//! The reference relighter: what a picture under a light is, by definition.
//!
//! Every faster path, on the CPU or the GPU, is held to these values: coefficient = scale * q +
//! bias, channel = sum over planes in order of weight * coefficient, then plus the mean of shared planes, all
//! in f32 without fusing.

use crate::maps::RelightingMaps;
use crate::model::{PlaneRole, Space};
use crate::transfer::{linear_from_srgb, srgb_from_linear};
use crate::weighted_sums::{Rows, weighted_sums};
use crate::{CpuLevel, Direction, Model};
use rayon::prelude::*;

/// Pixels relit at a time: their planes' rows stay in the L2 cache.
const BLOCK: usize = 1024;

/// A relit picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// 1 (grey) or 3 (R, G, B), interleaved.
    pub channels: usize,
    /// width x height x channels values.
    pub samples: Vec<f32>,
}

/// A directional light and its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// From the surface towards the light.
    pub direction: Direction,
    /// Linear R, G, B relative to the capture's own light; (1, 1, 1) is that light.
    pub color: [f32; 3],
}

/// What one channel of the relit picture is made of.
#[derive(Default, PartialEq)]
struct ChannelTerms {
    planes: Vec<usize>,
    weights: Vec<f32>,
    /// Without any plane.
    mean: f32,
}

/// What the pixels of a model are made of under one light: the planes and weights of each channel, and the
/// planes that multiply them.
pub struct LightTerms {
    channels: Vec<ChannelTerms>,
    factors: [Option<usize>; 3],
}

impl LightTerms {
    /// Those of `model` under `light`.
    pub fn new(model: &Model, light: Direction) -> Self {
        let mut functions = vec![0.0; model.basis.count()];
        model.basis.evaluate(light, &mut functions);
        let mut terms: Vec<ChannelTerms> = Vec::new();
        terms.resize_with(model.channels(), ChannelTerms::default);
        for (channel, function) in terms.iter_mut().zip(model.mean_functions()) {
            channel.mean = function.map_or(0.0, |function| functions[usize::from(function)] as f32);
        }
        let mut factors = [None; 3];
        for (plane, role) in model.roles().into_iter().enumerate() {
            match role {
                PlaneRole::Coefficient { functions: by_channel } => {
                    for (channel, function) in terms.iter_mut().zip(by_channel) {
                        if let Some(function) = function {
                            channel.planes.push(plane);
                            channel.weights.push(functions[usize::from(function)] as f32);
                        }
                    }
                }
                PlaneRole::BaseColor { channel } => factors[usize::from(channel)] = Some(plane),
            }
        }
        Self { channels: terms, factors }
    }

    /// Writes pixels `first ..` of the picture, channels interleaved, in the asset's own space, not clipped.
    ///
    /// # Panics
    /// When `maps` are of another model or end before `out` does.
    pub fn relight(&self, maps: &RelightingMaps, level: CpuLevel, first: usize, out: &mut [f32]) {
        let channels = self.channels.len();
        let pixels = out.len() / channels;
        let mut rows = Vec::new();
        let mut sums = vec![0.0f32; pixels];
        let mut factor = vec![1.0f32; pixels];
        for (channel, of_channel) in self.channels.iter().enumerate() {
            // Luminance planes feed all channels alike: they are summed once.
            if channel == 0 || *of_channel != self.channels[channel - 1] {
                rows.resize(of_channel.planes.len() * pixels, 0.0);
                for (&plane, row) in of_channel.planes.iter().zip(rows.chunks_exact_mut(pixels)) {
                    maps.planes[plane].coefficients(first, row);
                }
                let count = of_channel.planes.len();
                let input = Rows { samples: &rows[..], stride: pixels };
                let output = Rows { samples: &mut sums[..], stride: pixels };
                weighted_sums(level, &of_channel.weights, count, input, output, pixels);
            }
            if let Some(plane) = self.factors[channel] {
                maps.planes[plane].coefficients(first, &mut factor);
            }
            for ((pixel, sum), factor) in out.chunks_exact_mut(channels).zip(&sums).zip(&factor) {
                pixel[channel] = (sum + of_channel.mean) * factor;
            }
        }
    }
}

/// The picture under one light, in the asset's own space (encoded or linear), not clipped.
pub fn relight(maps: &RelightingMaps, light: Direction, level: CpuLevel) -> Picture {
    let channels = maps.model.channels();
    let terms = LightTerms::new(&maps.model, light);
    let mut samples = vec![0.0; maps.pixels() * channels];
    samples.par_chunks_mut(BLOCK * channels).enumerate().for_each(|(block, out)| {
        terms.relight(maps, level, block * BLOCK, out);
    });
    Picture { width: maps.width, height: maps.height, channels, samples }
}

/// The picture under several lights, in linear light, not clipped above; encoded assets are
/// decoded before the lights add up.
///
/// Grey assets stay grey unless a light is coloured.
pub fn relight_linear(maps: &RelightingMaps, lights: &[DirectionalLight], level: CpuLevel) -> Picture {
    let colored = lights.iter().any(|l| l.color[0] != l.color[1] || l.color[1] != l.color[2]);
    let channels = if colored { 3 } else { maps.model.channels() };
    let mut total = vec![0.0; maps.pixels() * channels];
    for light in lights {
        let one = relight(maps, light.direction, level);
        total.par_chunks_mut(channels).zip(one.samples.par_chunks(one.channels)).for_each(|(sum, pixel)| {
            for (channel, sum) in sum.iter_mut().enumerate() {
                let value = pixel[channel.min(pixel.len() - 1)];
                let linear = match maps.model.space {
                    Space::Encoded => linear_from_srgb(value),
                    Space::Linear => value,
                };
                *sum += light.color[channel] * linear;
            }
        });
    }
    Picture { width: maps.width, height: maps.height, channels, samples: total }
}

impl Picture {
    /// The picture with sRGB-encoded values, from one in `space`.
    pub fn encoded_from(mut self, space: Space) -> Self {
        if space == Space::Linear {
            self.samples.par_iter_mut().for_each(|value| *value = srgb_from_linear(*value));
        }
        self
    }

    /// The picture with linear values, from one in `space`.
    pub fn linear_from(mut self, space: Space) -> Self {
        if space == Space::Encoded {
            self.samples.par_iter_mut().for_each(|value| *value = linear_from_srgb(*value));
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::{RelightingMap, Texels};
    use crate::{Basis, Design, Family, Layout, LightSet};

    /// An asset with a value of its own in every plane and pixel.
    fn lopsided(layout: Layout, space: Space, width: usize, height: usize) -> RelightingMaps {
        let lights = LightSet::default();
        let basis: Basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &lights)).unwrap();
        let model = Model { basis, layout, space, lights: Vec::new(), figures: None, provenance: None };
        let plane = |p: usize| RelightingMap {
            scale: 0.5 + 0.01 * p as f32,
            bias: -0.1 * p as f32,
            texels: Texels::U8((0..width * height).map(|x| ((x * 7 + p * 31) % 251) as u8).collect()),
        };
        let planes = (0..model.plane_count()).map(plane).collect();
        RelightingMaps { width, height, model, planes }
    }

    #[test]
    fn rgb_sums_each_channels_own_planes_and_lrgb_multiplies_the_base_color() {
        let light = Direction::new(0.2, -0.5, 0.7).unwrap();
        let mut b = [0.0; 6];
        for layout in [Layout::Rgb, Layout::Lrgb, Layout::Grey] {
            let maps = lopsided(layout, Space::Linear, 37, 41);
            maps.model.basis.evaluate(light, &mut b);
            let value = |p: usize, x: usize| {
                let Texels::U8(codes) = &maps.planes[p].texels else { panic!() };
                maps.planes[p].scale * (f32::from(codes[x]) / 255.0) + maps.planes[p].bias
            };
            let picture = relight(&maps, light, CpuLevel::BASELINE);
            assert_eq!(picture.samples.len(), 37 * 41 * maps.model.channels());
            for (i, sample) in picture.samples.iter().enumerate() {
                let (x, c) = (i / picture.channels, i % picture.channels);
                let sum = |plane: &dyn Fn(usize) -> usize| {
                    (0..6).fold(0.0f32, |sum, j| sum + b[j] as f32 * value(plane(j), x))
                };
                let expected = match layout {
                    Layout::Grey | Layout::Shared => sum(&|j| j),
                    Layout::Rgb => sum(&|j| 3 * j + c),
                    Layout::Lrgb => sum(&|j| j) * value(6 + c, x),
                };
                assert_eq!(sample.to_bits(), expected.to_bits(), "{layout:?} pixel {x} channel {c}");
            }
        }
    }

    #[test]
    fn lights_add_up_in_linear_light() {
        let maps = lopsided(Layout::Rgb, Space::Encoded, 5, 3);
        let a = DirectionalLight { direction: Direction::OUT, color: [1.0, 0.5, 0.0] };
        let b = DirectionalLight { direction: Direction::new(0.6, 0.0, 0.8).unwrap(), color: [2.0; 3] };
        let sum = relight_linear(&maps, &[a, b], CpuLevel::BASELINE);
        let (pa, pb) = (
            relight(&maps, a.direction, CpuLevel::BASELINE),
            relight(&maps, b.direction, CpuLevel::BASELINE),
        );
        for (i, value) in sum.samples.iter().enumerate() {
            let expected =
                a.color[i % 3] * linear_from_srgb(pa.samples[i]) + 2.0 * linear_from_srgb(pb.samples[i]);
            assert!((value - expected).abs() < 1e-6);
        }
        let grey = lopsided(Layout::Grey, Space::Linear, 5, 3);
        assert_eq!(relight_linear(&grey, &[b], CpuLevel::BASELINE).channels, 1);
        assert_eq!(relight_linear(&grey, &[a], CpuLevel::BASELINE).channels, 3);
    }
}
