//! `relight view`: a look into a relit panorama, or at a mesh that wears a relit texture.

mod meshes;

use crate::failure::{Exit, Failure};
use crate::light_options::{light_of_angles, light_of_vector};
use crate::options::{Machine, MachineOptions, check_apart, check_writable};
use crate::render::relit_by_scene;
use clap::{Args, ValueEnum};
use meshes::MeshOptions;
use relight_core::RelightingMaps;
use relight_core::relighter::{DirectionalLight, Picture, relight_linear};
use relight_core::{CameraError, Space};
use relight_formats::{picture_depths, read_asset, write_picture};
use relight_surface::{Filter, PanoramaView, view_of_panorama};
use std::path::PathBuf;

/// Largest side of a view.
const LARGEST_SIDE: usize = 16384;

/// What to look at.
#[derive(Args, Debug)]
#[group(id = "view_arguments")]
pub(crate) struct ViewArguments {
    /// The asset: .ktx2, .dds, .exr, .ptm, .rti or a .web folder; a panorama, a lightmap or a texture
    asset: PathBuf,
    /// The picture to write (.png or .exr)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// A directional light as in `relight render`; several lights add up. Its axes are those of the capture,
    /// with --space tangent those of the mesh
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", allow_hyphen_values = true, value_parser = light_of_vector)]
    light: Vec<DirectionalLight>,
    /// The same by angles in degrees: azimuth from x towards y, elevation towards z
    #[arg(long, value_name = "AZ,EL[,R,G,B]", allow_hyphen_values = true, value_parser = light_of_angles)]
    angles: Vec<DirectionalLight>,
    /// The lights of a scene file instead, at its first time, in the axes of the capture
    #[arg(long, value_name = "SCENE.toml", conflicts_with_all = ["light", "angles"])]
    scene: Option<PathBuf>,
    /// Pixels of the picture
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size_of)]
    size: (usize, usize),
    /// Linear colour where there is nothing to see
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = color_of)]
    background: [f32; 3],
    /// Look into an equirectangular panorama of a whole turn: degrees to the right of its middle, degrees
    /// upwards, and the angle between the view's left and right edge
    #[arg(long, value_name = "YAW,PITCH,FOV", allow_hyphen_values = true, value_parser = three_of)]
    #[arg(conflicts_with = "mesh", required_unless_present = "mesh", help_heading = "Panoramas")]
    view: Option<[f64; 3]>,
    /// How values between pixels are found
    #[arg(long, value_name = "NAME", value_enum, default_value = "area", help_heading = "Panoramas")]
    filter: FilterChoice,
    /// Latitude of the panorama's upper and lower edge in degrees; 90 is the whole sphere
    #[arg(long, value_name = "DEG", default_value = "90", help_heading = "Panoramas")]
    latitude: f64,
    #[command(flatten)]
    mesh: MeshOptions,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FilterChoice {
    /// Between four pixels
    Bilinear,
    /// Catmull-Rom over sixteen pixels: sharper
    Bicubic,
    /// The mean over all that a pixel of the view covers
    Area,
}

/// Numbers separated by commas.
pub(crate) fn three_of(text: &str) -> Result<[f64; 3], String> {
    let numbers = text.split(',').map(|part| part.trim().parse::<f64>().ok().filter(|n| n.is_finite()));
    let numbers: Option<Vec<f64>> = numbers.collect();
    let three = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    three.ok_or_else(|| format!("'{text}' is not three numbers such as 30,-10,60"))
}

pub(crate) fn color_of(text: &str) -> Result<[f32; 3], String> {
    let color = three_of(text)?.map(|c| c as f32);
    if color.iter().all(|c| (0.0..=1e6).contains(c)) {
        return Ok(color);
    }
    Err(format!("'{text}' has a component outside 0..1e6"))
}

pub(crate) fn size_of(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=LARGEST_SIDE).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    sides.ok_or_else(|| format!("'{text}' is not a size within 1..{LARGEST_SIDE} such as 800x600"))
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &ViewArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let lights: Vec<_> = arguments.light.iter().chain(&arguments.angles).copied().collect();
    if lights.is_empty() && arguments.scene.is_none() && !arguments.mesh.has_lights() {
        return Err(Failure::usage("no light; give --light X,Y,Z, --angles AZ,EL or --scene SCENE.toml"));
    }
    arguments.mesh.check(arguments.scene.is_some())?;
    let depth = picture_depths(&arguments.output).map_err(Failure::of_output)?[0];
    let inputs = [&arguments.asset].into_iter().chain(arguments.mesh.inputs()).chain(&arguments.scene);
    check_apart([&arguments.output], inputs)?;
    check_writable(&arguments.output)?;
    let samples = arguments.mesh.samples_of_pixel();
    check_view_memory(arguments.size, samples, &machine)?;
    let picture = match arguments.view {
        Some(view) => arguments.panorama(view, &lights, &machine)?,
        None => arguments.mesh.picture(arguments, &lights, &machine)?,
    };
    let picture = if depth.is_linear() { picture } else { picture.encoded_from(Space::Linear) };
    write_picture(&arguments.output, &picture, depth)?;
    Ok(())
}

impl ViewArguments {
    fn maps(&self, machine: &Machine) -> Result<RelightingMaps, Failure> {
        Ok(read_asset(&self.asset, machine.memory)?)
    }

    /// The asset's own picture under the lights, in linear light.
    fn relit(&self, lights: &[DirectionalLight], machine: &Machine) -> Result<Picture, Failure> {
        let maps = self.maps(machine)?;
        match &self.scene {
            Some(scene) => relit_by_scene(&self.asset, &maps, scene, machine),
            None => Ok(relight_linear(&maps, lights, machine.level)),
        }
    }

    fn panorama(
        &self,
        [yaw, pitch, fov]: [f64; 3],
        lights: &[DirectionalLight],
        machine: &Machine,
    ) -> Result<Picture, Failure> {
        let view = PanoramaView {
            yaw: yaw.to_radians(),
            pitch: pitch.to_radians(),
            fov_x: fov.to_radians(),
            width: self.size.0,
            height: self.size.1,
            filter: match self.filter {
                FilterChoice::Bilinear => Filter::Bilinear,
                FilterChoice::Bicubic => Filter::Bicubic,
                FilterChoice::Area => Filter::Area,
            },
            latitude: self.latitude.to_radians(),
            background: self.background,
        };
        // Angles out of range are told before the asset is read.
        view.camera()?;
        let relit = self.relit(lights, machine)?;
        Ok(view_of_panorama(&relit, &view)?)
    }
}

/// Refuses views that take more than the memory allowed: what each sample sees, and the picture.
fn check_view_memory(
    (width, height): (usize, usize),
    samples: usize,
    machine: &Machine,
) -> Result<(), Failure> {
    let needed = (width * height) as u64 * (samples as u64 * 16 + 24);
    if needed > machine.memory {
        let message = format!(
            "the view needs {} MiB of memory where {} MiB are allowed; give a smaller --size or --samples, or raise \
             --memory",
            needed.div_ceil(1 << 20),
            machine.memory >> 20
        );
        return Err(Failure::new(Exit::OverBudget, message));
    }
    Ok(())
}

impl From<CameraError> for Failure {
    fn from(error: CameraError) -> Self {
        Self::usage(error.to_string())
    }
}
