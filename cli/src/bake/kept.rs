//! Coefficients that are kept on disk, tile by tile, and taken up by later bakes.

use super::fit::{BakeFit, Solved};
use crate::failure::Failure;
use crate::{interrupt, progress};
use rayon::prelude::*;
use relight_core::{Basis, CoefficientDistribution, CpuLevel, FitFigures, Model, Stack};
use relight_fit::{FitError, LeaveOneOut, Misfit, PixelFit, Refit, SPAN, for_each_span_within};
use relight_formats::{FitFolder, FormatError, Odd, TileGrid, TileStack, Tiles};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// A fit whose coefficients are known, and what it had found.
pub(crate) struct KeptFit {
    /// From planes to the same planes.
    pub(super) planes: Refit,
    pub(super) figures: FitFigures,
    pub(super) leave_one_out: LeaveOneOut,
    pub(super) words: String,
    pub(super) weights: Vec<f64>,
    pub(super) solution: Value,
}

/// What a fit found, as it is kept. Numbers may be infinite, which JSON has no word for.
#[derive(Serialize, Deserialize)]
pub(crate) struct Facts {
    /// JSON.
    basis: String,
    figures: FitFigures,
    /// Of each light: fitted, left out, leverage.
    errors: [Vec<f64>; 3],
    /// Light, error, expected error, better light.
    misfits: Vec<(usize, f64, f64, Option<usize>)>,
    notes: Vec<String>,
    words: String,
    weights: Vec<f64>,
    /// JSON.
    solution: String,
    /// Planes of its coefficients.
    planes: usize,
}

/// What was taken from a cache or put there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CacheUse {
    /// Tiles whose coefficients were there.
    pub(crate) taken: usize,
    /// Tiles that were fitted and kept.
    pub(crate) fitted: usize,
    /// Files that were odd, and were removed.
    pub(crate) odd: usize,
}

impl CacheUse {
    /// For people.
    pub(crate) fn words(&self) -> String {
        match (self.taken, self.fitted) {
            (taken, 0) => format!("cache: the fit is taken up, {taken} tiles; no picture was decoded"),
            (0, fitted) => format!("cache: {fitted} tiles are fitted and kept"),
            (taken, fitted) => {
                format!(
                    "cache: {taken} of {} tiles are taken up from an earlier run, {fitted} are fitted",
                    taken + fitted
                )
            }
        }
    }

    /// What was odd.
    pub(crate) fn note(self) -> Option<String> {
        (self.odd > 0)
            .then(|| format!("{} files of the cache were damaged; they are removed and made again", self.odd))
    }

    /// For reports.
    pub(super) fn json(self) -> Value {
        json!({ "tiles_taken": self.taken, "tiles_fitted": self.fitted, "odd_files": self.odd })
    }
}

/// A fit's folder and how its picture is cut.
pub(crate) struct Keeper {
    pub(crate) folder: FitFolder,
    pub(crate) size: (usize, usize),
    pub(crate) grid: TileGrid,
    pub(crate) counts: CacheUse,
}

impl Keeper {
    /// For a picture of `size` pixels.
    pub(crate) fn new(folder: FitFolder, size: (usize, usize)) -> Self {
        let grid = TileGrid::new(size.0 * size.1, SPAN);
        Self { folder, size, grid, counts: CacheUse::default() }
    }

    /// What the fit found, where that is there and whole.
    pub(crate) fn facts(&mut self) -> Option<Facts> {
        let facts = self.folder.facts();
        self.unless_odd(facts)
    }

    /// The fit of `facts`, where its coefficients are there and whole too; `model` has its functions.
    pub(crate) fn take_up(&mut self, facts: Facts, model: &Model) -> Option<(BakeFit<'static>, TileStack)> {
        let (fit, planes) = facts.fit(model)?;
        let all: Vec<usize> = (0..self.grid.count()).collect();
        let tiles = self.folder.tiles(self.grid, planes, &all);
        self.counts.odd += tiles.odd;
        let taken = self.grid.count();
        let stack = TileStack::new(&self.folder, self.size, self.grid, planes, tiles)?;
        self.counts.taken = taken;
        Some((fit, stack))
    }

    /// How the coefficients of each plane are distributed, where that was kept; nothing otherwise.
    pub(crate) fn distributions(&mut self) -> Vec<CoefficientDistribution> {
        let kept = self.folder.distributions();
        self.unless_odd(kept).unwrap_or_default()
    }

    /// What was in a file, which counts where it was odd.
    fn unless_odd<T>(&mut self, found: Result<Option<T>, Odd>) -> Option<T> {
        found.unwrap_or_else(|Odd| {
            self.counts.odd += 1;
            None
        })
    }

    /// Whether only what the fit found is missing.
    pub(crate) fn has_tiles_without_facts(&self) -> bool {
        let has_any = (0..self.grid.count()).any(|tile| self.folder.has_file_of_tile(tile));
        has_any && !matches!(self.folder.facts::<Facts>(), Ok(Some(_)))
    }

    /// Whether what a fit found and these tiles are there, as far as their heads tell.
    pub(crate) fn holds(&self, tiles: &[usize]) -> bool {
        let Ok(Some(facts)) = self.folder.facts::<Facts>() else { return false };
        tiles.iter().all(|&tile| self.folder.has_tile(self.grid, facts.planes, tile))
    }

    /// Fits the tiles of `wanted` that are missing and keeps them, with what `fit` found; `model` is that of `fit`. Gives the
    /// tiles of `wanted`.
    ///
    /// # Errors
    /// [`KeepError::Folder`] where the folder can't take them, [`KeepError::Work`] for everything else.
    pub(crate) fn fill(
        &mut self,
        fit: &BakeFit<'_>,
        model: &Model,
        stack: &dyn Stack,
        level: CpuLevel,
        wanted: &[usize],
    ) -> Result<Tiles, KeepError> {
        self.folder.create()?;
        let planes = model.plane_count();
        self.folder.keep_facts(&Facts::of(fit, planes))?;
        let mut tiles = self.folder.tiles(self.grid, planes, wanted);
        self.counts.odd += tiles.odd;
        let missing: Vec<usize> =
            wanted.iter().copied().filter(|&tile| tiles.files[tile].is_none()).collect();
        self.counts.taken = wanted.len() - missing.len();
        self.counts.fitted = missing.len();
        let pixels = missing.iter().map(|&tile| self.grid.pixels(tile).len()).sum();
        let bar = progress::bar("fitting", pixels);
        let pixel_fit: PixelFit<'_> = fit.solved.pixel_fit();
        let fitted = missing.par_iter().map(|&tile| -> Result<_, KeepError> {
            let writer = self.folder.tile_writer(self.grid, planes, tile)?;
            for_each_span_within(stack, pixel_fit, level, self.grid.pixels(tile), SPAN, |span| {
                interrupt::check().map_err(Failure::from).map_err(KeepError::Work)?;
                writer.write(span, model)?;
                bar.inc(span.pixels as u64);
                Ok::<(), KeepError>(())
            })?;
            Ok((tile, writer.finish()?))
        });
        for (tile, file) in fitted.collect::<Result<Vec<_>, _>>()? {
            tiles.files[tile] = Some(file);
        }
        bar.finish_and_clear();
        Ok(tiles)
    }

    /// The fit of which [`Self::fill`] made all tiles.
    pub(crate) fn reopen(
        &self,
        fit: &BakeFit<'_>,
        model: &Model,
        tiles: Tiles,
    ) -> Option<(BakeFit<'static>, TileStack)> {
        let (fit, planes) = Facts::of(fit, model.plane_count()).fit(model)?;
        Some((fit, TileStack::new(&self.folder, self.size, self.grid, planes, tiles)?))
    }
}

/// Why tiles could not be kept.
pub(crate) enum KeepError {
    /// The folder can't take them.
    Folder(FormatError),
    /// What makes them failed.
    Work(Failure),
}

impl From<FormatError> for KeepError {
    fn from(error: FormatError) -> Self {
        Self::Folder(error)
    }
}

impl From<FitError> for KeepError {
    fn from(error: FitError) -> Self {
        Self::Work(error.into())
    }
}

impl From<KeepError> for Failure {
    fn from(error: KeepError) -> Self {
        match error {
            KeepError::Folder(error) => error.into(),
            KeepError::Work(failure) => failure,
        }
    }
}

impl Facts {
    fn of(fit: &BakeFit<'_>, planes: usize) -> Self {
        let solved = &fit.solved;
        let errors = solved.leave_one_out();
        Self {
            basis: serde_json::to_string(&solved.basis()).unwrap_or_default(),
            figures: solved.figures(),
            errors: [errors.fit.clone(), errors.left_out.clone(), errors.leverage.clone()],
            misfits: fit.misfits.iter().map(|m| (m.light, m.rmse, m.expected, m.better)).collect(),
            notes: fit.notes.clone(),
            words: solved.words(),
            weights: solved.weights(),
            solution: solved.solution().to_string(),
            planes,
        }
    }

    /// The functions.
    pub(crate) fn basis(&self) -> Option<Basis> {
        serde_json::from_str(&self.basis).ok()
    }

    /// The fit, and its number of planes; `model` is that of the asset.
    fn fit(self, model: &Model) -> Option<(BakeFit<'static>, usize)> {
        let planes = Refit::unchanged(model).ok()?;
        let [fit, left_out, leverage] = self.errors;
        let misfit = |(light, rmse, expected, better)| Misfit { light, rmse, expected, better };
        let kept = KeptFit {
            planes,
            figures: self.figures,
            leave_one_out: LeaveOneOut { fit, left_out, leverage },
            words: self.words,
            weights: self.weights,
            solution: serde_json::from_str(&self.solution).ok()?,
        };
        let misfits = self.misfits.into_iter().map(misfit).collect();
        let fit = BakeFit { solved: Solved::Kept(Box::new(kept)), notes: self.notes, misfits };
        Some((fit, model.plane_count()))
    }
}
