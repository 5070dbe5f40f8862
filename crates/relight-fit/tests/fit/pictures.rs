//! Stacks in memory, lights, and pictures whose coefficients are known.

use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{
    Basis, CoefficientMap, Design, Direction, Family, Layout, LightSet, Model, PlaneRole, Space, Stack,
    StackError, StackRows,
};
use relight_fit::{LeastSquares, LightWeights, Ridge, Sample};
use std::ops::Range;

/// Pictures in memory, one row of samples a light.
pub(crate) struct Pictures {
    pub(crate) size: (usize, usize),
    pub(crate) channels: usize,
    pub(crate) rows: Vec<Vec<f32>>,
}

struct Run<'a> {
    pictures: &'a Pictures,
    samples: Range<usize>,
}

impl Stack for Pictures {
    fn lights(&self) -> usize {
        self.rows.len()
    }

    fn width(&self) -> usize {
        self.size.0
    }

    fn height(&self) -> usize {
        self.size.1
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        assert!(samples.end <= self.pixels() * self.channels, "samples outside the pictures");
        Ok(Box::new(Run { pictures: self, samples }))
    }
}

impl StackRows for Run<'_> {
    fn copy(&self, light: usize, first: usize, out: &mut [f32]) {
        out.copy_from_slice(&self.pictures.rows[light][self.samples.clone()][first..][..out.len()]);
    }
}

impl Pictures {
    /// The pictures of `value(light, pixel, channel)`.
    pub(crate) fn of(
        (lights, size, channels): (usize, (usize, usize), usize),
        value: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let samples = size.0 * size.1 * channels;
        let row = |light| (0..samples).map(|s| value(light, s / channels, s % channels) as f32).collect();
        Self { size, channels, rows: (0..lights).map(row).collect() }
    }

    /// The pictures of `lights` only, in that order.
    pub(crate) fn only(&self, lights: &[usize]) -> Self {
        let rows = lights.iter().map(|&light| self.rows[light].clone()).collect();
        Self { size: self.size, channels: self.channels, rows }
    }

    pub(crate) fn sample(&self) -> Sample {
        Sample::of(self).unwrap()
    }
}

/// A value in -1..1 of its own for every pair of numbers.
pub(crate) fn random(a: usize, b: usize) -> f64 {
    let mut bits = (a as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (b as u64 + 1).wrapping_mul(0xd1b5_4a32_d192_ed03);
    bits = (bits ^ (bits >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    bits = (bits ^ (bits >> 29)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// `count` lights evenly spread over a dome that ends 7 degrees above the horizon.
pub(crate) fn dome(count: usize) -> Vec<Direction> {
    fibonacci_in(Cap { axis: Direction::OUT, radius: 1.45 }, count)
}

pub(crate) fn direction(x: f64, y: f64, z: f64) -> Direction {
    Direction::new(x, y, z).unwrap()
}

/// The basis of `count` functions of the family `name`, everything else at its default.
pub(crate) fn basis_of(name: &str, count: usize, lights: &[Direction]) -> Basis {
    let lights = LightSet::from_directions(lights.to_vec());
    Family::by_name(name).unwrap().build(&Design::new(count, &lights)).unwrap()
}

pub(crate) fn model_of(basis: &Basis, layout: Layout) -> Model {
    Model {
        basis: basis.clone(),
        layout,
        space: Space::Linear,
        lights: Vec::new(),
        figures: None,
        provenance: None,
    }
}

pub(crate) fn fit_of(
    basis: &Basis,
    lights: &[Direction],
    weighting: LightWeights,
    ridge: Ridge,
    pictures: &Pictures,
) -> LeastSquares {
    LeastSquares::new(basis.clone(), lights, weighting, ridge, &pictures.sample()).unwrap()
}

/// The functions at `light`.
pub(crate) fn weights_of(basis: &Basis, light: Direction) -> Vec<f64> {
    let mut weights = vec![f64::NAN; basis.count()];
    basis.evaluate(light, &mut weights);
    weights
}

/// Channel `channel` of pixel `pixel` of `map` under `light`, by the definition of its planes' roles.
pub(crate) fn relit(map: &CoefficientMap, light: Direction, pixel: usize, channel: usize) -> f64 {
    let weights = weights_of(&map.model.basis, light);
    let mean = map.model.mean_functions()[channel];
    let (mut sum, mut base) = (mean.map_or(0.0, |f| weights[usize::from(f)]), 1.0);
    for (role, plane) in map.model.roles().into_iter().zip(&map.planes) {
        let value = f64::from(plane[pixel]);
        match role {
            PlaneRole::Coefficient { functions } => {
                sum += functions[channel].map_or(0.0, |f| weights[usize::from(f)] * value);
            }
            PlaneRole::BaseColor { channel: own } if usize::from(own) == channel => base = value,
            PlaneRole::BaseColor { .. } => {}
        }
    }
    sum * base
}

/// Root mean square difference of `map` and `pictures` of `lights`.
pub(crate) fn rms_error(map: &CoefficientMap, lights: &[Direction], pictures: &Pictures) -> f64 {
    let mut squares = 0.0;
    for (light, row) in lights.iter().zip(&pictures.rows) {
        for (s, value) in row.iter().enumerate() {
            let error = relit(map, *light, s / pictures.channels, s % pictures.channels) - f64::from(*value);
            squares += error * error;
        }
    }
    (squares / (lights.len() * pictures.rows[0].len()) as f64).sqrt()
}

/// The largest coefficient, NaN and infinity counting as infinite.
pub(crate) fn largest(map: &CoefficientMap) -> f64 {
    let magnitude = |v: &f32| if v.is_finite() { f64::from(v.abs()) } else { f64::INFINITY };
    map.planes.iter().flatten().map(magnitude).fold(0.0, f64::max)
}

/// A map with a value of its own in every plane and pixel: coefficients in -1..1, base colours in
/// 0.1..1 with a largest component of 1.
pub(crate) fn lopsided(basis: &Basis, layout: Layout, (width, height): (usize, usize)) -> CoefficientMap {
    let model = model_of(basis, layout);
    let base = |pixel: usize, channel: usize| {
        let color = [0, 1, 2].map(|c| 0.55 + 0.45 * random(1000 + c, pixel));
        color[channel] / color.iter().fold(0.0, |a: f64, b| a.max(*b))
    };
    let planes = model.roles().into_iter().enumerate().map(|(plane, role)| {
        let value = |pixel| match role {
            PlaneRole::Coefficient { .. } => random(plane, pixel),
            PlaneRole::BaseColor { channel } => base(pixel, usize::from(channel)),
        };
        (0..width * height).map(|pixel| value(pixel) as f32).collect()
    });
    CoefficientMap { width, height, planes: planes.collect(), model }
}

/// The pictures of `map` under `lights`, in f64 up to the last rounding.
pub(crate) fn pictures_of(map: &CoefficientMap, lights: &[Direction]) -> Pictures {
    let weights: Vec<Vec<f64>> = lights.iter().map(|light| weights_of(&map.model.basis, *light)).collect();
    let (size, channels) = ((map.width, map.height), map.model.channels());
    let stride = if map.model.layout == Layout::Rgb { 3 } else { 1 };
    Pictures::of((lights.len(), size, channels), |light, pixel, channel| {
        let offset = if stride == 3 { channel } else { 0 };
        let sum: f64 = weights[light]
            .iter()
            .enumerate()
            .map(|(j, b)| b * f64::from(map.planes[j * stride + offset][pixel]))
            .sum();
        match map.model.layout {
            Layout::Lrgb => sum * f64::from(map.planes[weights[light].len() + channel][pixel]),
            Layout::Grey | Layout::Rgb | Layout::Shared => sum,
        }
    })
}

/// Grey pictures of 16 x 16 bumps, each facing a way of its own within 40 degrees of the camera:
/// Lambert's law and a highlight of a given sharpness.
pub(crate) fn glossy_bumps(lights: &[Direction], sharpness: i32) -> Pictures {
    let normal = |pixel| direction(0.6 * random(1, pixel), 0.6 * random(2, pixel), 1.0);
    Pictures::of((lights.len(), (16, 16), 1), |light, pixel, _| {
        let (normal, light) = (normal(pixel), lights[light]);
        let [x, y, z] = light.components();
        let middle = direction(x, y, z + 1.0);
        let albedo = 0.5 + 0.3 * random(3, pixel);
        albedo * normal.cosine(light).max(0.0) + 0.4 * normal.cosine(middle).max(0.0).powi(sharpness)
    })
}
