//! `relight render`: golden pictures of an asset under new lights.

mod explain;
mod jobs;
mod sheet;

use crate::depfile::BuildOptions;
use crate::failure::{Exit, Failure};
use crate::light_options::{light_of_angles, light_of_vector};
use crate::options::{Machine, MachineOptions, check_apart, check_writable};
use crate::say::{is_dash, write_product};
use crate::{interrupt, progress};
use clap::{Args, ValueEnum};
use jobs::Job;
pub(crate) use jobs::frame_paths;
use relight_core::relighter::{DirectionalLight, Picture, relight};
use relight_core::{PositionMap, RelightingMaps, Space};
use relight_formats::{
    PictureDepth, picture_bytes, picture_depths, read_asset, read_position_file, read_positions, read_scene,
    summarize_asset, write_picture,
};
use relight_lights::{Accuracy, Lamp, Plan, Report, Scene, Settings, relight_scene};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Pixels beyond the edge of a surface that take their neighbours' positions before they are lit: those
/// that see it in part. A second pixel is for pictures that were made smaller.
const EDGE: usize = 2;

/// What to render.
#[derive(Args, Debug)]
#[group(id = "render")]
pub(crate) struct RenderArguments {
    /// The asset: .ktx2, .dds, .exr, .ptm, .rti or a .web folder
    asset: PathBuf,
    /// The picture to write (.png or .exr, or - for standard output), or with --lights and for a sequence the folder
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
    /// Light it by a scene: directional, point, spot and sphere lights, environments, keyed sequences
    #[arg(long, value_name = "SCENE.toml", conflicts_with_all = ["light", "angles", "lights"])]
    scene: Option<PathBuf>,
    /// Positions for local lights, instead of those that the asset holds: .exr with channels X, Y, Z
    #[arg(long, value_name = "P.exr", requires = "scene")]
    positions: Option<PathBuf>,
    /// How exactly functions of light are evaluated pixel by pixel: exact, 1e-4 or 1e-3; the cheapest way
    /// that is good enough is taken
    #[arg(long, value_name = "ERROR", default_value = "exact", value_parser = accuracy_of)]
    accuracy: Accuracy,
    /// Say which passes, maps and lights run and why, which don't, and what that saved
    #[arg(long)]
    explain: bool,
    /// With --explain: as JSON
    #[arg(long, requires = "explain")]
    json: bool,
    /// Write all pictures of --lights or of a sequence small on one sheet, too
    #[arg(long, value_name = "FILE.png")]
    sheet: Option<PathBuf>,
    /// Bits of a sample: 8 (default) or 16 in .png, half (default) or float in .exr
    #[arg(long, value_name = "DEPTH", value_enum)]
    depth: Option<Depth>,
    #[command(flatten)]
    build: BuildOptions,
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

fn accuracy_of(text: &str) -> Result<Accuracy, String> {
    Accuracy::ALL.into_iter().find(|accuracy| accuracy.name() == text).ok_or_else(|| {
        let names: Vec<_> = Accuracy::ALL.map(Accuracy::name).to_vec();
        format!("write {}", names.join(", "))
    })
}

/// An asset and what is known of reading it.
struct Loaded {
    maps: RelightingMaps,
    /// Seconds that reading took.
    seconds: f64,
    /// Read once a picture needs them.
    positions: Option<PositionMap>,
    /// Samples of the picture before, whose memory the next one takes.
    recycled: Vec<f32>,
}

/// A picture that was drawn, in the space of its file.
struct Drawn {
    picture: Picture,
    plan: Plan,
    report: Report,
    seconds: f64,
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &RenderArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let jobs = jobs::jobs(arguments, &machine)?;
    let depth = depth_for(&jobs.list[0].path, arguments.depth)?;
    if jobs.folder.as_deref().is_some_and(is_dash) {
        return Err(Failure::usage(
            "--output - : standard output holds one picture; name a folder for several",
        ));
    }
    if let Some(sheet) = &arguments.sheet {
        if jobs.folder.is_none() {
            return Err(Failure::usage(
                "--sheet belongs to --lights and to sequences; a single picture needs none",
            ));
        }
        if picture_depths(sheet).map_err(Failure::of_output)?[0] != PictureDepth::U8 {
            return Err(Failure::usage(format!("{}: a sheet is a .png", sheet.display())));
        }
    }
    // A part that is missing may not be needed; what is wrong with the asset is found out when it is read.
    let asset_files =
        summarize_asset(&arguments.asset).map_or(vec![arguments.asset.clone()], |asset| asset.files);
    let inputs = || asset_files.iter().chain(&jobs.inputs).chain(&arguments.positions);
    let outputs = || jobs.list.iter().map(|job| &job.path).chain(&arguments.sheet);
    check_apart(outputs(), inputs().chain([&arguments.asset]))?;
    let depfile = arguments.build.depfile(&arguments.output, inputs())?;
    if arguments.build.is_dry_run() {
        arguments.build.say_files(inputs(), outputs());
        return Ok(());
    }
    let start = Instant::now();
    let maps = read_asset(&arguments.asset, machine.memory)?;
    let mut loaded =
        Loaded { maps, seconds: start.elapsed().as_secs_f64(), positions: None, recycled: Vec::new() };
    if let Some(folder) = &jobs.folder {
        relight_formats::create_folder(folder)?;
    }
    if let Some(sheet) = &arguments.sheet {
        check_writable(sheet)?;
    }
    let mut thumbnails = Vec::new();
    let mut explained = Vec::new();
    let bar = progress::bar("rendering", jobs.list.len());
    for job in &jobs.list {
        interrupt::check()?;
        let drawn = draw(arguments, job, &mut loaded, depth, &machine)?;
        write_product(&job.path, &picture_bytes(&job.path, &drawn.picture, depth)?)?;
        if arguments.sheet.is_some() {
            thumbnails.push(sheet::thumbnail(&drawn.picture, depth.is_linear()));
        }
        if arguments.explain {
            explained.push(explain::Explanation::of(job, &drawn, &loaded));
        }
        loaded.recycled = drawn.picture.samples;
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(path) = &arguments.sheet {
        write_picture(path, &sheet::sheet(&thumbnails), PictureDepth::U8)?;
    }
    explain::print(&explained, arguments.json);
    depfile.map_or(Ok(()), |depfile| depfile.write())
}

/// The depth that was asked for, checked against the file's extension.
fn depth_for(path: &Path, asked: Option<Depth>) -> Result<PictureDepth, Failure> {
    if is_dash(path) {
        return Ok(asked.map_or(PictureDepth::U8, Depth::of_picture));
    }
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

/// The smallest step of linear light near black that pictures of `depth` show; floats show any.
fn smallest_step(depth: PictureDepth) -> f64 {
    /// Slope of the sRGB curve at black.
    const SLOPE: f64 = 12.92;
    match depth {
        PictureDepth::U8 => 1.0 / (255.0 * SLOPE),
        PictureDepth::U16 => 1.0 / (65535.0 * SLOPE),
        PictureDepth::F16 | PictureDepth::F32 => 0.0,
    }
}

/// Draws a job's scene in the space that files of `depth` hold, reading positions if it is the first that
/// needs them.
fn draw(
    arguments: &RenderArguments,
    job: &Job,
    loaded: &mut Loaded,
    depth: PictureDepth,
    machine: &Machine,
) -> Result<Drawn, Failure> {
    let plan = Plan::new(&job.scene, &loaded.maps.model, arguments.accuracy);
    if plan.reads_positions() && loaded.positions.is_none() {
        let name = first_local(&job.scene, &plan);
        let map = positions(&arguments.asset, arguments.positions.as_deref(), name, &loaded.maps, machine)?;
        loaded.positions = Some(map);
    }
    let start = Instant::now();
    // One white light on encoded values needs no way to linear light and back.
    if let ([light], [pass], false) = (&job.scene.lights[..], &plan.uniform[..], depth.is_linear())
        && let Lamp::Directional { direction } = light.lamp
        && (pass.color == [1.0; 3] && loaded.maps.model.space == Space::Encoded)
        && plan.horizon.take(direction).direction == direction
    {
        let picture = relight(&loaded.maps, direction, machine.level);
        let seconds = start.elapsed().as_secs_f64();
        let report = Report { uniform_seconds: seconds, ..Report::default() };
        return Ok(Drawn { picture, plan, report, seconds });
    }
    let recycled = std::mem::take(&mut loaded.recycled);
    let settings = Settings { level: machine.level, step: smallest_step(depth), timed: arguments.explain };
    let (picture, report) =
        relight_scene(&loaded.maps, loaded.positions.as_ref(), &job.scene, &plan, &settings, recycled);
    let seconds = start.elapsed().as_secs_f64();
    let picture = if depth.is_linear() { picture } else { picture.encoded_from(Space::Linear) };
    Ok(Drawn { picture, plan, report, seconds })
}

/// The asset under the scene of a file, at its first time, in linear light and not clipped.
pub(crate) fn relit_by_scene(
    asset: &Path,
    maps: &RelightingMaps,
    scene: &Path,
    machine: &Machine,
) -> Result<Picture, Failure> {
    let file = read_scene(scene, machine.level, machine.memory)?;
    let scene = file.scene(scene, file.times.first().copied().unwrap_or(0.0))?;
    let plan = Plan::new(&scene, &maps.model, Accuracy::Exact);
    let map = match plan.reads_positions() {
        true => Some(positions(asset, None, first_local(&scene, &plan), maps, machine)?),
        false => None,
    };
    let settings = Settings { level: machine.level, step: 0.0, timed: false };
    Ok(relight_scene(maps, map.as_ref(), &scene, &plan, &settings, Vec::new()).0)
}

/// The name of the first light that needs positions.
fn first_local<'a>(scene: &'a Scene, plan: &Plan) -> &'a str {
    plan.local.iter().flatten().next().map_or("", |&light| &scene.lights[light].name)
}

/// The positions that local lights need, the first of them `light`: those of a file, or the asset's own.
fn positions(
    asset: &Path,
    given: Option<&Path>,
    light: &str,
    maps: &RelightingMaps,
    machine: &Machine,
) -> Result<PositionMap, Failure> {
    let (path, map) = match given {
        Some(path) => (path, Some(read_position_file(path, machine.memory)?)),
        None => (asset, read_positions(asset, machine.memory)?),
    };
    let Some(mut map) = map else {
        let message = format!(
            "{}: holds no positions, which '{light}' needs; bake it with --positions or --depth, or give --positions P.exr",
            path.display()
        );
        return Err(Failure::new(Exit::BadInput, message));
    };
    if (map.width, map.height) != (maps.width, maps.height) {
        let message = format!(
            "{}: has {} x {} positions where the asset has {} x {} pixels; give positions of the same view",
            path.display(),
            map.width,
            map.height,
            maps.width,
            maps.height
        );
        return Err(Failure::new(Exit::BadInput, message));
    }
    map.fill_edges(EDGE);
    Ok(map)
}
