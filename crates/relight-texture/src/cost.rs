//! What errors of a plane's coefficients do to the relit picture, over all lights.

use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Basis, Direction, Model, PlaneRole};
use std::f64::consts::FRAC_PI_2;

/// Lights over the hemisphere that stand for those of a model that names none.
const LIGHTS: usize = 256;

/// For each plane, in the order of [`Model::roles`], the factor from the mean squared error of its
/// coefficients to that of the relit picture's samples, over the model's lights (over the hemisphere
/// where it names none).
///
/// A plane that function f weighs in one of three channels: `E[b_f^2] / 3`. Luminance planes reach all
/// channels, through a base colour that is taken for its largest component, 1; planes of base colour
/// multiply a luminance that is taken for white, 1, in one of three channels. So LRGB is overestimated,
/// by as much as its picture is darker and more colourful than that.
///
/// The squares add up to that of all planes where their errors are independent. Those of blocks are not
/// quite: [`PackReport::relit_rmse`](crate::PackReport) holds what they do together.
pub fn light_energy(model: &Model) -> Vec<f64> {
    let squares = squares_of(model);
    let channels = model.channels() as f64;
    let energy = |role| match role {
        PlaneRole::Coefficient { functions } => {
            functions.into_iter().flatten().map(|f| squares[usize::from(f)]).sum::<f64>() / channels
        }
        PlaneRole::BaseColor { .. } => 1.0 / channels,
    };
    model.roles().into_iter().map(energy).collect()
}

/// For each plane the error of a coefficient beyond which the relit picture gets no worse, because it
/// ends at black and white, 0 and 1, as [`metrics`](relight_core::metrics) compares pictures: the error
/// that is the whole range as a root mean square over the lights.
///
/// Linear pictures may go on above white. There, too, a highlight counts for no more than white,
/// where it is one of few ([`choose_range`](crate::choose_range) says of how few).
pub fn error_ceilings(model: &Model) -> Vec<f64> {
    let squares = squares_of(model);
    let ceiling = |role| match role {
        PlaneRole::Coefficient { functions } => {
            let squares = functions.into_iter().flatten().map(|f| squares[usize::from(f)]);
            1.0 / squares.fold(0.0, f64::max).sqrt()
        }
        PlaneRole::BaseColor { .. } => 1.0,
    };
    model.roles().into_iter().map(ceiling).collect()
}

/// The mean over the lights of each function's square.
fn squares_of(model: &Model) -> Vec<f64> {
    let mut squares = vec![0.0; model.basis.count()];
    over_lights(model, |functions, share| {
        for (square, b) in squares.iter_mut().zip(functions) {
            *square += b * b * share;
        }
    });
    squares
}

/// Calls `add` with the functions' values and the share of each light.
fn over_lights(model: &Model, mut add: impl FnMut(&[f64], f64)) {
    let hemisphere;
    let lights = match model.lights.as_slice() {
        [] => {
            hemisphere = fibonacci_in(Cap { axis: Direction::OUT, radius: FRAC_PI_2 }, LIGHTS);
            &hemisphere
        }
        lights => lights,
    };
    let mut functions = vec![0.0; model.basis.count()];
    for light in lights {
        model.basis.evaluate(*light, &mut functions);
        add(&functions, 1.0 / lights.len() as f64);
    }
}

/// The mean over the lights of the products of the maps' functions, maps x maps: the mean squared error of a
/// relit sample is e^T M e of its coefficients' errors e. Of shared planes, a mean over the channels too.
pub(crate) fn mean_products(model: &Model) -> Vec<f64> {
    let maps = model.maps();
    let shared = match &model.basis {
        Basis::Learned(learned) => Some(learned),
        _ => None,
    };
    let mut products = vec![0.0; maps * maps];
    let mut add = |functions: &[f64], share: f64| {
        for (a, row) in functions.iter().zip(products.chunks_exact_mut(maps)) {
            for (product, b) in row.iter_mut().zip(functions) {
                *product += a * b * share;
            }
        }
    };
    over_lights(model, |functions, share| match shared {
        None => add(functions, share),
        Some(learned) => {
            let channels = learned.channels();
            for channel in 0..channels {
                let of_channel: Vec<f64> =
                    (0..maps).map(|plane| functions[learned.function(plane, channel)]).collect();
                add(&of_channel, share / channels as f64);
            }
        }
    });
    products
}
