//! Lamps that are near: where they were, and what that does to pictures.

use crate::calibrate::{fov_of, scale_of};
use crate::failure::{Exit, Failure};
use crate::options::optional;
use clap::Args;
use relight_core::relighter::Picture;
use relight_core::{CpuLevel, Direction, PositionMap, RelightingMaps};
use relight_fit::{FitError, NearLamps, NearSurface, Vignetting};
use relight_formats::{FormatError, OpenCapture, read_light_file};
use relight_lights::{Accuracy, Attenuation, HorizonRule, Lamp, Light, Plan, Scene, Settings, relight_scene};
use std::path::{Path, PathBuf};

/// Options of the commands that hold photographs under near lamps against what lights an asset.
#[derive(Args, Debug)]
#[group(id = "near_options")]
pub(crate) struct NearOptions {
    /// Where each picture's lamp was, as calibrate --positions writes it: every pixel is fitted to the directions that it
    /// saw, and the lamps' fall-off is taken out
    #[arg(long, value_name = "LAMPS")]
    near: Option<PathBuf>,
    /// With --near: length of a pixel in the unit of the lamps' positions, as calibrate's --scale (1 for pixels), of a flat
    /// surface
    #[arg(long, value_name = "LENGTH", value_parser = scale_of, requires = "near", allow_negative_numbers = true)]
    scale: Option<f64>,
    /// With --near: also take out the lens's cos^4 vignetting; the angle of the pictures' whole width in degrees
    #[arg(long, value_name = "DEG", value_parser = fov_of, requires = "near", allow_negative_numbers = true)]
    vignetting: Option<f64>,
}

/// From which angle in radians on a lamp's direction by its position is another one than that in the light file: 20 degrees.
const ANOTHER: f64 = 0.349;

/// Lamps whose largest distance from the middle is this many times the least are worth a word: 20 % more light.
const UNEVEN: f64 = 1.1;

impl NearOptions {
    /// The files that are read.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.near.iter()
    }

    /// All that these options say but for files, by name.
    pub(crate) fn named(&self) -> Vec<(&'static str, String)> {
        vec![("scale", optional(self.scale)), ("vignetting", optional(self.vignetting))]
    }

    /// Where the lamps of `capture`'s pictures were; `None` without --near.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub(crate) fn positions(&self, capture: &OpenCapture) -> Result<Option<Vec<[f64; 3]>>, Failure> {
        let Some(path) = &self.near else { return Ok(None) };
        Ok(Some(read_light_file(path)?.positions_of(capture)?))
    }

    /// Whether lamps are near.
    pub(crate) fn is_given(&self) -> bool {
        self.near.is_some()
    }

    /// The lamps of `capture`'s pictures, which are `whole` pixels wide and high before they are cropped, around the
    /// surface of `map` (of the pictures as cropped) or a flat one; and the capture's directions become those from the middle
    /// of that; what is odd about them joins `notes`. `None` without --near.
    ///
    /// # Errors
    /// Exit code 2 without --scale where the surface is flat, or with it where it isn't; exit code 3 for what is wrong with the
    /// file, or with the place of a lamp.
    pub(crate) fn apply(
        &self,
        capture: &mut OpenCapture,
        whole: (usize, usize),
        map: Option<&PositionMap>,
        notes: &mut Vec<String>,
    ) -> Result<Option<NearLamps>, Failure> {
        let Some(path) = &self.near else { return Ok(None) };
        let (width, height) = capture.size();
        let (left, top) = capture.crop.map_or((0, 0), |crop| (crop.x, crop.y));
        // From the upper left corner of what is used to the middle of the whole pictures.
        let axis = [0.5 * whole.0 as f64 - left as f64, 0.5 * whole.1 as f64 - top as f64];
        let surface = match (map, self.scale) {
            (None, None) => {
                return Err(Failure::usage(
                    "--near needs to know where the surface is: give --scale, the length of a pixel in the unit of the lamps' \
                     positions (1 for pixels), or --positions, or --depth and --camera",
                ));
            }
            (Some(_), Some(_)) => {
                return Err(Failure::usage(
                    "--scale is for a flat surface; positions tell where this one is, so leave --scale out",
                ));
            }
            (None, Some(pixel)) => {
                let first = [pixel * (0.5 - axis[0]), pixel * (axis[1] - 0.5)];
                NearSurface::Plane { width, height, first, pixel }
            }
            (Some(map), None) => NearSurface::Points(map.clone()),
        };
        let vignetting = self.vignetting.map(|angle| Vignetting {
            focal: 0.5 * whole.0 as f64 / libm::tan(0.5 * angle.to_radians()),
            axis,
        });
        let positions = read_light_file(path)?.positions_of(capture)?;
        let lamps = NearLamps::new(positions, surface, vignetting).map_err(|error| match error {
            FitError::LampInTheMiddle { light } => {
                let problem = format!(
                    "the lamp of '{}' is in the middle of the surface; give where it was, from there",
                    capture.capture.lights.lights[light].name
                );
                Failure::from(FormatError::invalid(path, problem))
            }
            error => Failure::new(Exit::BadInput, format!("{}: {error}", path.display())),
        })?;
        notes.extend(oddities(path, capture, &lamps));
        for (light, direction) in capture.capture.lights.lights.iter_mut().zip(lamps.directions()) {
            light.direction = *direction;
        }
        Ok(Some(lamps))
    }
}

/// What is odd about where lamps are.
fn oddities(path: &Path, capture: &OpenCapture, lamps: &NearLamps) -> Vec<String> {
    let lights = &capture.capture.lights.lights;
    let angle = |a: Direction, b: Direction| {
        let cosine: f64 = a.components().into_iter().zip(b.components()).map(|(a, b)| a * b).sum();
        libm::acos(cosine.clamp(-1.0, 1.0))
    };
    let angles: Vec<f64> = lights
        .iter()
        .zip(lamps.directions())
        .map(|(light, direction)| angle(light.direction, *direction))
        .collect();
    let mut notes = Vec::new();
    let worst = (0..angles.len()).max_by(|a, b| angles[*a].total_cmp(&angles[*b]));
    if let Some(worst) = worst.filter(|&worst| angles[worst] > ANOTHER) {
        notes.push(format!(
            "{}: {} of {} lamps are more than 20 degrees off the directions of {} (most {}, {:.0} degrees): check axes and origin",
            path.display(),
            angles.iter().filter(|angle| **angle > ANOTHER).count(),
            angles.len(),
            capture.capture.light_file.display(),
            lights[worst].name,
            angles[worst].to_degrees()
        ));
    }
    let behind = lamps.behind();
    if let Some(first) = behind.first() {
        notes.push(format!(
            "{}: {} of {} lamps are in or behind the picture plane ({} the first) and count nothing",
            path.display(),
            behind.len(),
            lights.len(),
            lights[*first].name
        ));
    }
    let least = lamps.distances().iter().copied().fold(f64::INFINITY, f64::min);
    let largest = lamps.distances().iter().copied().fold(0.0, f64::max);
    if largest > UNEVEN * least && capture.gains.is_empty() {
        notes.push(format!(
            "lamps are {least:.4} to {largest:.4} from the middle, which keeps its light as photographed: --intensities evens it \
             out where the lamps were alike"
        ));
    }
    notes
}

/// `maps` under lamp `light` of `lamps`, whose surface has the points of `positions`: linear light as a camera there would have
/// photographed it.
pub(crate) fn relit_near(
    maps: &RelightingMaps,
    lamps: &NearLamps,
    positions: &PositionMap,
    light: usize,
    level: CpuLevel,
) -> Picture {
    let distance = lamps.distances()[light];
    let scene = Scene {
        lights: vec![Light {
            name: String::new(),
            lamp: Lamp::Point { position: lamps.positions()[light] },
            color: [1.0; 3],
            intensity: distance * distance,
            attenuation: Attenuation::InverseSquare { nearest: relight_fit::AT_SURFACE * distance },
        }],
        horizon: HorizonRule::Extrapolate,
    };
    let plan = Plan::new(&scene, &maps.model, Accuracy::Exact);
    let settings = Settings { level, step: 0.0, timed: false };
    let (mut picture, _) = relight_scene(maps, Some(positions), &scene, &plan, &settings, Vec::new());
    if lamps.is_vignetted() {
        for (pixel, samples) in picture.samples.chunks_exact_mut(picture.channels).enumerate() {
            let transmission = lamps.transmission(pixel) as f32;
            samples.iter_mut().for_each(|value| *value *= transmission);
        }
    }
    picture
}

/// Bytes that the surface of `lamps` takes beside pictures.
pub(crate) fn surface_bytes(lamps: Option<&NearLamps>) -> u64 {
    lamps.map_or(0, |lamps| match lamps.surface() {
        NearSurface::Plane { .. } => 0,
        NearSurface::Points(map) => size_of_val(&map.points[..]) as u64,
    })
}
