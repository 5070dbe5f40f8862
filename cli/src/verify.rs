//! `relight verify`: an asset drawn by the GPU, or a rig evaluated by it, beside the CPU's reference.

mod report;
mod rig;

use crate::failure::{Exit, Failure};
use crate::options::{Machine, MachineOptions};
use crate::{interrupt, notes, progress};
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use relight_core::relighter::relight;
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Direction, RelightingMaps};
use relight_formats::{is_rig, read_asset, read_light_file, read_packed};
use relight_gpu::{Backend, DecodingBound, Difference, Gpu, GpuMaps, TextureMode, decoding_differences};
use relight_texture::PackedMaps;
use report::{LightFigures, ModeFigures, Verification};
use std::path::{Path, PathBuf};

/// What to verify.
#[derive(Args, Debug)]
#[group(id = "verify")]
pub(crate) struct VerifyArguments {
    /// The asset: .ktx2 or .dds, or the .json beside textures; .exr, .ptm and .rti too. Or a .rig
    asset: PathBuf,
    /// Draw under the lights of this file; by default under those that were fitted, or where the
    /// asset does not name them, lights spread over the hemisphere
    #[arg(long, value_name = "FILE.lp")]
    lights: Option<PathBuf>,
    /// How many lights to take where no file names them; of a rig, sets of random coefficients
    #[arg(long, value_name = "N", default_value_t = 20, conflicts_with = "lights",
        value_parser = clap::value_parser!(u16).range(1..=4096))]
    count: u16,
    /// Largest difference allowed, of full range: 1, or the reference's largest value where that is
    /// more. By default 1e-5, and where the GPU decodes blocks what their formats allow
    #[arg(long, value_name = "X", value_parser = tolerance_of)]
    tolerance: Option<f64>,
    /// Compare with the CPU's pictures of another asset of the same size, such as a float bake of
    /// the same capture
    #[arg(long, value_name = "ASSET", requires = "tolerance")]
    against: Option<PathBuf>,
    /// Who decodes the texels: the GPU (native), relight (decoded), or one after the
    /// other (both), the default
    #[arg(long, value_name = "MODE", value_enum)]
    mode: Option<Mode>,
    /// How to reach the GPU: any, vulkan or gl
    #[arg(long, value_name = "BACKEND", default_value = "any", value_parser = backend_of)]
    backend: Backend,
    /// Call it a failure rather than a skipped check when there is no GPU; RELIGHT_REQUIRE_GPU=1
    /// does the same. The exit code is 6 either way
    #[arg(long)]
    require_gpu: bool,
    /// Sum so many maps a pass, as engines that bind few textures at once do
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    maps_per_pass: Option<u16>,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Mode {
    Native,
    Decoded,
    Both,
}

impl Mode {
    fn texture_modes(self) -> &'static [TextureMode] {
        match self {
            Self::Native => &[TextureMode::Native],
            Self::Decoded => &[TextureMode::Decoded],
            Self::Both => &[TextureMode::Native, TextureMode::Decoded],
        }
    }
}

/// Rounding of sums of floats, of full range.
const ROUNDING: f64 = 1e-5;

/// Lights where neither a file nor the asset names any: down to 10 degrees above the picture.
const CAP: Cap = Cap { axis: Direction::OUT, radius: 80.0 * std::f64::consts::PI / 180.0 };

fn tolerance_of(text: &str) -> Result<f64, String> {
    let tolerance = text.parse().ok().filter(|tolerance| (0.0..=1e6).contains(tolerance));
    tolerance.ok_or_else(|| format!("'{text}' is not a number within 0..1e6"))
}

/// The backend of that name.
pub(crate) fn backend_of(text: &str) -> Result<Backend, String> {
    let backends = [Backend::Any, Backend::Vulkan, Backend::Gl];
    backends.into_iter().find(|backend| backend.name() == text).ok_or_else(|| {
        let names = backends.map(Backend::name).join(", ");
        format!("'{text}' is not one of {names}")
    })
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &VerifyArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    if is_rig(&arguments.asset) {
        return rig::run(arguments, &machine);
    }
    let mode = arguments.mode.unwrap_or(Mode::Both);
    let packed = read_packed(&arguments.asset, machine.memory)?;
    let left = machine.memory.saturating_sub(packed_bytes(&packed));
    let judge = arguments.against.as_ref().unwrap_or(&arguments.asset);
    let reference = read_asset(judge, left)?;
    check_comparable(&arguments.asset, &packed, judge, &reference)?;
    if mode != Mode::Native {
        check_floats_fit(&packed, left.saturating_sub(reference.texel_bytes()))?;
    }
    let lights = lights(arguments, &packed)?;
    let gpu = open(arguments)?;
    let verification = verify(arguments, &gpu, &packed, &reference, &lights, &machine)?;
    if arguments.json {
        crate::say::json(&verification.to_json());
    } else {
        verification.print();
    }
    verification.verdict()
}

/// The GPU that was asked for.
fn open(arguments: &VerifyArguments) -> Result<Gpu, Failure> {
    Gpu::open(arguments.backend).map_err(|error| {
        let required = arguments.require_gpu || std::env::var("RELIGHT_REQUIRE_GPU").is_ok_and(|v| v == "1");
        let skipped = if required { "" } else { "verification skipped: " };
        Failure::new(Exit::Unsupported, format!("{skipped}{error}"))
    })
}

fn packed_bytes(packed: &PackedMaps) -> u64 {
    packed.texels.iter().flatten().map(|level| level.len() as u64).sum()
}

/// Fails where pictures of the two can't be compared.
fn check_comparable(
    asset: &Path,
    packed: &PackedMaps,
    judge: &Path,
    reference: &RelightingMaps,
) -> Result<(), Failure> {
    let refused = |what: &str| {
        let message = format!(
            "{} and {} differ in {what}; compare bakes of one capture",
            asset.display(),
            judge.display()
        );
        Err(Failure::new(Exit::BadInput, message))
    };
    if (packed.width, packed.height) != (reference.width, reference.height) {
        return refused("size");
    }
    if packed.model.channels() != reference.model.channels() {
        return refused("channels, one being grey");
    }
    if packed.model.space != reference.model.space {
        return refused("values, one holding linear and the other encoded ones");
    }
    Ok(())
}

/// Fails where the texels as floats exceed the memory that is left.
fn check_floats_fit(packed: &PackedMaps, left: u64) -> Result<(), Failure> {
    let texels: u64 = packed.packing.arrays.iter().zip(&packed.texels).fold(0, |sum, (array, levels)| {
        let bytes: u64 = levels.iter().map(|level| level.len() as u64).sum();
        sum + (bytes as f64 * 8.0 / array.format.bits()) as u64
    });
    let needed = texels * 16;
    if needed <= left {
        return Ok(());
    }
    let message = format!(
        "the texels as floats take {} MiB, {} MiB are left; raise --memory or take --mode native",
        needed >> 20,
        left >> 20
    );
    Err(Failure::new(Exit::OverBudget, message))
}

/// The lights to draw under.
fn lights(arguments: &VerifyArguments, packed: &PackedMaps) -> Result<Vec<Direction>, Failure> {
    if let Some(file) = &arguments.lights {
        let file = read_light_file(file)?;
        notes::print(&file.notes);
        return Ok(file.entries.iter().map(|entry| entry.direction).collect());
    }
    let (fitted, count) = (&packed.model.lights, usize::from(arguments.count));
    Ok(if fitted.is_empty() { fibonacci_in(CAP, count) } else { evenly(fitted, count) })
}

/// So many of `lights`, evenly chosen in their order; all where there are no more.
pub(crate) fn evenly(lights: &[Direction], count: usize) -> Vec<Direction> {
    let count = count.min(lights.len());
    (0..count).map(|i| lights[i * lights.len() / count]).collect()
}

/// How far pictures of `maps` on the GPU are from those of `reference` under each of `lights`.
pub(crate) fn differences(
    maps: &mut GpuMaps,
    reference: &RelightingMaps,
    lights: &[Direction],
    machine: &Machine,
    bar: &ProgressBar,
) -> Result<Vec<Difference>, Failure> {
    let difference = |&light: &Direction| {
        interrupt::check()?;
        let difference =
            Difference::between(&maps.draw(light, 0)?, &relight(reference, light, machine.level));
        bar.inc(1);
        Ok(difference)
    };
    lights.iter().map(difference).collect()
}

fn verify(
    arguments: &VerifyArguments,
    gpu: &Gpu,
    packed: &PackedMaps,
    reference: &RelightingMaps,
    lights: &[Direction],
    machine: &Machine,
) -> Result<Verification, Failure> {
    // What decoding explains says nothing about another asset.
    let bound = arguments.against.is_none().then(|| DecodingBound::new(reference, &packed.packing));
    let maps_per_pass = arguments.maps_per_pass.map(usize::from);
    let mode = arguments.mode.unwrap_or(Mode::Both);
    let modes = mode.texture_modes();
    let bar = progress::bar("verifying", modes.len() * lights.len());
    let mut figures = Vec::new();
    let mut decoded = Vec::new();
    for &mode in modes {
        let mut maps = GpuMaps::upload(gpu, packed, mode, maps_per_pass)?;
        decoded.clone_from(&maps.decoded);
        let mut of_lights = Vec::new();
        for (&light, difference) in
            lights.iter().zip(differences(&mut maps, reference, lights, machine, &bar)?)
        {
            let decoding = match &bound {
                Some(bound) if mode == TextureMode::Native => bound.at(light),
                _ => 0.0,
            };
            let allowed = match arguments.tolerance {
                Some(tolerance) => tolerance * difference.full_range,
                None => ROUNDING * difference.full_range + decoding,
            };
            of_lights.push(LightFigures { light, difference, allowed });
        }
        figures.push(ModeFigures { mode, lights: of_lights });
    }
    let decoding = match mode {
        Mode::Decoded => Vec::new(),
        Mode::Native | Mode::Both => decoding_differences(gpu, packed, 0)?,
    };
    bar.finish_and_clear();
    Ok(Verification { adapter: gpu.name(), software: gpu.is_software(), modes: figures, decoding, decoded })
}
