//! Light from all around, as an equirectangular picture.

use crate::horizon::Horizon;
use rayon::prelude::*;
use relight_core::relighter::Picture;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::vectors::cross;
use relight_core::{Basis, Direction};
use std::f64::consts::PI;
use std::fmt;

/// A picture of the radiance from every direction.
///
/// Row 0 is where `up` points; azimuth grows to the right from -pi to pi and is 0, in the middle of the
/// picture, where `forward` points; right is `forward` x `up`.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Linear radiance; 1 from everywhere lights a white facing diffuser to 1.
    pub radiance: Picture,
    /// The middle of the picture.
    pub forward: Direction,
    /// Its top.
    pub up: Direction,
}

/// An environment that is none.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// `forward` and `up` are not perpendicular.
    Axes {
        /// Their cosine.
        cosine: f64,
    },
    /// A sample is negative, infinite or NaN.
    Radiance {
        /// The pixel's column.
        x: usize,
        /// The pixel's row.
        y: usize,
        /// The sample.
        value: f32,
    },
}

impl fmt::Display for EnvironmentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Axes { cosine } => {
                write!(f, "forward and up must be perpendicular; the cosine of their angle is {cosine:.3}")
            }
            Self::Radiance { x, y, value } => {
                write!(f, "the radiance of pixel {x}, {y} is {value}; it must be finite and not negative")
            }
        }
    }
}

impl std::error::Error for EnvironmentError {}

/// Pictures are averaged to no more than this many pixels in a row before the functions are integrated over
/// them: 0.35 degrees, a fiftieth of the narrowest functions' spread.
const WIDEST: usize = 1024;

impl Environment {
    /// Checks axes and samples.
    ///
    /// # Errors
    /// [`EnvironmentError`].
    pub fn new(radiance: Picture, forward: Direction, up: Direction) -> Result<Self, EnvironmentError> {
        let cosine = forward.cosine(up);
        if cosine.abs() > 1e-6 {
            return Err(EnvironmentError::Axes { cosine });
        }
        if let Some(i) = radiance.samples.iter().position(|value| !(0.0..=f32::MAX).contains(value)) {
            let pixel = i / radiance.channels;
            let (x, y) = (pixel % radiance.width, pixel / radiance.width);
            return Err(EnvironmentError::Radiance { x, y, value: radiance.samples[i] });
        }
        Ok(Self { radiance, forward, up })
    }

    /// Weights of the functions for each of R, G and B: 1 / pi times the integral of radiance times function,
    /// which is what directional lights of irradiance pi add up to.
    ///
    /// Each pixel is constant radiance; a function is integrated over it by Gauss-Legendre quadrature in
    /// azimuth and in the sine of latitude, with as many nodes as make steps below a degree.
    /// Source: equation 1 of Wong et al., linear in the light.
    pub fn weights(&self, basis: &Basis, horizon: &Horizon) -> Vec<[f64; 3]> {
        let count = basis.count();
        let quadrature = self.quadrature();
        let rows = (0..quadrature.picture.height).into_par_iter().map(|row| {
            let mut sums = vec![[0.0; 3]; count];
            let mut functions = vec![0.0; count];
            for sample in quadrature.row(row) {
                let taken = horizon.take(sample.direction);
                if taken.factor == 0.0 {
                    continue;
                }
                basis.evaluate(taken.direction, &mut functions);
                let share = taken.factor * sample.solid_angle / PI;
                for (sum, function) in sums.iter_mut().zip(&functions) {
                    add(sum, sample.radiance, share * function);
                }
            }
            sums
        });
        let rows: Vec<Vec<[f64; 3]>> = rows.collect();
        // In the order of rows, whatever thread made them.
        let mut weights = vec![[0.0; 3]; count];
        for row in rows {
            for (weight, sum) in weights.iter_mut().zip(row) {
                add(weight, sum, 1.0);
            }
        }
        weights
    }

    /// Directional lights that stand for it, with their linear colours: each has the mean radiance of the
    /// directions nearest to it. For assets of encoded values, in which lights can't be added up before they
    /// are decoded.
    pub fn lights(&self, count: usize) -> Vec<(Direction, [f64; 3])> {
        let directions = fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, count);
        let mut sums = vec![[0.0; 3]; directions.len()];
        let quadrature = self.quadrature();
        for sample in (0..quadrature.picture.height).flat_map(|row| quadrature.row(row)) {
            let nearest = (0..directions.len()).fold(0, |best, i| {
                if directions[i].cosine(sample.direction) > directions[best].cosine(sample.direction) {
                    i
                } else {
                    best
                }
            });
            add(&mut sums[nearest], sample.radiance, sample.solid_angle / PI);
        }
        directions.into_iter().zip(sums).filter(|(_, color)| color.iter().any(|c| *c > 0.0)).collect()
    }

    fn quadrature(&self) -> Quadrature {
        let picture = averaged(&self.radiance);
        let (forward, up) = (self.forward.components(), self.up.components());
        Quadrature {
            across: nodes(360.0 / picture.width as f64),
            down: nodes(180.0 / picture.height as f64),
            axes: [cross(forward, up), forward, up],
            picture,
        }
    }
}

struct Quadrature {
    picture: Picture,
    /// Places in a pixel from 0 to 1 with their weights, in azimuth and in the sine of latitude.
    across: &'static [(f64, f64)],
    down: &'static [(f64, f64)],
    /// Right, forward, up.
    axes: [[f64; 3]; 3],
}

impl Quadrature {
    /// The samples of a row of the picture.
    fn row(&self, row: usize) -> Vec<Sample> {
        let Picture { width, height, channels, ref samples } = self.picture;
        let [right, forward, up] = self.axes;
        // Sines of latitude: equal steps are equal areas.
        let edge = |i: usize| libm::sin(0.5 * PI - PI * i as f64 / height as f64);
        let (top, bottom) = (edge(row), edge(row + 1));
        let mut out = Vec::with_capacity(width * self.across.len() * self.down.len());
        for &(v, v_weight) in self.down {
            let sin = top + (bottom - top) * v;
            let cos = ((1.0 - sin) * (1.0 + sin)).max(0.0).sqrt();
            for column in 0..width {
                let pixel = &samples[(row * width + column) * channels..][..channels];
                let radiance = [0, 1, 2].map(|c| f64::from(pixel[c.min(channels - 1)]));
                for &(u, u_weight) in self.across {
                    let (s, c) = libm::sincos(PI * (2.0 * (column as f64 + u) / width as f64 - 1.0));
                    let d = [0, 1, 2].map(|i| cos * (s * right[i] + c * forward[i]) + sin * up[i]);
                    let direction = Direction::new(d[0], d[1], d[2]).unwrap_or(Direction::OUT);
                    let solid_angle = (top - bottom) * (2.0 * PI / width as f64) * u_weight * v_weight;
                    out.push(Sample { direction, radiance, solid_angle });
                }
            }
        }
        out
    }
}

/// Adds `factor` times `color`.
fn add(sum: &mut [f64; 3], color: [f64; 3], factor: f64) {
    for (sum, color) in sum.iter_mut().zip(color) {
        *sum += factor * color;
    }
}

struct Sample {
    direction: Direction,
    radiance: [f64; 3],
    solid_angle: f64,
}

/// Gauss-Legendre nodes and weights on 0 to 1 for a cell of so many degrees.
fn nodes(degrees: f64) -> &'static [(f64, f64)] {
    const ONE: [(f64, f64); 1] = [(0.5, 1.0)];
    const TWO: [(f64, f64); 2] = [(0.211_324_865_405_187_1, 0.5), (0.788_675_134_594_812_9, 0.5)];
    const FOUR: [(f64, f64); 4] = [
        (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
        (0.330_009_478_207_571_9, 0.326_072_577_431_273_07),
        (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
        (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
    ];
    const EIGHT: [(f64, f64); 8] = [
        (0.019_855_071_751_231_9, 0.050_614_268_145_188_13),
        (0.101_666_761_293_186_63, 0.111_190_517_226_687_24),
        (0.237_233_795_041_835_5, 0.156_853_322_938_943_64),
        (0.408_282_678_752_175_1, 0.181_341_891_689_180_98),
        (0.591_717_321_247_825, 0.181_341_891_689_180_98),
        (0.762_766_204_958_164_5, 0.156_853_322_938_943_64),
        (0.898_333_238_706_813_4, 0.111_190_517_226_687_24),
        (0.980_144_928_248_768_1, 0.050_614_268_145_188_13),
    ];
    match degrees {
        d if d < 0.5 => &ONE,
        d if d < 4.0 => &TWO,
        d if d < 20.0 => &FOUR,
        _ => &EIGHT,
    }
}

/// Means over whole squares of pixels (of equal area in a row; the rows of a square differ little), so that
/// no more than [`WIDEST`] remain in a row.
fn averaged(picture: &Picture) -> Picture {
    let step = picture.width.div_ceil(WIDEST);
    if step == 1 || !picture.width.is_multiple_of(step) || !picture.height.is_multiple_of(step) {
        return picture.clone();
    }
    let (width, height, channels) = (picture.width / step, picture.height / step, picture.channels);
    let area = |y: usize| {
        let edge = |i: usize| libm::sin(0.5 * PI - PI * i as f64 / picture.height as f64);
        edge(y) - edge(y + 1)
    };
    let mut samples = vec![0.0f32; width * height * channels];
    for (y, row) in samples.chunks_exact_mut(width * channels).enumerate() {
        let areas: Vec<f64> = (y * step..(y + 1) * step).map(area).collect();
        let total: f64 = areas.iter().sum::<f64>() * step as f64;
        for (i, sample) in row.iter_mut().enumerate() {
            let (x, c) = (i / channels, i % channels);
            let mut sum = 0.0;
            for (dy, area) in areas.iter().enumerate() {
                for dx in 0..step {
                    let pixel = (y * step + dy) * picture.width + x * step + dx;
                    sum += area * f64::from(picture.samples[pixel * channels + c]);
                }
            }
            *sample = (sum / total) as f32;
        }
    }
    Picture { width, height, channels, samples }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::HorizonRule;
    use relight_core::{Design, Family, LightSet};

    fn sh(count: usize) -> Basis {
        Family::by_name("sh").unwrap().build(&Design::new(count, &LightSet::default())).unwrap()
    }

    const EVERYWHERE: Horizon =
        Horizon { cap: Cap { axis: Direction::OUT, radius: PI }, rule: HorizonRule::Extrapolate };

    fn picture(width: usize, height: usize, value: impl Fn(usize, usize, usize) -> f32) -> Picture {
        let samples = (0..width * height * 3).map(|i| value(i / 3 % width, i / 3 / width, i % 3)).collect();
        Picture { width, height, channels: 3, samples }
    }

    #[test]
    fn light_from_everywhere_is_the_constant_alone() {
        let up = Direction::new(0.0, 1.0, 0.0).unwrap();
        for size in [(8, 4), (64, 32), (512, 256), (2048, 1024)] {
            let environment =
                Environment::new(picture(size.0, size.1, |_, _, c| c as f32), Direction::OUT, up).unwrap();
            let weights = environment.weights(&sh(16), &EVERYWHERE);
            for (j, weight) in weights.iter().enumerate() {
                for (c, value) in weight.iter().enumerate() {
                    // The integral of Y_00 is sqrt(4 pi), of all others 0.
                    let expected = if j == 0 { c as f64 * (4.0 * PI).sqrt() / PI } else { 0.0 };
                    assert!((value - expected).abs() < 2e-5, "{size:?} {j} {c}: {value} for {expected}");
                }
            }
        }
    }

    #[test]
    fn a_pixel_shines_from_where_it_stands() {
        // Forward along +x, up along +z: the picture's middle is +x, its right -y.
        let up = Direction::OUT;
        let lit = |x: usize, y: usize| {
            let picture = picture(64, 32, |i, j, _| f32::from(u8::from((i, j) == (x, y))));
            let environment = Environment::new(picture, Direction::RIGHT, up).unwrap();
            let weights = environment.weights(&sh(4), &EVERYWHERE);
            // Y_1 of (y, z, x) points where the light comes from.
            [-weights[3][0], -weights[1][0], weights[2][0]]
        };
        let toward = |v: [f64; 3]| Direction::new(v[0], v[1], v[2]).unwrap();
        let near = |v: [f64; 3], x: f64, y: f64, z: f64| toward(v).angle_to(toward([x, y, z])) < 0.08;
        assert!(near(lit(32, 15), 1.0, 0.0, 0.0));
        assert!(near(lit(48, 15), 0.0, -1.0, 0.0));
        assert!(near(lit(0, 15), -1.0, 0.0, 0.0));
        assert!(near(lit(5, 0), 0.0, 0.0, 1.0));
    }

    #[test]
    fn large_pictures_weigh_as_finely_as_small_ones_integrated_closely() {
        // The same radiance in pictures of 16, 2048: constant in blocks.
        let value = |x: usize, y: usize, c: usize| ((x * 7 + y * 13 + c * 5) % 11) as f32;
        let up = Direction::new(0.0, 1.0, 0.0).unwrap();
        let small = Environment::new(picture(16, 8, value), Direction::OUT, up).unwrap();
        let large =
            Environment::new(picture(2048, 1024, |x, y, c| value(x / 128, y / 128, c)), Direction::OUT, up)
                .unwrap();
        for basis in [sh(25), srbf()] {
            let [a, b] = [&small, &large].map(|e| e.weights(&basis, &EVERYWHERE));
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                assert!((a - b).abs() < 1e-4, "{a} {b}");
            }
        }
    }

    fn srbf() -> Basis {
        Family::by_name("srbf").unwrap().build(&Design::new(25, &LightSet::default())).unwrap()
    }

    #[test]
    fn lights_that_stand_for_it_have_its_irradiance() {
        let up = Direction::new(0.0, 1.0, 0.0).unwrap();
        let environment =
            Environment::new(picture(32, 16, |x, y, c| (x + 3 * y + c) as f32), Direction::OUT, up).unwrap();
        let sum = environment.lights(200).iter().map(|(_, color)| color[1]).sum::<f64>();
        let exact = environment.weights(&sh(1), &EVERYWHERE)[0][1] * (4.0 * PI).sqrt();
        assert!((sum / exact - 1.0).abs() < 1e-6, "{sum} {exact}");
    }

    #[test]
    fn axes_and_radiance_are_checked() {
        let up = Direction::new(0.0, 1.0, 0.1).unwrap();
        let black = || picture(2, 1, |_, _, _| 0.0);
        assert!(matches!(Environment::new(black(), Direction::OUT, up), Err(EnvironmentError::Axes { .. })));
        for bad in [f32::NAN, -1.0, f32::INFINITY] {
            let mut picture = black();
            picture.samples[4] = bad;
            let error = Environment::new(picture, Direction::OUT, Direction::RIGHT);
            assert!(matches!(error, Err(EnvironmentError::Radiance { x: 1, y: 0, .. })));
        }
    }
}
