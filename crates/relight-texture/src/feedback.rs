//! Errors of planes that are stored are made good by the planes that are stored after them.
//!
//! Blocks err by far more than a step of their ends, and the functions of light overlap: what one plane
//! lacks, its neighbours can give. The mean squared error of a relit sample over the lights is e^T M e
//! of the errors e of its coefficients, M the mean products of the functions. With M = U D U^T, U unit
//! upper triangular in the order of storing, that is the sum of D_f (e_f + sum over g before f of
//! U_gf e_g)^2: so plane f is given c_f - sum U_gf e_g to store instead of its coefficients c_f, and what
//! it errs by then counts D_f, its function's mean square less what later functions can make good,
//! instead of M_ff.
//!
//! Source: the conditional mean of Gaussians; as error feedback over weights, Frantar et al., *GPTQ*
//! (2022), equation 2.

use crate::loops::subtract;
use relight_core::{CpuLevel, Model};

/// M is taken with so much of its mean diagonal added: what errs in ways that no light of the capture
/// shows is not for free, and lights between them do show it.
const RIDGE: f64 = 1e-2;

/// What each plane is to give for the errors of those before it.
#[derive(Debug)]
pub(crate) struct Feedback {
    /// By plane: planes of layers stored before, and what their errors are multiplied by.
    terms: Vec<Vec<(usize, f32)>>,
    /// By plane, in the order of [`Model::roles`]: from the mean squared error against what it was to
    /// give to that of the relit picture's samples.
    pub(crate) energy: Vec<f64>,
}

impl Feedback {
    /// For `layers`, the planes of each in the order in which they are stored. `products` are those of
    /// [`mean_products`](crate::cost::mean_products).
    pub(crate) fn new(model: &Model, products: &[f64], layers: &[&[usize]]) -> Self {
        let (count, stride) = (model.maps(), model.layout.planes_per_map());
        let planes = model.plane_count();
        let mut terms = vec![Vec::new(); planes];
        // Planes of base colour stand for themselves.
        let mut energy = vec![1.0 / 3.0; planes];
        for channel in 0..stride {
            let order: Vec<(usize, usize)> = layers
                .iter()
                .enumerate()
                .flat_map(|(layer, planes)| planes.iter().map(move |&plane| (layer, plane)))
                .filter(|(_, plane)| *plane < count * stride && plane % stride == channel)
                .collect();
            let functions: Vec<usize> = order.iter().map(|(_, plane)| plane / stride).collect();
            let (upper, diagonal) = unit_upper(products, count, &functions);
            for (f, &(layer, plane)) in order.iter().enumerate() {
                energy[plane] = diagonal[f] / stride as f64;
                // Planes of the same layer are stored at once: theirs is what they will err by on
                // purpose.
                let mut factors = vec![0.0; f];
                for (g, &(layer_of_g, plane_of_g)) in order[..f].iter().enumerate() {
                    let factor = upper[g * count + f];
                    if layer_of_g < layer {
                        factors[g] += factor;
                    } else {
                        let of_g: &Vec<(usize, f32)> = &terms[plane_of_g];
                        for (r, (_, purpose)) in of_g.iter().enumerate() {
                            factors[r] -= factor * f64::from(*purpose);
                        }
                    }
                }
                let before = order.iter().take_while(|(before, _)| *before < layer);
                terms[plane] =
                    before.zip(factors).map(|(&(_, plane), factor)| (plane, factor as f32)).collect();
            }
        }
        Self { terms, energy }
    }

    /// Makes coefficients of `plane` what is to be stored: `errors(plane)` are those of planes before
    /// it, of the same pixels.
    pub(crate) fn apply<'a>(
        &self,
        plane: usize,
        errors: impl Fn(usize) -> &'a [f32],
        coefficients: &mut [f32],
        level: CpuLevel,
    ) {
        for &(before, factor) in &self.terms[plane] {
            subtract(level, factor, errors(before), coefficients);
        }
    }
}

/// U, k x k, unit upper triangular, and D of M = U D U^T, rows and columns in the order of `functions`.
fn unit_upper(products: &[f64], count: usize, functions: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let trace: f64 = products.iter().step_by(count + 1).sum();
    let mut rest: Vec<f64> =
        functions.iter().flat_map(|&f| functions.iter().map(move |&g| products[f * count + g])).collect();
    rest.iter_mut().step_by(count + 1).for_each(|square| *square += RIDGE * trace / count as f64);
    let mut diagonal = vec![0.0; count];
    for last in (0..count).rev() {
        diagonal[last] = rest[last * count + last];
        let scale = if diagonal[last] > 0.0 { 1.0 / diagonal[last] } else { 0.0 };
        let column: Vec<f64> = (0..last).map(|f| rest[f * count + last] * scale).collect();
        for f in 0..last {
            for g in 0..last {
                rest[f * count + g] -= diagonal[last] * column[f] * column[g];
            }
            rest[f * count + last] = column[f];
        }
    }
    (rest, diagonal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::mean_products;
    use relight_core::sphere::{Cap, fibonacci_in};
    use relight_core::{Design, Direction, Family, Layout, LightSet, Space};

    fn model(family: &str, count: usize, layout: Layout) -> Model {
        let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, 40);
        let set = LightSet::from_directions(lights.clone());
        let basis = Family::by_name(family).unwrap().build(&Design::new(count, &set)).unwrap();
        Model { basis, layout, space: Space::Encoded, lights, figures: None, provenance: None }
    }

    /// M with its ridge, k x k.
    fn ridged(model: &Model) -> Vec<f64> {
        let count = model.basis.count();
        let mut products = mean_products(model);
        let ridge = RIDGE * products.iter().step_by(count + 1).sum::<f64>() / count as f64;
        products.iter_mut().step_by(count + 1).for_each(|square| *square += ridge);
        products
    }

    /// The errors of all planes when each errs by `residual(plane)` against what it is given.
    fn errors(feedback: &Feedback, layers: &[Vec<usize>], residual: impl Fn(usize) -> f32) -> Vec<f32> {
        let mut errors = vec![0.0; layers.iter().flatten().count()];
        for layer in layers {
            let stored: Vec<f32> = layer
                .iter()
                .map(|&plane| {
                    let mut given = [0.0];
                    feedback.apply(plane, |plane| &errors[plane..=plane], &mut given, CpuLevel::detect());
                    given[0] + residual(plane)
                })
                .collect();
            for (&plane, error) in layer.iter().zip(stored) {
                errors[plane] = error;
            }
        }
        errors
    }

    /// Layers of so many planes, the last functions first.
    fn layers_of(model: &Model, planes: usize) -> Vec<Vec<usize>> {
        let all: Vec<usize> = (0..model.plane_count()).rev().collect();
        all.chunks(planes).map(<[usize]>::to_vec).collect()
    }

    fn feedback_of(model: &Model, layers: &[Vec<usize>]) -> Feedback {
        let slices: Vec<&[usize]> = layers.iter().map(Vec::as_slice).collect();
        Feedback::new(model, &mean_products(model), &slices)
    }

    #[test]
    fn later_planes_make_good_what_they_can() {
        for (family, count, layout) in
            [("srbf", 25, Layout::Rgb), ("ptm", 6, Layout::Lrgb), ("sh", 16, Layout::Grey)]
        {
            let model = model(family, count, layout);
            let (m, stride) = (ridged(&model), layout.planes_per_map());
            for planes in [1, 2, 3, 4] {
                let layers = layers_of(&model, planes);
                let feedback = feedback_of(&model, &layers);
                for wrong in 0..count * stride {
                    let errors = errors(&feedback, &layers, |plane| f32::from(u8::from(plane == wrong)));
                    let layer_of = |plane| layers.iter().position(|layer| layer.contains(&plane)).unwrap();
                    for (plane, error) in errors.iter().enumerate() {
                        let same = plane < count * stride && plane % stride == wrong % stride;
                        if plane == wrong {
                            assert_eq!(*error, 1.0);
                        } else if !same || layer_of(plane) <= layer_of(wrong) {
                            assert_eq!(*error, 0.0, "{family} {planes}: plane {plane} for {wrong}");
                        } else {
                            // Of all that it could be given, the least e^T M e.
                            let row = &m[plane / stride * count..][..count];
                            let slope: f64 = row
                                .iter()
                                .enumerate()
                                .map(|(f, m)| m * f64::from(errors[f * stride + wrong % stride]))
                                .sum();
                            assert!(
                                slope.abs() < 1e-4 * m[0],
                                "{family} {planes}: {plane} for {wrong}: {slope}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn energies_add_up_to_the_relit_error() {
        let model = model("srbf", 20, Layout::Rgb);
        let (m, layers) = (ridged(&model), layers_of(&model, 1));
        let feedback = feedback_of(&model, &layers);
        let residual = |plane: usize| ((plane * 7919 % 101) as f32 - 50.0) / 50.0;
        let errors = errors(&feedback, &layers, residual);
        let mut direct = 0.0;
        for channel in 0..3 {
            for f in 0..20 {
                for g in 0..20 {
                    let [a, b] = [f, g].map(|f| f64::from(errors[3 * f + channel]));
                    direct += m[20 * f + g] * a * b / 3.0;
                }
            }
        }
        let sum: f64 = (0..60).map(|plane| feedback.energy[plane] * f64::from(residual(plane)).powi(2)).sum();
        assert!((sum / direct - 1.0).abs() < 1e-4, "{sum} for {direct}");
        assert!(
            feedback.energy.iter().sum::<f64>() < 0.6 * m.iter().step_by(21).sum::<f64>(),
            "they overlap"
        );
    }
}
