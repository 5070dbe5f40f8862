//! `relight render`: golden pictures of an asset under new lights.

use crate::failure::Failure;
use crate::light_options::{light_of_angles, light_of_vector};
use crate::options::{Machine, MachineOptions, check_apart};
use crate::{interrupt, notes, progress};
use clap::{Args, ValueEnum};
use relight_core::relighter::{DirectionalLight, Picture, relight, relight_linear};
use relight_core::{RelightingMaps, Space};
use relight_formats::{PictureDepth, picture_depths, read_asset, read_light_file, write_picture};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// What to render.
#[derive(Args, Debug)]
#[group(id = "render")]
pub(crate) struct RenderArguments {
    /// The asset: .ktx2, .exr or .ptm
    asset: PathBuf,
    /// The picture to write (.png or .exr), or with --lights the folder
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// A directional light: the vector towards it (x right, y up, z to the camera), then if
    /// wanted its linear colour; several lights add up
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", allow_hyphen_values = true, value_parser = light_of_vector)]
    light: Vec<DirectionalLight>,
    /// The same by angles in degrees: azimuth counter-clockwise from the right, elevation above
    /// the picture plane
    #[arg(long, value_name = "AZ,EL[,R,G,B]", allow_hyphen_values = true, value_parser = light_of_angles)]
    angles: Vec<DirectionalLight>,
    /// Write a picture for each line of this .lp file
    #[arg(long, value_name = "FILE.lp", conflicts_with_all = ["light", "angles"])]
    lights: Option<PathBuf>,
    /// Bits of a sample: 8 (default) or 16 in .png, half (default) or float in .exr
    #[arg(long, value_name = "DEPTH", value_enum)]
    depth: Option<Depth>,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Depth {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
    Half,
    Float,
}

impl Depth {
    fn of_picture(self) -> PictureDepth {
        match self {
            Self::Eight => PictureDepth::U8,
            Self::Sixteen => PictureDepth::U16,
            Self::Half => PictureDepth::F16,
            Self::Float => PictureDepth::F32,
        }
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &RenderArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let lights: Vec<_> = arguments.light.iter().chain(&arguments.angles).copied().collect();
    let jobs = match &arguments.lights {
        Some(file) => jobs_of_file(file, &arguments.output, arguments.depth)?,
        None if lights.is_empty() => {
            return Err(Failure::usage("no light; give --light X,Y,Z, --angles AZ,EL or --lights FILE.lp"));
        }
        None => vec![(arguments.output.clone(), lights)],
    };
    let depth = depth_for(&jobs[0].0, arguments.depth)?;
    check_apart(jobs.iter().map(|(path, _)| path), arguments.lights.iter().chain([&arguments.asset]))?;
    let maps = read_asset(&arguments.asset, machine.memory)?;
    if arguments.lights.is_some() {
        relight_formats::create_folder(&arguments.output)?;
    }
    let bar = progress::bar("rendering", jobs.len());
    for (path, lights) in &jobs {
        interrupt::check()?;
        write_picture(path, &picture(&maps, lights, depth, &machine), depth)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

/// The depth that was asked for, checked against the file's extension.
fn depth_for(path: &Path, asked: Option<Depth>) -> Result<PictureDepth, Failure> {
    let held = picture_depths(path).map_err(Failure::of_output)?;
    match asked.map(Depth::of_picture) {
        None => Ok(held[0]),
        Some(depth) if held.contains(&depth) => Ok(depth),
        Some(_) => Err(Failure::usage(format!(
            "{} can't hold that --depth; .png has 8 and 16, .exr has half and float",
            path.display()
        ))),
    }
}

/// A picture's path and its lights.
type Job = (PathBuf, Vec<DirectionalLight>);

/// One picture for each line of a light file, named as the line names it.
fn jobs_of_file(file: &Path, folder: &Path, depth: Option<Depth>) -> Result<Vec<Job>, Failure> {
    let file = read_light_file(file)?;
    notes::print(&file.notes);
    let extension = match depth {
        Some(Depth::Half | Depth::Float) => "exr",
        _ => "png",
    };
    let mut taken = HashSet::new();
    let jobs = file.entries.iter().map(|entry| {
        let base = entry.name.rsplit(['/', '\\']).next().unwrap_or("light");
        let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
        let stem = if stem.trim_matches('.').is_empty() { "light" } else { stem };
        let mut name = format!("{stem}.{extension}");
        let mut again = 0;
        while !taken.insert(name.to_lowercase()) {
            again += 1;
            let suffix = if again == 1 { String::new() } else { format!("_{again}") };
            name = format!("{stem}_line{}{suffix}.{extension}", entry.line);
        }
        (folder.join(name), vec![DirectionalLight { direction: entry.direction, color: [1.0; 3] }])
    });
    Ok(jobs.collect())
}

/// The picture in the space that files of `depth` hold.
fn picture(
    maps: &RelightingMaps,
    lights: &[DirectionalLight],
    depth: PictureDepth,
    machine: &Machine,
) -> Picture {
    match lights {
        // One white light on encoded values needs no way to linear light and back.
        [light] if light.color == [1.0; 3] && !depth.is_linear() => {
            relight(maps, light.direction, machine.level).encoded_from(maps.model.space)
        }
        _ => {
            let linear = relight_linear(maps, lights, machine.level);
            if depth.is_linear() { linear } else { linear.encoded_from(Space::Linear) }
        }
    }
}
