//! From the planes of one basis to those of another: least squares between functions of light.
//!
//! A pixel of an asset is a function of light direction, a(l) = sum of b_f(l) c_f. In another basis it is the
//! a'(l) = sum of b'_g(l) c'_g that is nearest to it over the directions at hand, which is c' = T c with one
//! matrix T for all pixels: the solution of the new basis on those directions times the old basis there.
//! Pictures are never made.
//!
//! Source: MATH.md sections 1.2 and 1.3 (the solution); docs/stability.md for what happens beyond the
//! directions that were photographed.

use crate::{Decomposition, FitError, LightWeights};
use rayon::prelude::*;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{
    Basis, Direction, Layout, Model, PlaneRole, RelightingMaps, Stack, StackError, StackRows,
};
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::Range;

/// Directions over which functions are compared: 2,048 are 3 degrees apart on half the sphere, a third of the
/// finest functions' waves.
const DIRECTIONS: usize = 2048;

/// An asset's planes as pictures of one channel, in the order of [`Model::roles`]: what a [`Refit`] is of.
#[derive(Clone, Copy, Debug)]
pub struct PlaneStack<'a>(pub &'a RelightingMaps);

struct PlaneRows<'a> {
    maps: &'a RelightingMaps,
    first: usize,
}

impl Stack for PlaneStack<'_> {
    fn lights(&self) -> usize {
        self.0.planes.len()
    }

    fn width(&self) -> usize {
        self.0.width
    }

    fn height(&self) -> usize {
        self.0.height
    }

    fn channels(&self) -> usize {
        1
    }

    fn rows(&self, samples: Range<usize>) -> Result<Box<dyn StackRows + '_>, StackError> {
        assert!(samples.end <= self.pixels(), "the samples leave the planes");
        Ok(Box::new(PlaneRows { maps: self.0, first: samples.start }))
    }
}

impl StackRows for PlaneRows<'_> {
    fn copy(&self, plane: usize, first: usize, out: &mut [f32]) {
        self.maps.planes[plane].coefficients(self.first + first, out);
    }
}

/// How the planes of a model become those of another, channel by channel.
#[derive(Clone, Debug)]
pub struct Refit {
    /// The functions of light of the new planes.
    pub basis: Basis,
    /// What the new planes are.
    pub layout: Layout,
    /// The ratio of the largest to the smallest singular value of the new functions on the directions; 1 where
    /// the functions stay as they are.
    pub condition: f64,
    /// One for each channel of a new map.
    pub(crate) channels: Vec<ChannelRefit>,
    /// The planes that become the new base colour: three, or none.
    pub(crate) base_color: Vec<usize>,
}

/// What the planes of one channel are made of: (mean + sum of weight x plane) x factor.
#[derive(Clone, Debug)]
pub(crate) struct ChannelRefit {
    /// The planes that are weighed.
    pub(crate) planes: Vec<usize>,
    /// maps x planes, row-major; `None` where the new planes are these.
    pub(crate) weights: Option<Vec<f32>>,
    /// By new map, what there is without any plane.
    pub(crate) mean: Vec<f32>,
    /// The plane that multiplies them.
    pub(crate) factor: Option<usize>,
}

impl Refit {
    /// The planes of `model` as they are.
    ///
    /// # Errors
    /// [`FitError::Layouts`] for a model that is not consistent.
    pub fn unchanged(model: &Model) -> Result<Self, FitError> {
        let anywhere = Cap { axis: Direction::OUT, radius: PI };
        Self::new(model, model.basis.clone(), model.layout, anywhere, 0.0)
    }

    /// The way from `model` to `basis` in `layout`, by least squares over `domain`; functions that stay the
    /// same are not touched.
    ///
    /// Luminance and base colour are multiplied out where `layout` is rgb, and grey planes repeated. `ridge`
    /// holds coefficients small, as a part of the largest singular value squared.
    ///
    /// # Errors
    /// [`FitError::Ridge`] for a ridge outside 0..1; [`FitError::Layouts`] where planes of `layout` are no
    /// linear function of the model's, or where `basis` is learned and another than the model's.
    pub fn new(
        model: &Model,
        basis: Basis,
        layout: Layout,
        domain: Cap,
        ridge: f64,
    ) -> Result<Self, FitError> {
        if !(0.0..=1.0).contains(&ridge) {
            return Err(FitError::Ridge { ridge });
        }
        let refused = FitError::Layouts { from: model.layout, to: layout };
        let same = basis == model.basis;
        let channels = match (model.layout, layout) {
            (Layout::Shared, Layout::Shared) if same => 1,
            (_, Layout::Shared) => return Err(refused),
            (Layout::Lrgb, Layout::Lrgb) => 1,
            (_, Layout::Lrgb) => return Err(refused),
            (_, Layout::Grey) if model.channels() == 1 => 1,
            (_, Layout::Grey) => return Err(refused),
            (_, Layout::Rgb) => 3,
        };
        if matches!(basis, Basis::Learned(_)) && layout != Layout::Shared {
            return Err(refused);
        }
        let between = if same { None } else { Some(Between::new(&model.basis, &basis, domain, ridge)?) };
        let condition = between.as_ref().map_or(1.0, |between| between.condition);
        let maps = if layout == Layout::Shared { model.maps() } else { basis.count() };
        let roles = model.roles();
        let color_of = |c: usize| {
            roles.iter().position(
                |role| matches!(role, PlaneRole::BaseColor { channel } if usize::from(*channel) == c),
            )
        };
        let base_color =
            if layout == Layout::Lrgb { (0..3).filter_map(color_of).collect() } else { Vec::new() };
        let channel_refit = |c: usize| {
            let source = c.min(model.channels() - 1);
            let weighed = roles.iter().enumerate().filter_map(|(plane, role)| match role {
                PlaneRole::Coefficient { functions } => Some((plane, usize::from(functions[source]?))),
                PlaneRole::BaseColor { .. } => None,
            });
            let (planes, functions): (Vec<usize>, Vec<usize>) = weighed.unzip();
            let (weights, mean) = match &between {
                None => (None, vec![0.0; maps]),
                Some(between) => {
                    let row = |g: usize| functions.iter().map(move |&f| between.weight(g, f) as f32);
                    let mean = |g: usize| {
                        model.mean_functions()[source]
                            .map_or(0.0, |f| between.weight(g, usize::from(f)) as f32)
                    };
                    (Some((0..maps).flat_map(row).collect()), (0..maps).map(mean).collect())
                }
            };
            let factor = if layout == Layout::Rgb { color_of(c) } else { None };
            ChannelRefit { planes, weights, mean, factor }
        };
        let channels = (0..channels).map(channel_refit).collect();
        Ok(Self { basis, layout, condition, channels, base_color })
    }

    /// Planes of a channel.
    pub(crate) fn maps(&self) -> usize {
        self.channels[0].mean.len()
    }

    /// Whether the new planes are the old ones, one by one in the same order.
    pub fn keeps_planes(&self, model: &Model) -> bool {
        self.layout == model.layout && self.channels.iter().all(|channel| channel.weights.is_none())
    }

    /// The directions over which `model` and one of `basis` are to agree: the sphere where both have functions
    /// of it and the fitted lights, if known, lie on both sides of the picture plane; else the half above it.
    pub fn domain(model: &Model, basis: &Basis) -> Cap {
        let of_sphere = |basis: &Basis| match basis {
            Basis::Sh(_) | Basis::Srbf(_) => true,
            Basis::Learned(learned) => !learned.square().hemisphere,
            Basis::Ptm(_) | Basis::Hsh(_) => false,
        };
        let from_below = model.lights.is_empty() || model.lights.iter().any(|light| light.z() < 0.0);
        let whole = of_sphere(&model.basis) && of_sphere(basis) && from_below;
        Cap { axis: Direction::OUT, radius: if whole { PI } else { FRAC_PI_2 } }
    }
}

/// New functions x old functions: coefficients = matrix x coefficients.
struct Between {
    /// Old functions.
    count: usize,
    matrix: Vec<f64>,
    condition: f64,
}

impl Between {
    fn new(old: &Basis, new: &Basis, domain: Cap, ridge: f64) -> Result<Self, FitError> {
        let directions = fibonacci_in(domain, DIRECTIONS);
        let decomposition = Decomposition::new(new, &directions, LightWeights::Uniform)?;
        let count = old.count();
        let mut on_directions = vec![0.0; count * directions.len()];
        for (row, direction) in on_directions.chunks_exact_mut(count).zip(&directions) {
            old.evaluate(*direction, row);
        }
        let solution = decomposition.solution(ridge);
        let rows = solution.par_chunks_exact(directions.len()).flat_map_iter(|factors| {
            let mut sums = vec![0.0; count];
            for (factor, row) in factors.iter().zip(on_directions.chunks_exact(count)) {
                sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += factor * value);
            }
            sums
        });
        Ok(Self { count, matrix: rows.collect(), condition: decomposition.condition() })
    }

    /// What old function `f` counts for new function `g`.
    fn weight(&self, g: usize, f: usize) -> f64 {
        self.matrix[g * self.count + f]
    }
}
