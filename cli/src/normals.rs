//! `relight normals`: normals, albedo and height of a surface from pictures under known lights.

use crate::bake;
use crate::failure::{Exit, Failure};
use crate::options::{MachineOptions, check_apart, check_writable};
use crate::photograph_options::PhotographOptions;
use crate::say::{self, say};
use crate::{interrupt, notes, progress};
use clap::{Args, ValueEnum};
use relight_core::Space;
use relight_core::relighter::Picture;
use relight_fit::{
    NormalError, NormalMap, NormalMethod, height_bytes, heights_from_normals, normal_error, normal_map,
    normal_map_bytes,
};
use relight_formats::{
    NormalPicture, OpenCapture, PictureDepth, open_capture, picture_depths, read_normal_file,
    write_normal_file, write_picture,
};
use serde_json::json;
use std::path::{Path, PathBuf};

/// What to find and where to write it.
#[derive(Args, Debug)]
pub(crate) struct NormalsArguments {
    /// A .lp file, or a folder that holds one
    set: PathBuf,
    /// The normal map to write: .png (16 bits, (n + 1) / 2) or .exr (floats); x right, y up, z out of the picture
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Also write the colour under light along the normal: .png encoded, .exr linear
    #[arg(long, value_name = "FILE")]
    albedo: Option<PathBuf>,
    /// Also write the height that the normals add up to: .png (16 bits from lowest to highest) or .exr
    /// (pixels of height, mean 0)
    #[arg(long, value_name = "FILE")]
    height: Option<PathBuf>,
    #[command(flatten)]
    photographs: PhotographOptions,
    /// robust leaves shadows and highlights out, pixel by pixel; least-squares takes all lights
    #[arg(long, value_name = "METHOD", value_enum, default_value = "robust")]
    method: Method,
    /// Values of integer pictures: linear decodes them, encoded takes them as stored
    #[arg(long, value_name = "SPACE", value_enum, default_value = "linear")]
    space: SpaceChoice,
    /// Bits of .png files of normals and albedo
    #[arg(long, value_name = "BITS", value_enum, default_value = "16")]
    depth: Bits,
    /// Write y down, as Direct3D's normal maps have it; --truth is then read so, too
    #[arg(long)]
    flip_y: bool,
    /// Compare with the normals in this picture and say how far they are off
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Print figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    Robust,
    LeastSquares,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpaceChoice {
    Linear,
    Encoded,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Bits {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

/// Height in pixels.
struct Heights {
    values: Vec<f32>,
    least: f32,
    largest: f32,
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &NormalsArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let outputs = || std::iter::once(&arguments.output).chain(&arguments.albedo).chain(&arguments.height);
    for path in outputs() {
        arguments.depth_for(path)?;
        check_writable(path)?;
    }
    let mut capture = open_capture(&arguments.set)?;
    let whole = capture.size();
    let spill_folder = bake::spill_folder(&arguments.output);
    arguments.photographs.apply(&mut capture, &machine, &spill_folder)?;
    notes::print(&capture.capture.notes);
    let inputs = capture
        .capture
        .pictures
        .iter()
        .chain([&capture.capture.light_file])
        .chain(&arguments.truth)
        .chain(arguments.photographs.files());
    check_apart(outputs(), inputs)?;
    let (width, height) = capture.size();
    let truth = match &arguments.truth {
        Some(path) => Some(arguments.read_truth(path, whole, machine.memory)?),
        None => None,
    };
    let pixels = (width * height) as u64;
    let truth_bytes = if truth.is_some() { 12 * pixels } else { 0 };
    let kept_back =
        normal_map_bytes(pixels, capture.infos.len() as u64, machine.threads as u64) + truth_bytes;
    let afterwards = kept_back + if arguments.height.is_some() { height_bytes(pixels) } else { 0 };
    if afterwards > machine.memory {
        let message = format!(
            "{width} x {height} pixels need {} MiB of memory where {} MiB are allowed; raise --memory, or leave --height out",
            afterwards >> 20,
            machine.memory >> 20
        );
        return Err(Failure::new(Exit::OverBudget, message));
    }

    let space = arguments.space(&capture);
    let stack = bake::load(&capture, space, &machine, kept_back, &spill_folder)?;
    let bar = progress::bar("normals", (width * height).div_ceil(relight_fit::SPAN));
    let mut map = normal_map::<Failure>(
        &stack,
        &capture.capture.lights.directions(),
        arguments.method(),
        &capture.full_scale(space),
        || {
            bar.inc(1);
            Ok(interrupt::check()?)
        },
    )?;
    bar.finish_and_clear();
    drop(stack);
    let error = truth.as_ref().and_then(|truth| normal_error(&map.normals, truth));
    drop(truth);
    let heights = match &arguments.height {
        Some(_) => Some(heights_of(&map)?),
        None => None,
    };
    let clipped = arguments.write_albedo(&mut map)?;
    if let (Some(path), Some(heights)) = (&arguments.height, &heights) {
        write_heights(path, &map, heights, arguments.depth_for(path)?)?;
    }
    if arguments.flip_y {
        map.normals.iter_mut().for_each(|normal| normal[1] = -normal[1]);
    }
    let normals = NormalPicture { width, height, normals: std::mem::take(&mut map.normals) };
    write_normal_file(&arguments.output, normals, arguments.depth_for(&arguments.output)?)?;
    arguments.report(&map, clipped, heights.as_ref(), error)
}

fn heights_of(map: &NormalMap) -> Result<Heights, Failure> {
    let values = heights_from_normals(map, || Ok::<(), Failure>(interrupt::check()?))?;
    let least = values.iter().copied().fold(f32::INFINITY, f32::min);
    let largest = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    Ok(Heights { values, least, largest })
}

fn write_heights(
    path: &Path,
    map: &NormalMap,
    heights: &Heights,
    depth: PictureDepth,
) -> Result<(), Failure> {
    let Heights { values, least, largest } = heights;
    let depth = if depth.is_linear() { depth } else { PictureDepth::U16 };
    let samples = match depth.is_linear() {
        true => values.clone(),
        // A flat surface lies at 0.
        false => {
            values.iter().map(|value| (value - least) / (largest - least).max(f32::MIN_POSITIVE)).collect()
        }
    };
    let picture = Picture { width: map.width, height: map.height, channels: 1, samples };
    Ok(write_picture(path, &picture, depth)?)
}

impl NormalsArguments {
    /// The depth of the file at `path`.
    fn depth_for(&self, path: &Path) -> Result<PictureDepth, Failure> {
        let is_linear = picture_depths(path).map_err(Failure::of_output)?[0].is_linear();
        Ok(match (is_linear, self.depth) {
            (true, _) => PictureDepth::F32,
            (false, Bits::Eight) => PictureDepth::U8,
            (false, Bits::Sixteen) => PictureDepth::U16,
        })
    }

    fn method(&self) -> NormalMethod {
        match self.method {
            Method::Robust => NormalMethod::Robust,
            Method::LeastSquares => NormalMethod::LeastSquares,
        }
    }

    fn space(&self, capture: &OpenCapture) -> Space {
        match self.space {
            // Float pictures are linear as they are stored.
            SpaceChoice::Encoded if !capture.is_float() => Space::Encoded,
            _ => Space::Linear,
        }
    }

    fn read_truth(&self, path: &Path, size: (usize, usize), memory: u64) -> Result<Vec<[f32; 3]>, Failure> {
        let NormalPicture { width, height, mut normals } =
            read_normal_file(path, relight_core::CpuLevel::detect(), memory)?;
        if (width, height) != size {
            let message = format!(
                "{} is {width} x {height} pixels where the pictures are {} x {}; give the normals of the same pixels",
                path.display(),
                size.0,
                size.1
            );
            return Err(Failure::new(Exit::BadInput, message));
        }
        if self.flip_y {
            normals.iter_mut().for_each(|normal| normal[1] = -normal[1]);
        }
        Ok(match self.photographs.crop() {
            Some(crop) => crop.part_of(&normals, width, 1),
            None => normals,
        })
    }

    /// Writes the albedo, when one is wanted, and drops it; the pixels brighter than the file holds.
    fn write_albedo(&self, map: &mut NormalMap) -> Result<usize, Failure> {
        let (channels, samples) = (map.channels, std::mem::take(&mut map.albedo));
        let Some(path) = &self.albedo else { return Ok(0) };
        let depth = self.depth_for(path)?;
        let picture = Picture { width: map.width, height: map.height, channels, samples };
        if depth.is_linear() {
            write_picture(path, &picture, depth)?;
            return Ok(0);
        }
        let clipped =
            picture.samples.chunks_exact(channels).filter(|pixel| pixel.iter().any(|&v| v > 1.0)).count();
        write_picture(path, &picture.encoded_from(Space::Linear), depth)?;
        Ok(clipped)
    }

    fn report(
        &self,
        map: &NormalMap,
        clipped: usize,
        heights: Option<&Heights>,
        error: Option<NormalError>,
    ) -> Result<(), Failure> {
        let pixels = map.found.len();
        let without = map.found.iter().filter(|&&found| !found).count();
        let method =
            self.method.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned());
        if self.json {
            let truth = error.map(|error| {
                json!({ "mean_deg": error.mean.to_degrees(), "median_deg": error.median.to_degrees(), "pixels": error.pixels })
            });
            let height = heights.map(|heights| json!({ "least": heights.least, "largest": heights.largest }));
            let figures = json!({
                "width": map.width,
                "height": map.height,
                "method": method,
                "pixels": pixels,
                "without_normal": without,
                "albedo_above_1": clipped,
                "heights": height,
                "truth": truth,
            });
            say::json(&figures);
            return Ok(());
        }
        let output = self.output.display();
        say!(
            "{output}: {} x {}, {method}, {} normals, {without} pixels without one (0, 0, 1)",
            map.width,
            map.height,
            pixels - without
        );
        if let Some(path) = &self.albedo {
            say!("{}: {clipped} pixels of albedo above 1 are cut", path.display());
        }
        if let (Some(path), Some(heights)) = (&self.height, heights) {
            say!("{}: from {:.3} to {:.3} pixels of height", path.display(), heights.least, heights.largest);
        }
        if let (Some(path), Some(error)) = (&self.truth, error) {
            say!(
                "{}: mean angle {:.3} deg, median {:.3} deg over {} pixels",
                path.display(),
                error.mean.to_degrees(),
                error.median.to_degrees(),
                error.pixels
            );
        }
        Ok(())
    }
}
