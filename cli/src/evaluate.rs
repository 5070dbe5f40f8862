//! `relight evaluate`: an asset beside photographs, light by light.

use crate::failure::{Exit, Failure};
use crate::near::{NearOptions, relit_near};
use crate::options::{Machine, MachineOptions, check_apart, check_writable};
use crate::photograph_options::PhotographOptions;
use crate::say::{self, say};
use crate::{interrupt, notes, progress};
use clap::Args;
use rayon::prelude::*;
use relight_core::metrics::{self, PictureError};
use relight_core::relighter::{Picture, relight};
use relight_core::{PositionMap, RelightingMaps, Space};
use relight_fit::NearLamps;
use relight_formats::{OpenCapture, PictureDepth, open_capture, read_asset, read_positions, write_picture};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// What to compare.
#[derive(Args, Debug)]
pub(crate) struct EvaluateArguments {
    /// The asset: .ktx2, .dds, .exr, .ptm, .rti or a .web folder
    asset: PathBuf,
    /// A .lp file, or a folder that holds one: the lights and their photographs
    set: PathBuf,
    #[command(flatten)]
    photographs: PhotographOptions,
    #[command(flatten)]
    near: NearOptions,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Write the mean absolute error of each pixel as a picture; black is 0, white 0.25 and more
    #[arg(long, value_name = "FILE.png")]
    heatmap: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Errors of one light.
pub(crate) struct PictureFigures {
    name: String,
    /// On stored values: encoded for integer pictures, linear for float ones.
    stored: PictureError,
    /// On sRGB-encoded values; differs for float pictures only.
    encoded: PictureError,
}

/// Errors of all lights of a set.
pub(crate) struct Evaluation {
    pub(crate) pictures: Vec<PictureFigures>,
    /// Whether the photographs hold linear floats.
    linear: bool,
    /// The error of each pixel that was asked for, its mean over lights and channels, stored values; empty for none.
    pub(crate) of_pixels: Vec<f32>,
}

/// The error of each pixel that a comparison gathers beside those of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PixelError {
    /// None, which costs nothing.
    None,
    Absolute,
    Squared,
}

/// Error that heat maps draw white.
const HEATMAP_FULL: f32 = 0.25;

/// Runs the subcommand.
pub(crate) fn run(arguments: &EvaluateArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    if let Some(path) = &arguments.heatmap {
        check_heatmap(path)?;
    }
    let mut capture = open_capture(&arguments.set)?;
    let whole = capture.size();
    arguments.photographs.apply(&mut capture, &machine, &std::env::temp_dir())?;
    let positions = match arguments.near.is_given() {
        true => read_positions(&arguments.asset, machine.memory)?,
        false => None,
    };
    let mut odd = Vec::new();
    let lamps = arguments.near.apply(&mut capture, whole, positions.as_ref(), &mut odd)?;
    capture.capture.notes.append(&mut odd);
    drop(positions);
    notes::print(&capture.capture.notes);
    let read = capture
        .capture
        .pictures
        .iter()
        .chain([&capture.capture.light_file, &arguments.asset])
        .chain(arguments.photographs.files())
        .chain(arguments.near.files());
    check_apart(&arguments.heatmap, read)?;
    let of_pixels = if arguments.heatmap.is_some() { PixelError::Absolute } else { PixelError::None };
    let evaluation = evaluate(&arguments.asset, &capture, lamps.as_ref(), &machine, of_pixels)?;
    if let Some(path) = &arguments.heatmap {
        let errors = evaluation.of_pixels.iter().copied();
        write_picture(path, &heat_map(capture.size(), errors), PictureDepth::U8)?;
    }
    if arguments.json {
        say::json(&evaluation.to_json());
    } else {
        evaluation.print();
    }
    Ok(())
}

/// Fails when no heat map can be written to `path`.
fn check_heatmap(path: &Path) -> Result<(), Failure> {
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        let message = format!("--heatmap {}: heat maps are written as .png", path.display());
        return Err(Failure::usage(message));
    }
    check_writable(path)
}

/// Fails when the pictures of `capture` are not of the size of what is to be compared with them.
pub(crate) fn check_size(size: (usize, usize), of: &Path, capture: &OpenCapture) -> Result<(), Failure> {
    let pictures = capture.size();
    if size == pictures {
        return Ok(());
    }
    let message = format!(
        "{} is {} x {} pixels, the pictures of {} are {} x {}; compare pictures of one size",
        of.display(),
        size.0,
        size.1,
        capture.capture.light_file.display(),
        pictures.0,
        pictures.1
    );
    Err(Failure::new(Exit::BadInput, message))
}

/// Relights `asset` at every light of `capture` and compares; under near `lamps`, each pixel as it sees its lamp.
pub(crate) fn evaluate(
    asset: &Path,
    capture: &OpenCapture,
    lamps: Option<&NearLamps>,
    machine: &Machine,
    of_pixels: PixelError,
) -> Result<Evaluation, Failure> {
    let maps = read_asset(asset, machine.memory)?;
    check_size((maps.width, maps.height), asset, capture)?;
    let photograph = |i| Ok(capture.photograph(i, machine.level, machine.memory)?);
    compare(&maps, capture, lamps, machine, &photograph, of_pixels)
}

/// Relights `maps` at every light of `capture` and compares with its photographs, which `photograph` gives.
pub(crate) fn compare(
    maps: &RelightingMaps,
    capture: &OpenCapture,
    lamps: Option<&NearLamps>,
    machine: &Machine,
    photograph: &(dyn Fn(usize) -> Result<Picture, Failure> + Sync),
    of_pixels: PixelError,
) -> Result<Evaluation, Failure> {
    let linear = capture.is_float();
    let near = lamps.map(|lamps| (lamps, lamps.position_map()));
    let bar = progress::bar("comparing", capture.infos.len());
    let sum = Mutex::new(vec![0.0f64; if of_pixels == PixelError::None { 0 } else { maps.pixels() }]);
    let figures = |i: usize| -> Result<PictureFigures, Failure> {
        interrupt::check()?;
        let light = &capture.capture.lights.lights[i];
        let photograph = photograph(i)?;
        let relit = match &near {
            None => relit(maps, light.direction, linear, machine),
            Some((lamps, positions)) => {
                let picture = relit_near(maps, lamps, positions, i, machine.level);
                if linear { picture } else { picture.encoded_from(Space::Linear) }
            }
        };
        let (relit, photograph) = same_channels(relit, photograph);
        let errors = |a: &Picture, b: &Picture| metrics::compare(&a.samples, &b.samples, a.width, a.channels);
        let stored = errors(&relit, &photograph);
        let mut sum = sum.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        add_errors(&mut sum, &relit, &photograph, of_pixels);
        drop(sum);
        let encoded = match linear {
            true => errors(&relit.encoded_from(Space::Linear), &photograph.encoded_from(Space::Linear)),
            false => stored,
        };
        bar.inc(1);
        Ok(PictureFigures { name: light.name.clone(), stored, encoded })
    };
    let at_once = pictures_at_once(maps, capture, near.as_ref().map(|(_, map)| map), machine);
    let all: Vec<usize> = (0..capture.infos.len()).collect();
    let mut pictures = Vec::with_capacity(all.len());
    for group in all.chunks(at_once) {
        pictures.extend(group.par_iter().map(|&i| figures(i)).collect::<Result<Vec<_>, _>>()?);
    }
    bar.finish_and_clear();
    let count = pictures.len() as f64;
    let sum = sum.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let of_pixels = sum.into_iter().map(|error| (error / count) as f32).collect();
    Ok(Evaluation { pictures, linear, of_pixels })
}

/// How many pictures are compared side by side within the memory that the asset leaves.
fn pictures_at_once(
    maps: &RelightingMaps,
    capture: &OpenCapture,
    positions: Option<&PositionMap>,
    machine: &Machine,
) -> usize {
    let texels = maps.texel_bytes();
    let points = positions.map_or(0, |map| size_of_val(&map.points[..]) as u64);
    // Relit and photographed in f32, encoded or widened once more, and as decoded.
    let whole = capture.infos[0].width as u64 * capture.infos[0].height as u64;
    // What a crop leaves out is decoded, too.
    let picture = maps.pixels() as u64 * 3 * 4 * 5 + (whole - maps.pixels() as u64) * 3 * 4;
    let room = machine.memory.saturating_sub(texels + points) / picture.max(1);
    room.clamp(1, machine.threads as u64) as usize
}

/// The asset under a light, in the photographs' space.
fn relit(maps: &RelightingMaps, light: relight_core::Direction, linear: bool, machine: &Machine) -> Picture {
    let picture = relight(maps, light, machine.level);
    if linear { picture.linear_from(maps.model.space) } else { picture.encoded_from(maps.model.space) }
}

/// Both with as many channels as the richer one.
pub(crate) fn same_channels(a: Picture, b: Picture) -> (Picture, Picture) {
    let channels = a.channels.max(b.channels);
    let widened = |picture: Picture| {
        if picture.channels == channels {
            return picture;
        }
        let samples = picture.samples.iter().flat_map(|&value| [value; 3]).collect();
        Picture { channels, samples, ..picture }
    };
    (widened(a), widened(b))
}

/// Adds the error of each pixel of a picture to `sum`, which has none where none is asked for.
fn add_errors(sum: &mut [f64], relit: &Picture, photograph: &Picture, of_pixels: PixelError) {
    let channels = relit.channels;
    let pairs = relit.samples.chunks_exact(channels).zip(photograph.samples.chunks_exact(channels));
    for (sum, (a, b)) in sum.iter_mut().zip(pairs) {
        let clipped = a.iter().zip(b).map(|(a, b)| (a.clamp(0.0, 1.0), b.clamp(0.0, 1.0)));
        let error = match of_pixels {
            PixelError::None => 0.0,
            PixelError::Absolute => f64::from(clipped.map(|(a, b)| (a - b).abs()).sum::<f32>()),
            PixelError::Squared => {
                let differences = clipped.map(|(a, b)| f64::from(a) - f64::from(b));
                differences.map(|difference| difference * difference).sum()
            }
        };
        // Rounded to 2^-40 so that the sum is exact, hence the same in any order.
        let fixed = (error / channels as f64 * (1u64 << 40) as f64).round() / (1u64 << 40) as f64;
        *sum += fixed;
    }
}

impl Evaluation {
    fn mean(&self, figure: impl Fn(&PictureFigures) -> f64) -> f64 {
        self.pictures.iter().map(figure).sum::<f64>() / self.pictures.len().max(1) as f64
    }

    fn worst(&self) -> Option<&PictureFigures> {
        self.pictures.iter().min_by(|a, b| a.stored.psnr.total_cmp(&b.stored.psnr))
    }

    /// Mean over the lights of the PSNR of stored values.
    pub(crate) fn mean_psnr(&self) -> f64 {
        self.mean(|p| p.stored.psnr)
    }

    /// Mean over the lights of the root mean square error of stored values.
    pub(crate) fn mean_rmse(&self) -> f64 {
        self.mean(|p| p.stored.rmse)
    }

    /// The root mean square error of each light.
    pub(crate) fn light_errors(&self) -> impl Iterator<Item = (&str, f64)> {
        self.pictures.iter().map(|p| (p.name.as_str(), p.stored.rmse))
    }

    /// Mean and worst figures in words.
    pub(crate) fn mean_words(&self) -> String {
        let encoded = match self.linear {
            true => format!(" ({:.2} dB on encoded values)", self.mean(|p| p.encoded.psnr)),
            false => String::new(),
        };
        let worst =
            self.worst().map_or(String::new(), |p| format!("; worst {:.2} dB, {}", p.stored.psnr, p.name));
        let (psnr, rmse) = (self.mean(|p| p.stored.psnr), self.mean(|p| p.stored.rmse));
        format!("mean PSNR {psnr:.2} dB{encoded}, RMSE {rmse:.4}{worst}")
    }

    /// Mean over the lights of the mean squared error of stored values.
    pub(crate) fn mean_square(&self) -> f64 {
        self.mean(|p| p.stored.rmse * p.stored.rmse)
    }

    fn print(&self) {
        let encoded = if self.linear { "  PSNR (encoded)" } else { "" };
        say!("PSNR dB    RMSE     max  colour shift  saturation{encoded}  picture");
        let row = |name: &str, e: [f64; 4], max: f64, encoded: f64| {
            let encoded = if self.linear { format!("  {encoded:14.2}") } else { String::new() };
            say!("{:7.2}  {:.4}  {max:6.3}  {:+12.4}  {:+10.4}{encoded}  {name}", e[0], e[1], e[2], e[3]);
        };
        let figures = |e: &PictureError| [e.psnr, e.rmse, shift(e), e.saturation_shift];
        for p in &self.pictures {
            row(&p.name, figures(&p.stored), p.stored.max, p.encoded.psnr);
        }
        let all = [0, 1, 2, 3].map(|i| self.mean(|p| figures(&p.stored)[i]));
        let max = self.pictures.iter().fold(0.0f64, |max, p| max.max(p.stored.max));
        row(&format!("mean of {}", self.pictures.len()), all, max, self.mean(|p| p.encoded.psnr));
        if let Some(worst) = self.worst() {
            let (x, y) = worst.stored.worst_pixel;
            let at = format!("worst: {}, its largest error at pixel {x}, {y}", worst.name);
            row(&at, figures(&worst.stored), worst.stored.max, worst.encoded.psnr);
        }
    }

    /// The figures as JSON.
    pub(crate) fn to_json(&self) -> Value {
        let figures = |e: &PictureError| {
            json!({
                "psnr": e.psnr.is_finite().then_some(e.psnr),
                "rmse": e.rmse,
                "max": e.max,
                "worst_pixel": [e.worst_pixel.0, e.worst_pixel.1],
                "mean_shift": e.mean_shift,
                "saturation_shift": e.saturation_shift,
            })
        };
        let picture = |p: &PictureFigures| {
            let mut value = figures(&p.stored);
            value["name"] = json!(p.name);
            if self.linear {
                value["psnr_encoded"] = json!(p.encoded.psnr.is_finite().then_some(p.encoded.psnr));
            }
            value
        };
        let mean_shift = [0, 1, 2].map(|channel| self.mean(|p| p.stored.mean_shift[channel]));
        let mut mean = json!({
            "psnr": Some(self.mean(|p| p.stored.psnr)).filter(|v| v.is_finite()),
            "rmse": self.mean(|p| p.stored.rmse),
            "max": self.mean(|p| p.stored.max),
            "mean_shift": mean_shift,
            "saturation_shift": self.mean(|p| p.stored.saturation_shift),
        });
        if self.linear {
            mean["psnr_encoded"] = json!(Some(self.mean(|p| p.encoded.psnr)).filter(|v| v.is_finite()));
        }
        json!({
            "values": if self.linear { "linear" } else { "encoded" },
            "pictures": self.pictures.iter().map(picture).collect::<Vec<_>>(),
            "mean": mean,
            "worst": self.worst().map(picture),
        })
    }
}

/// The error of each pixel in colours of a fixed scale: black 0, white 0.25 and more.
pub(crate) fn heat_map((width, height): (usize, usize), errors: impl Iterator<Item = f32>) -> Picture {
    let samples = errors.flat_map(|error| heat(error / HEATMAP_FULL)).collect();
    Picture { width, height, channels: 3, samples }
}

/// Mean over the channels of the mean difference, relit minus photograph.
fn shift(error: &PictureError) -> f64 {
    error.mean_shift.iter().sum::<f64>() / 3.0
}

/// Black, blue, red, yellow, white from 0 to 1.
pub(crate) fn heat(value: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.15, 0.1, 0.6], [0.85, 0.15, 0.2], [1.0, 0.85, 0.2], [1.0, 1.0, 1.0]];
    let at = value.clamp(0.0, 1.0) * 4.0;
    let stop = (at as usize).min(3);
    let between = at - stop as f32;
    std::array::from_fn(|c| STOPS[stop][c] + (STOPS[stop + 1][c] - STOPS[stop][c]) * between)
}
