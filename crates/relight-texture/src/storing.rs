//! What storing coefficients costs: measured while they are written, plane by plane and in relit
//! pictures.

use crate::cost::{light_energy, mean_products};
use crate::loops::sum_of_squares;
use relight_core::{CpuLevel, Layout, Model};
use std::sync::{Mutex, PoisonError};

/// What storing cost.
#[derive(Clone, Debug, PartialEq)]
pub struct PackReport {
    /// Root mean square error of the stored coefficients of each plane, in the order of
    /// [`Model::roles`], over all pixels of level 0.
    pub rmse: Vec<f64>,
    /// Root mean square error that each plane causes in relit pictures, over all pixels of level 0.
    /// Where the errors of a plane are made good by planes stored after it, what is left of them.
    pub plane_relit_rmse: Vec<f64>,
    /// Root mean square error that they make together in relit pictures, over the model's lights and
    /// channels, from every 29th pixel. As for [`light_energy`](crate::light_energy), luminance and
    /// base colour are taken for 1 where they multiply one another's errors.
    pub relit_rmse: f64,
}

/// One pixel of so many is looked at for what errors of several planes do together: no multiple of the
/// widths of blocks and of most pictures, so that every place in a block has its turn.
const SEEN: usize = 29;

/// Errors of a plane in a run of pixels.
#[derive(Clone, Debug, Default)]
pub struct PlaneErrors {
    /// Sum of squares over all pixels.
    square: f64,
    /// The same of errors against what the plane was given to store, where that is not its
    /// coefficients.
    square_of_given: Option<f64>,
    /// Those of every [`SEEN`]th pixel.
    seen: Vec<f32>,
}

/// Gathers the errors of runs from any thread, in any order.
#[derive(Debug)]
pub struct StoringErrors {
    layout: Layout,
    maps: usize,
    /// As of [`mean_products`].
    products: Vec<f64>,
    /// By plane, from its mean squared error to that of relit samples.
    energy: Vec<f64>,
    /// Each with its first pixel: added up in the order of pixels, so that the figures don't depend
    /// on threads.
    runs: Mutex<Vec<(usize, Run)>>,
}

#[derive(Debug)]
struct Run {
    /// By plane, the sum of squares, and of those against what was given.
    squares: Vec<(f64, f64)>,
    /// As of [`StoringErrors::relit_square`], over `seen` pixels.
    relit_square: f64,
    seen: usize,
}

impl PlaneErrors {
    /// Adds the errors of pixels `first ..`: what a texel gives back less the coefficient.
    pub fn add(&mut self, first: usize, errors: impl Iterator<Item = f32>) {
        self.add_all(CpuLevel::detect(), first, &errors.collect::<Vec<f32>>());
    }

    /// The errors times `factor`: of coefficients where these are of codes.
    pub fn scaled(mut self, factor: f32) -> Self {
        let square = f64::from(factor) * f64::from(factor);
        self.square *= square;
        self.square_of_given = self.square_of_given.map(|of_given| of_given * square);
        self.seen.iter_mut().for_each(|error| *error *= factor);
        self
    }
}

impl PlaneErrors {
    /// [`Self::add`] of errors in a row.
    pub(crate) fn add_all(&mut self, level: CpuLevel, first: usize, errors: &[f32]) {
        let next = first.next_multiple_of(SEEN) - first;
        self.seen.extend(errors.iter().skip(next).step_by(SEEN));
        self.square += sum_of_squares(level, errors);
    }

    /// Adds the errors of as many pixels against what the plane was given to store.
    pub(crate) fn add_given(&mut self, level: CpuLevel, errors: &[f32]) {
        *self.square_of_given.get_or_insert(0.0) += sum_of_squares(level, errors);
    }
}

impl StoringErrors {
    /// For planes of `model`.
    pub fn new(model: &Model) -> Self {
        Self {
            layout: model.layout,
            maps: model.maps(),
            products: mean_products(model),
            energy: light_energy(model),
            runs: Mutex::new(Vec::new()),
        }
    }

    /// With these factors from planes' mean squared errors to those of relit samples.
    pub(crate) fn with_energy(self, energy: &[f64]) -> Self {
        Self { energy: energy.to_vec(), ..self }
    }

    /// Takes the errors of the run that begins at pixel `first`, one a plane, each of the same
    /// pixels in the same order.
    pub fn add(&self, first: usize, planes: Vec<PlaneErrors>) {
        let run = Run {
            relit_square: self.relit_square(&planes),
            seen: planes.iter().map(|plane| plane.seen.len()).max().unwrap_or(0),
            squares: planes
                .into_iter()
                .map(|plane| (plane.square, plane.square_of_given.unwrap_or(plane.square)))
                .collect(),
        };
        self.runs.lock().unwrap_or_else(PoisonError::into_inner).push((first, run));
    }

    /// What storing `pixels` pixels cost.
    pub fn report(self, pixels: usize) -> PackReport {
        let mut runs = self.runs.into_inner().unwrap_or_else(PoisonError::into_inner);
        runs.sort_by_key(|(first, _)| *first);
        let runs = || runs.iter().map(|(_, run)| run);
        let planes = runs().next().map_or(0, |run| run.squares.len());
        let root = |square: f64| (square / pixels as f64).sqrt();
        let rmse = (0..planes).map(|plane| root(runs().map(|run| run.squares[plane].0).sum())).collect();
        let plane_relit_rmse = (0..planes)
            .map(|plane| root(self.energy[plane] * runs().map(|run| run.squares[plane].1).sum::<f64>()))
            .collect();
        let seen = runs().map(|run| run.seen).sum::<usize>().max(1);
        let relit_rmse = (runs().map(|run| run.relit_square).sum::<f64>() / seen as f64).sqrt();
        PackReport { rmse, plane_relit_rmse, relit_rmse }
    }

    /// Sum over the pixels that were seen of the squared error of their relit samples, a mean over
    /// lights and channels: e^T M e of the errors e of a channel's coefficients.
    fn relit_square(&self, planes: &[PlaneErrors]) -> f64 {
        let stride = self.layout.planes_per_map();
        let dot = |a: &PlaneErrors, b: &PlaneErrors| -> f64 {
            a.seen.iter().zip(&b.seen).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let mut sum = 0.0;
        for channel in 0..stride {
            for f in 0..self.maps {
                for g in 0..=f {
                    let [a, b] = [f, g].map(|map| &planes[map * stride + channel]);
                    let twice = if f == g { 1.0 } else { 2.0 };
                    sum += twice * self.products[f * self.maps + g] * dot(a, b);
                }
            }
        }
        let base: f64 = planes[self.maps * stride..].iter().map(|plane| dot(plane, plane)).sum();
        sum / stride as f64 + base / 3.0
    }
}
