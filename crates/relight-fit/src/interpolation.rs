//! Values at scattered lights continued over the sphere: smoothing splines with a closed form for leaving each
//! light out.

use crate::row_products::quadratic_form;
use crate::singular_values::SingularValues;
use nalgebra::DMatrix;
use rayon::prelude::*;
use relight_core::Direction;
use relight_core::sphere::Cap;
use std::f64::consts::PI;

/// Smoothings tried, as parts of the kernel's mean eigenvalue. Not 0: two lights in one place would have no
/// solution.
const SMOOTHINGS: [f64; 6] = [1e-6, 1e-3, 1e-2, 3e-2, 0.1, 0.3];

/// Beyond the outermost light by more than this (radians), values stay what they are there: splines run away.
const MARGIN: f64 = 0.1;

/// Linear functions along which the lights lie apart by less than this don't take part: all lights in a plane,
/// on a ring, in one place.
const FLAT: f64 = 1e-6;

/// The thin-plate spline r^2 log r of the chord r between directions, plus linear functions of direction.
///
/// Source: Duchon, *Splines minimizing rotation-invariant semi-norms in Sobolev spaces*, 1977; measured on five
/// captures beside -r and r^3 (docs/accuracy.md, "Learned planes").
#[derive(Clone, Debug)]
pub(crate) struct Interpolation {
    /// Part of the kernel's mean eigenvalue that was taken.
    pub(crate) smoothing: f64,
    /// The same as a number.
    diagonal: f64,
    lights: Vec<Direction>,
    covered: Cap,
    /// Linear functions as coefficients of 1, x, y, z.
    linear: Vec<[f64; 4]>,
    /// (N + linear functions) x N: from values to what kernels and linear functions are multiplied by.
    solution: DMatrix<f64>,
}

/// What splines through the same lights share, whatever their smoothing.
struct SplineSystem<'a> {
    lights: &'a [Direction],
    covered: Cap,
    linear: Vec<[f64; 4]>,
    /// (N + linear functions) squared, without smoothing.
    matrix: DMatrix<f64>,
    /// The kernel's mean eigenvalue beside the linear functions.
    mean: f64,
}

impl<'a> SplineSystem<'a> {
    /// `None` without lights.
    fn new(lights: &'a [Direction]) -> Option<Self> {
        let n = lights.len();
        let covered = Cap::enclosing(lights)?;
        let sum = lights.iter().fold([0.0; 3], |sum, light| {
            let d = light.components();
            [0, 1, 2].map(|i| sum[i] + d[i])
        });
        let middle = sum.map(|s| s / n as f64);
        let around = DMatrix::from_fn(n, 3, |i, j| lights[i].components()[j] - middle[j]);
        let SingularValues { values, right, left } = SingularValues::of(around);
        let told_apart = values.iter().filter(|&&value| value > FLAT * (n as f64).sqrt()).count();
        // 1, and the directions along which the lights lie apart.
        let mut linear = vec![[1.0, 0.0, 0.0, 0.0]];
        linear.extend((0..told_apart).map(|r| {
            let [x, y, z] = [0, 1, 2].map(|i| right[(i, r)]);
            [-(0..3).map(|i| right[(i, r)] * middle[i]).sum::<f64>(), x, y, z]
        }));
        let rank = linear.len();
        let matrix = DMatrix::from_fn(n + rank, n + rank, |i, j| match (i < n, j < n) {
            (true, true) => kernel(lights[i], lights[j]),
            (true, false) => value_of(&linear[j - n], lights[i]),
            (false, true) => value_of(&linear[i - n], lights[j]),
            (false, false) => 0.0,
        });
        // Orthonormal over the lights.
        let flat = |i: usize, r: usize| if r == 0 { 1.0 / (n as f64).sqrt() } else { left[(i, r - 1)] };
        // The kernel's trace is 0: its mean eigenvalue beside the linear functions is what they take away.
        let of_linear: f64 = (0..rank)
            .map(|r| {
                let row = |i: usize| (0..n).map(|j| matrix[(i, j)] * flat(j, r)).sum::<f64>();
                (0..n).map(|i| flat(i, r) * row(i)).sum::<f64>()
            })
            .sum();
        let mean = if n > rank { -of_linear / (n - rank) as f64 } else { 0.0 };
        Some(Self { lights, covered, linear, matrix, mean })
    }

    /// `None` where the system has no solution.
    fn smoothed(&self, smoothing: f64) -> Option<Interpolation> {
        let Self { lights, covered, linear, matrix, mean } = self;
        let diagonal = if *mean > 0.0 { smoothing * mean } else { 1.0 };
        let mut matrix = matrix.clone();
        for i in 0..lights.len() {
            matrix[(i, i)] += diagonal;
        }
        let solution = matrix.lu().try_inverse()?.columns(0, lights.len()).into_owned();
        if solution.iter().any(|value| !value.is_finite()) {
            return None;
        }
        let (lights, covered, linear) = (lights.to_vec(), *covered, linear.clone());
        Some(Interpolation { smoothing, diagonal, lights, covered, linear, solution })
    }
}

impl Interpolation {
    /// Bytes that [`Self::of_pictures`] takes for `lights` lights: the system, and for each smoothing its own, taken
    /// apart, inverted, and what is kept of that.
    pub(crate) fn bytes(lights: u64) -> u64 {
        let rows = lights + 4;
        8 * rows * rows * (1 + 3 * SMOOTHINGS.len() as u64)
    }

    /// Takes the smoothing that predicts pictures best from the others; `gram` holds the mean products of the
    /// N pictures, N x N. `None` without lights.
    pub(crate) fn of_pictures(lights: &[Direction], gram: &[f64]) -> Option<Self> {
        let system = SplineSystem::new(lights)?;
        let judged = |&smoothing: &f64| {
            let fit = system.smoothed(smoothing)?;
            let error: f64 = (0..lights.len()).map(|light| quadratic_form(gram, &fit.left_out(light))).sum();
            Some((error, fit))
        };
        let tried: Vec<(f64, Self)> = SMOOTHINGS.par_iter().filter_map(judged).collect();
        tried.into_iter().reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, fit)| fit)
    }

    /// By how much each light's value counts towards `direction`: N numbers.
    pub(crate) fn row(&self, direction: Direction) -> Vec<f64> {
        let reach = Cap { axis: self.covered.axis, radius: (self.covered.radius + MARGIN).min(PI) };
        let direction = reach.nearest(direction);
        let kernels = self.lights.iter().map(|&light| kernel(direction, light));
        let factors: Vec<f64> = kernels.chain(self.linear.iter().map(|l| value_of(l, direction))).collect();
        let column = |j: usize| self.solution.column(j).iter().zip(&factors).map(|(s, f)| s * f).sum();
        (0..self.lights.len()).map(column).collect()
    }

    /// What the values are multiplied by for light `light`'s own less its prediction from the others.
    ///
    /// Source: Rippa, *An algorithm for selecting a good value for the parameter c in radial basis function
    /// interpolation*, 1999, which holds with smoothing too.
    pub(crate) fn left_out(&self, light: usize) -> Vec<f64> {
        let row = self.solution.row(light);
        let own = row[light];
        // Nothing else says anything about a light that the linear functions need: its prediction is 0.
        let only = |j: usize| if j == light { 1.0 } else { 0.0 };
        (0..self.lights.len()).map(|j| if own > 1e-12 { row[j] / own } else { only(j) }).collect()
    }

    /// How much of a light's value is not its own fit's: 1 less the leverage.
    pub(crate) fn freedom(&self, light: usize) -> f64 {
        self.diagonal * self.solution[(light, light)]
    }

    /// The lights.
    pub(crate) fn lights(&self) -> &[Direction] {
        &self.lights
    }

    /// The cap that holds the lights.
    pub(crate) fn covered(&self) -> Cap {
        self.covered
    }
}

fn one_x_y_z(direction: Direction) -> [f64; 4] {
    let [x, y, z] = direction.components();
    [1.0, x, y, z]
}

fn value_of(linear: &[f64; 4], direction: Direction) -> f64 {
    linear.iter().zip(one_x_y_z(direction)).map(|(c, v)| c * v).sum()
}

/// r^2 log r.
fn kernel(a: Direction, b: Direction) -> f64 {
    let [a, b] = [a, b].map(Direction::components);
    let square: f64 = (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum();
    if square > 0.0 { 0.5 * square * libm::log(square) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row_products::dot;
    use relight_core::sphere::fibonacci_in;

    fn dome(count: usize) -> Vec<Direction> {
        fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, count)
    }

    fn smoothed(lights: &[Direction], smoothing: f64) -> Option<Interpolation> {
        SplineSystem::new(lights)?.smoothed(smoothing)
    }

    #[test]
    fn linear_functions_are_kept_and_values_met() {
        let lights = dome(30);
        let fit = smoothed(&lights, 1e-6).unwrap();
        let linear = |d: Direction| 0.3 + 0.2 * d.x() - d.y() + 0.5 * d.z();
        let values: Vec<f64> = lights.iter().map(|&light| linear(light)).collect();
        for direction in dome(200) {
            assert!((dot(&fit.row(direction), &values) - linear(direction)).abs() < 1e-9);
        }
        let values: Vec<f64> = (0..30).map(|i| f64::from(i * 7 % 11)).collect();
        for (light, value) in lights.iter().zip(&values) {
            assert!((dot(&fit.row(*light), &values) - value).abs() < 1e-3);
        }
    }

    #[test]
    fn leaving_out_in_closed_form_is_leaving_out() {
        let lights = dome(20);
        let values: Vec<f64> = (0..20).map(|i| f64::from(i * 7 % 11) * 0.1).collect();
        let fit = smoothed(&lights, 0.03).unwrap();
        for light in [0, 7, 19] {
            let others: Vec<usize> = (0..20).filter(|&i| i != light).collect();
            let n = others.len();
            let diagonal = fit.diagonal;
            let at = |i: usize| lights[others[i]];
            let system = DMatrix::from_fn(n + 4, n + 4, |i, j| match (i < n, j < n) {
                (true, true) => kernel(at(i), at(j)) + if i == j { diagonal } else { 0.0 },
                (true, false) => one_x_y_z(at(i))[j - n],
                (false, true) => one_x_y_z(at(j))[i - n],
                (false, false) => 0.0,
            });
            let right = DMatrix::from_fn(n + 4, 1, |i, _| if i < n { values[others[i]] } else { 0.0 });
            let solved = system.lu().solve(&right).unwrap();
            let kernels = (0..n).map(|i| kernel(lights[light], at(i)) * solved[i]).sum::<f64>();
            let linear: f64 = (0..4).map(|j| one_x_y_z(lights[light])[j] * solved[n + j]).sum();
            let expected = values[light] - kernels - linear;
            assert!((dot(&fit.left_out(light), &values) - expected).abs() < 1e-8, "{light}");
        }
    }

    #[test]
    fn few_coplanar_and_coincident_lights_have_a_solution() {
        let ring: Vec<Direction> =
            (0..12).map(|i| Direction::from_azimuth_elevation(f64::from(i) * 0.5, 0.6).unwrap()).collect();
        let mut twice = dome(9);
        twice.extend(dome(9));
        for lights in [dome(1), dome(2), dome(3), ring, twice, vec![Direction::OUT; 5]] {
            let fit = smoothed(&lights, 1e-6).unwrap();
            let ones = vec![1.0; lights.len()];
            for direction in fibonacci_in(Cap { axis: Direction::OUT, radius: 3.1 }, 50) {
                let value = dot(&fit.row(direction), &ones);
                assert!((value - 1.0).abs() < 1e-6, "{} lights: {value}", lights.len());
            }
        }
    }
}
