//! `relight positions`: a depth map and its camera in, a position map out. `bake` takes the same options.

use crate::failure::Failure;
use crate::options::{MachineOptions, check_apart, check_writable, optional, words_of};
use crate::say::say;
use crate::{interrupt, notes};
use clap::{ArgGroup, Args, ValueEnum};
use relight_core::{DepthError, DepthKind, PositionMap};
use relight_formats::{FormatError, read_camera_file, read_depth_file, write_position_file};
use std::path::PathBuf;

/// What to compute positions from.
#[derive(Args, Debug)]
#[command(group = ArgGroup::new("source").args(["depth"]).required(true))]
pub(crate) struct PositionsArguments {
    #[command(flatten)]
    source: DepthOptions,
    /// The position map to write: .exr with float channels X, Y, Z
    #[arg(short, long, value_name = "P.exr")]
    output: PathBuf,
    #[command(flatten)]
    machine: MachineOptions,
}

/// A depth map and the camera that saw it.
#[derive(Args, Debug)]
#[group(id = "depth_options")]
pub(crate) struct DepthOptions {
    /// Depth of every pixel: a channel of an .exr, or a grey .png or .tif. 0, negative and NaN are no
    /// surface, infinity is the sky
    #[arg(long, value_name = "FILE", requires = "camera")]
    depth: Option<PathBuf>,
    /// The camera that saw it: .json or .toml
    #[arg(long, value_name = "FILE", requires = "depth")]
    camera: Option<PathBuf>,
    /// What a depth is the length of: the way along the pixel's ray, or its part along the view (z)
    /// [default: ray]
    #[arg(long, value_name = "KIND", value_enum, requires = "depth")]
    depth_kind: Option<KindChoice>,
    /// Channel of the .exr, where it has several
    #[arg(long, visible_alias = "channel", value_name = "NAME", requires = "depth")]
    depth_channel: Option<String>,
    /// Units of the camera's world in one of the depth file's, such as 0.001 for millimetres of 16
    /// bits and a world in metres [default: 1]
    #[arg(long, value_name = "FACTOR", value_parser = scale_of, requires = "depth", allow_negative_numbers = true)]
    depth_scale: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum KindChoice {
    Ray,
    Z,
}

fn scale_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if (1e-12..=1e12).contains(&scale) => Ok(scale),
        _ => Err("write a factor from 1e-12 to 1e12".to_owned()),
    }
}

/// Bytes of a pixel while positions come of depths and go to a file, in those of a depth: the depth, a
/// point, and a sample in each of three channels.
const DEPTHS_AT_ONCE: u64 = 7;

impl DepthOptions {
    /// All that these options say but for files, by name.
    pub(crate) fn named(&self) -> Vec<(&'static str, String)> {
        vec![
            ("depth_kind", words_of(self.depth_kind.unwrap_or(KindChoice::Ray))),
            ("depth_channel", optional(self.depth_channel.as_ref())),
            ("depth_scale", self.depth_scale.unwrap_or(1.0).to_string()),
        ]
    }

    /// The files that are read.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.depth.iter().chain(&self.camera)
    }

    /// Positions by depth and camera, in at most `memory` bytes; `None` where no depth is given.
    pub(crate) fn read(&self, memory: u64) -> Result<Option<PositionMap>, Failure> {
        let (Some(path), Some(camera)) = (&self.depth, &self.camera) else { return Ok(None) };
        let camera = read_camera_file(camera)?;
        let (channel, scale) = (self.depth_channel.as_deref(), self.depth_scale.unwrap_or(1.0));
        let depth = read_depth_file(path, channel, scale, memory / DEPTHS_AT_ONCE)?;
        interrupt::check()?;
        let kind = match self.depth_kind.unwrap_or(KindChoice::Ray) {
            KindChoice::Ray => DepthKind::Ray,
            KindChoice::Z => DepthKind::Z,
        };
        match PositionMap::from_depth(&camera, &depth, kind) {
            Ok(map) => Ok(Some(map)),
            Err(error @ DepthError::ZOfPanorama) => Err(Failure::usage(error.to_string())),
            Err(error) => Err(FormatError::invalid(path, error.to_string()).into()),
        }
    }
}

/// How many points `map` has of each kind and what box holds them, in words.
pub(crate) fn words(map: &PositionMap) -> String {
    let [surface, sky, missing] = map.counts();
    let within = map.bounds().map_or(String::new(), |(least, largest)| {
        let point = |p: [f32; 3]| p.map(|c| c.to_string()).join(" ");
        format!(" from {} to {}", point(least), point(largest))
    });
    format!("{surface} points{within}, {sky} of the sky, {missing} without surface")
}

/// What should be said of a map that can't be meant.
pub(crate) fn note(map: &PositionMap) -> Option<String> {
    let [surface, ..] = map.counts();
    (surface == 0).then(|| "no pixel has a surface: check depths, their channel and their scale".to_owned())
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &PositionsArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let output = &arguments.output;
    if !output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
        let message = format!("{}: positions are written as .exr; give that extension", output.display());
        return Err(Failure::usage(message));
    }
    check_writable(output)?;
    check_apart([output], arguments.source.files())?;
    let map =
        arguments.source.read(machine.memory)?.ok_or_else(|| Failure::usage("give --depth and --camera"))?;
    interrupt::check()?;
    write_position_file(output, &map)?;
    notes::print(note(&map).as_slice());
    say!("{}: {} x {}, {}", output.display(), map.width, map.height, words(&map));
    Ok(())
}
