//! Where the error of an asset comes from: by the stages in which it came about, by light and by pixel.

mod drawn;
mod report;

pub(crate) use report::heat_map_files;

use crate::bake::Versions;
use crate::evaluate::{self, Evaluation, PixelError};
use crate::failure::Failure;
use crate::options::Machine;
use relight_core::RelightingMaps;
use relight_fit::NearLamps;
use relight_formats::{OpenCapture, read_asset};
use std::path::Path;

/// The error of an asset, split up.
///
/// Errors are of stored values of pictures (encoded for integer ones, linear for floats), 0..1 and clipped to that, as
/// `relight evaluate` compares them; means are over lights, channels and pixels.
pub(crate) struct Budget {
    /// In the order in which they come about.
    pub(crate) stages: Vec<Stage>,
    /// Mean squared error of the asset as read back: the sum of what the stages add.
    pub(crate) total: f64,
    /// The judged lights in the order of the light file: those that were left out, or else those that were fitted.
    pub(crate) lights: Vec<LightBudget>,
    /// The worst first.
    pub(crate) worst_pixels: Vec<WorstPixel>,
    /// `None` where no GPU drew.
    pub(crate) gpu: Option<GpuDifference>,
    /// Why no GPU drew.
    pub(crate) gpu_missing: Option<String>,
    /// Width and height in pixels.
    pub(crate) size: (usize, usize),
}

/// A step on the way from pictures to the asset.
pub(crate) struct Stage {
    /// One of [`STAGES`].
    pub(crate) name: &'static str,
    /// Mean squared error that it adds; negative where it happens to take some away.
    pub(crate) adds: f64,
    /// The mean squared error of each pixel after it, row by row: over the judged lights, of "fit" over the fitted ones.
    pub(crate) map: Vec<f32>,
}

/// The error of a judged light.
#[derive(Clone, Default)]
pub(crate) struct LightBudget {
    pub(crate) name: String,
    /// Mean squared error after each of the stages from "held-out" on, or from "fit" on where nothing is held out.
    pub(crate) after: Vec<f64>,
}

/// A pixel of large error.
pub(crate) struct WorstPixel {
    /// Column.
    pub(crate) x: usize,
    /// Row from the top.
    pub(crate) y: usize,
    /// Root mean square error of the asset there over the judged lights.
    pub(crate) rmse: f64,
}

/// How far pictures drawn by a GPU are from those of the CPU, both in the asset's own space and not clipped.
pub(crate) struct GpuDifference {
    /// Its name and interface.
    pub(crate) adapter: String,
    /// The largest of a sample.
    pub(crate) max: f64,
    /// Root mean square over all samples.
    pub(crate) rms: f64,
    /// Lights that were drawn.
    pub(crate) lights: usize,
}

/// The stage of the fit, judged by the fitted pictures.
pub(crate) const FIT: &str = "fit";
/// The same, judged by pictures that are left out.
pub(crate) const HELD_OUT: &str = "held-out";
/// What turns coefficients into codes or halves.
pub(crate) const QUANTISATION: &str = "quantisation";
/// Blocks of codes.
pub(crate) const BLOCK_CODING: &str = "block coding";
/// Planes in JPEG.
pub(crate) const JPEG: &str = "JPEG";

/// All stages that there are.
const STAGES: [&str; 5] = [FIT, HELD_OUT, QUANTISATION, BLOCK_CODING, JPEG];

/// Worst pixels that are named.
const WORST: usize = 10;

/// So near in both directions to a worse pixel, one is not named: it is the same flaw.
const NEIGHBOURHOOD: usize = 8;

/// Pictures by which an asset is judged.
#[derive(Clone, Copy)]
pub(crate) struct Judges<'a> {
    pub(crate) capture: &'a OpenCapture,
    pub(crate) lamps: Option<&'a NearLamps>,
}

/// The files of an asset and the pictures to hold them against.
pub(crate) struct Account<'a> {
    pub(crate) asset: &'a Path,
    pub(crate) versions: &'a Versions,
    /// Those that were fitted.
    pub(crate) seen: Judges<'a>,
    /// Those that were left out, if any were.
    pub(crate) left_out: Option<Judges<'a>>,
    pub(crate) machine: &'a Machine,
}

impl Account<'_> {
    /// The budget, and what the judges say of the asset as it is read back.
    ///
    /// # Errors
    /// Those of reading the files, and Ctrl-C. A GPU that fails is no error.
    pub(crate) fn settle(&self) -> Result<(Budget, Evaluation), Failure> {
        let machine = self.machine;
        let judges = self.left_out.unwrap_or(self.seen);
        let read = |file: &Path| Ok::<_, Failure>(read_asset(file, machine.memory)?);
        let mut entries = Entries::default();
        let mut maps = read(&self.versions.float)?;
        let mut name = FIT;
        if self.left_out.is_some() {
            let mut seen = self.seen.compare(&maps, machine)?;
            entries.stage(name, &mut seen);
            name = HELD_OUT;
        }
        let mut evaluation = judges.compare(&maps, machine)?;
        entries.judged_stage(name, &mut evaluation);
        for (name, file) in &self.versions.steps {
            drop(maps);
            maps = read(file)?;
            evaluation = judges.compare(&maps, machine)?;
            entries.judged_stage(name, &mut evaluation);
        }
        let Entries { stages, lights, total } = entries;
        let lights = judges.capture.as_listed().into_iter().map(|light| lights[light].clone()).collect();
        let size = (maps.width, maps.height);
        let worst_pixels = stages.last().map_or(Vec::new(), |stage| worst_pixels(&stage.map, size.0));
        let directions = judges.capture.capture.lights.directions();
        let (gpu, gpu_missing) = match drawn::difference(self.asset, &maps, &directions, machine)? {
            Ok(gpu) => (Some(gpu), None),
            Err(why) => (None, Some(why)),
        };
        Ok((Budget { stages, total, lights, worst_pixels, gpu, gpu_missing, size }, evaluation))
    }
}

impl Judges<'_> {
    fn compare(&self, maps: &RelightingMaps, machine: &Machine) -> Result<Evaluation, Failure> {
        let Self { capture, lamps } = *self;
        let photograph = |i| Ok(capture.photograph(i, machine.level, machine.memory)?);
        evaluate::compare(maps, capture, lamps, machine, &photograph, PixelError::Squared)
    }
}

/// What a budget says so far.
#[derive(Default)]
struct Entries {
    stages: Vec<Stage>,
    lights: Vec<LightBudget>,
    total: f64,
}

impl Entries {
    /// Enters a stage, whose map it takes out of `after`.
    fn stage(&mut self, name: &'static str, after: &mut Evaluation) {
        let total = after.mean_square();
        let map = std::mem::take(&mut after.of_pixels);
        self.stages.push(Stage { name, adds: total - self.total, map });
        self.total = total;
    }

    /// The same of one after which the judges were asked.
    fn judged_stage(&mut self, name: &'static str, after: &mut Evaluation) {
        self.stage(name, after);
        let errors: Vec<(&str, f64)> = after.light_errors().collect();
        self.lights.resize_with(errors.len(), LightBudget::default);
        for (light, (name, rmse)) in self.lights.iter_mut().zip(errors) {
            name.clone_into(&mut light.name);
            light.after.push(rmse * rmse);
        }
    }
}

/// The worst pixels of a map of squared errors, no two in one neighbourhood; of equal ones the upper, then the left.
fn worst_pixels(map: &[f32], width: usize) -> Vec<WorstPixel> {
    let mut found: Vec<WorstPixel> = Vec::new();
    while found.len() < WORST {
        let is_new = |x: usize, y: usize| {
            found.iter().all(|w| w.x.abs_diff(x) > NEIGHBOURHOOD || w.y.abs_diff(y) > NEIGHBOURHOOD)
        };
        let mut worst: Option<(usize, f32)> = None;
        for (pixel, &error) in map.iter().enumerate() {
            if worst.is_none_or(|(_, most)| error > most) && is_new(pixel % width, pixel / width) {
                worst = Some((pixel, error));
            }
        }
        let Some((pixel, error)) = worst else { break };
        found.push(WorstPixel { x: pixel % width, y: pixel / width, rmse: f64::from(error).sqrt() });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worst_pixels_are_apart_and_of_equal_ones_the_upper_left_comes_first() {
        let (width, height) = (40, 21);
        let mut map = vec![0.0f32; width * height];
        let mut put = |x: usize, y: usize, rmse: f32| map[y * width + x] = rmse * rmse;
        put(30, 12, 0.75);
        // In its neighbourhood, at the very corner, and just beyond.
        put(22, 20, 0.7);
        put(21, 12, 0.5);
        put(3, 2, 0.5);
        put(20, 2, 0.5);
        let worst = worst_pixels(&map, width);
        let named: Vec<_> = worst.iter().take(4).map(|w| (w.x, w.y, w.rmse)).collect();
        assert_eq!(named, [(30, 12, 0.75), (3, 2, 0.5), (20, 2, 0.5), (21, 12, 0.5)]);
        assert!(worst.len() <= WORST);
        for (i, a) in worst.iter().enumerate() {
            assert!(worst[..i].iter().all(|b| a.x.abs_diff(b.x) > 8 || a.y.abs_diff(b.y) > 8));
        }
        assert_eq!(worst_pixels(&[0.25], 1).len(), 1);
    }
}
