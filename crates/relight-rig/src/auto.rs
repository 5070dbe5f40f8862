//! The cheapest model that is good enough.

use crate::errors::{Yardstick, directions};
use crate::{Fitting, Frame, Ground, Model, RigError, RigPart, SurfacePoint};

/// Nodes that an axis may have.
const NODES: [usize; 7] = [2, 3, 4, 5, 6, 8, 12];

/// A model and how wrong it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The model.
    pub model: Model,
    /// Its largest error in grey levels: 255 times that of reflected radiance.
    pub error_grey: f64,
}

/// What lights a rig must be good for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightFamily {
    /// Distance of the nearest lights from the frame's middle, in its radii, above 1; they may stand in any direction, or
    /// farther.
    pub nearest: f64,
    /// What a white diffuser at the frame's middle that faces such a light at its nearest reflects.
    pub brightness: f64,
}

impl LightFamily {
    /// The largest error of `part` under these lights, in grey levels: against harmonics at each point, which no rig betters.
    pub fn error_grey(&self, part: &RigPart, bands: usize) -> f64 {
        self.grey(part, &self.yardstick(&part.frame, &part.surface, bands))
    }

    /// Farther lights err less: one distance tells.
    fn yardstick<'a>(&self, frame: &Frame, surface: &'a [SurfacePoint], bands: usize) -> Yardstick<'a> {
        Yardstick::new(frame, surface, bands, &directions(), self.nearest)
    }

    fn grey(&self, part: &RigPart, yardstick: &Yardstick<'_>) -> f64 {
        let strength = self.brightness * self.nearest * self.nearest;
        255.0 * strength * yardstick.largest_errors(part)[0]
    }
}

/// The models that were tried, the last one the cheapest found that errs by at most `target_grey`; where none does within
/// `most` parameters, the last one is the best.
///
/// Axes are refined one at a time, that first whose refinement mends most for its cost; at the end each axis is made coarser
/// again as far as the target allows. A model's cost is its number of vectors.
///
/// # Errors
/// Those of [`Model::parse`].
pub fn cheapest(
    ground: &Ground,
    fitting: Fitting,
    bands: usize,
    lights: LightFamily,
    target_grey: f64,
    most: usize,
) -> Result<Vec<Choice>, RigError> {
    let mut tried = Vec::new();
    let yardstick = lights.yardstick(&ground.frame, &ground.surface, bands);
    let mut measure = |model: Model| {
        let error_grey = lights.grey(&ground.without_errors(&model, fitting), &yardstick);
        let choice = Choice { model, error_grey };
        tried.push(choice.clone());
        choice
    };
    let constant = measure(Model::parse("constant")?);
    let found = if constant.error_grey <= target_grey {
        constant
    } else {
        let gradient = measure(Model::parse("gradient")?);
        let mut steps = [0usize; 3];
        let mut best = constant;
        while best.error_grey > target_grey {
            let mut next: Option<([usize; 3], Choice, f64)> = None;
            for axis in 0..3 {
                let mut refined = steps;
                refined[axis] += 1;
                if refined[axis] > NODES.len()
                    || cost(refined) > most
                    || ground.frame.half_extent[axis] <= 0.0
                {
                    continue;
                }
                let choice = measure(model(refined)?);
                // Logarithms: halving an error is worth the same wherever it stands.
                let gain = libm::log(best.error_grey / choice.error_grey.max(f64::MIN_POSITIVE))
                    / libm::log(cost(refined) as f64 / cost(steps) as f64);
                if next.as_ref().is_none_or(|(.., most)| gain > *most) {
                    next = Some((refined, choice, gain));
                }
            }
            let Some((refined, choice, _)) = next else { break };
            (steps, best) = (refined, choice);
        }
        for axis in 0..3 {
            while best.error_grey <= target_grey && steps[axis] > 0 {
                let mut coarser = steps;
                coarser[axis] -= 1;
                let choice = measure(model(coarser)?);
                if choice.error_grey > target_grey {
                    break;
                }
                (steps, best) = (coarser, choice);
            }
        }
        let cheaper = gradient.model.parameters().len() < best.model.parameters().len();
        if gradient.error_grey <= target_grey && cheaper { gradient } else { best }
    };
    tried.retain(|choice| choice.model != found.model);
    tried.push(found);
    Ok(tried)
}

/// Vectors of the model with so many steps of refinement along each axis.
fn cost(steps: [usize; 3]) -> usize {
    steps.iter().map(|&step| if step == 0 { 1 } else { NODES[step - 1] }).product()
}

fn model(steps: [usize; 3]) -> Result<Model, RigError> {
    let axis = |step: usize| match step {
        0 => "constant".to_owned(),
        1 => "gradient".to_owned(),
        _ => NODES[step - 1].to_string(),
    };
    match steps {
        [0, 0, 0] => Model::parse("constant"),
        _ => Model::parse(&format!("mixed:{}", steps.map(axis).join(","))),
    }
}
