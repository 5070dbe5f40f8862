//! What of a scene has to be computed for an asset, and what not.

use crate::horizon::Horizon;
use crate::path::{Accuracy, Evaluator, Path};
use crate::scene::{Lamp, Light, Scene};
use relight_core::{Direction, Model, Space};

/// Directional lights that stand for an environment where lights don't add up before decoding.
const ENVIRONMENT_LIGHTS: usize = 256;

/// What a scene needs of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// What becomes of directions that the capture doesn't know.
    pub horizon: Horizon,
    /// How functions are evaluated pixel by pixel; `None` without local lights.
    pub path: Option<Path>,
    /// Pictures with one weight a plane.
    pub uniform: Vec<UniformPass>,
    /// Indices into [`Scene::lights`] of those whose direction differs from pixel to pixel, by groups of one
    /// colour, which share their sums where lights add up before decoding.
    pub local: Vec<Vec<usize>>,
    /// Indices of lights that do nothing, and why.
    pub dark: Vec<(usize, &'static str)>,
    /// Channels of the picture.
    pub channels: usize,
}

/// A picture under light that comes from the same direction everywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct UniformPass {
    /// Indices into [`Scene::lights`] of those that were folded into it.
    pub lights: Vec<usize>,
    /// Weights of the k functions for R, G and B (grey pictures use the first).
    pub weights: [Vec<f32>; 3],
    /// What multiplies the decoded picture; (1, 1, 1) where the colours are in the weights.
    pub color: [f32; 3],
}

impl Plan {
    /// Plans `scene` for an asset of `model`.
    ///
    /// Where the asset is linear, all directional lights and environments are one pass: the bases are linear
    /// in their weights. Where it is encoded, each is decoded by itself before they add up.
    pub fn new(scene: &Scene, model: &Model, accuracy: Accuracy) -> Self {
        let horizon = Horizon::of(model, scene.horizon);
        let mut dark = Vec::new();
        let mut uniform: Vec<UniformPass> = Vec::new();
        let mut local: Vec<Vec<usize>> = Vec::new();
        for (index, light) in scene.lights.iter().enumerate() {
            if light.intensity == 0.0 || light.color == [0.0; 3] {
                dark.push((index, "no intensity"));
                continue;
            }
            if light.is_local() {
                if matches!(&light.lamp, Lamp::Spot(spot) if spot.cone == 0.0) {
                    dark.push((index, "a cone of 0 degrees"));
                    continue;
                }
                let same = |group: &&mut Vec<usize>| scene.lights[group[0]].color == light.color;
                match local.iter_mut().find(same) {
                    Some(group) => group.push(index),
                    None => local.push(vec![index]),
                }
                continue;
            }
            let passes = uniform_passes(index, light, model, &horizon);
            if passes.is_empty() {
                dark.push((index, "beyond the horizon of the capture"));
            }
            match (model.space, uniform.first_mut()) {
                (Space::Linear, Some(first)) => passes.iter().for_each(|pass| first.fold(pass)),
                _ => uniform.extend(passes),
            }
        }
        let path = (!local.is_empty()).then(|| Path::of_accuracy(&model.basis, accuracy));
        let colored = scene.lights.iter().enumerate().any(|(index, light)| {
            let gobo = matches!(&light.lamp, Lamp::Spot(spot) if spot.gobo.as_ref().is_some_and(|g| g.on && g.picture.channels == 3));
            let environment = matches!(&light.lamp, Lamp::Environment(e) if e.radiance.channels == 3);
            let [r, g, b] = light.color;
            (r != g || g != b || gobo || environment) && dark.iter().all(|(dark, _)| *dark != index)
        });
        let channels = if colored { 3 } else { model.channels() };
        Self { horizon, path, uniform, local, dark, channels }
    }

    /// Whether any light needs positions.
    pub fn reads_positions(&self) -> bool {
        !self.local.is_empty()
    }

    /// The evaluator of the plan's path.
    pub(crate) fn evaluator(&self, model: &Model) -> Option<Evaluator> {
        self.path.and_then(|path| Evaluator::new(&model.basis, path).ok())
    }
}

impl UniformPass {
    /// Adds another pass: of linear assets, whose colours are in the weights.
    fn fold(&mut self, other: &Self) {
        self.lights.extend(&other.lights);
        self.lights.dedup();
        for (weights, others) in self.weights.iter_mut().zip(&other.weights) {
            for (weight, other) in weights.iter_mut().zip(others) {
                *weight += other;
            }
        }
    }
}

/// The passes of one light: none where it is wholly beyond the horizon.
fn uniform_passes(index: usize, light: &Light, model: &Model, horizon: &Horizon) -> Vec<UniformPass> {
    let intensity = light.intensity;
    let color = light.color.map(|c| f64::from(c) * intensity);
    let mut functions = vec![0.0; model.basis.count()];
    let mut of_direction = |direction: Direction, color: [f64; 3]| {
        let taken = horizon.take(direction);
        if taken.factor == 0.0 {
            return None;
        }
        model.basis.evaluate(taken.direction, &mut functions);
        let color = color.map(|c| c * taken.factor);
        let (in_weights, after) = match model.space {
            Space::Linear => (color, [1.0; 3]),
            Space::Encoded => ([1.0; 3], color.map(|c| c as f32)),
        };
        let weights = in_weights.map(|c| functions.iter().map(|b| (c * b) as f32).collect());
        Some(UniformPass { lights: vec![index], weights, color: after })
    };
    match (&light.lamp, model.space) {
        (Lamp::Directional { direction }, _) => of_direction(*direction, color).into_iter().collect(),
        (Lamp::Environment(environment), Space::Linear) => {
            let weights = environment.weights(&model.basis, horizon);
            let weights = [0, 1, 2].map(|c| weights.iter().map(|w| (color[c] * w[c]) as f32).collect());
            vec![UniformPass { lights: vec![index], weights, color: [1.0; 3] }]
        }
        (Lamp::Environment(environment), Space::Encoded) => environment
            .lights(ENVIRONMENT_LIGHTS)
            .into_iter()
            .filter_map(|(direction, radiance)| {
                of_direction(direction, [0, 1, 2].map(|c| radiance[c] * color[c]))
            })
            .collect(),
        _ => Vec::new(),
    }
}
