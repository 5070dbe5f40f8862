//! `relight calibrate`: directions and positions of lamps from their highlights on chrome spheres.

use crate::failure::{Exit, Failure};
use crate::options::{Machine, MachineOptions, check_apart, check_writable};
use crate::say::say;
use crate::{interrupt, notes, progress};
use clap::Args;
use rayon::prelude::*;
use relight_core::{Space, luminance};
use relight_fit::calibration::{
    FoundOutline, Highlight, LEAST_SUPPORT, LampPosition, LuminancePicture, MirrorSphere, Ray, SphereOutline,
    Viewer, find_highlight, find_outlines, mean_direction, position_of,
};
use relight_formats::{DecodedPicture, FormatError, decode, pictures_in, probe, write_light_file};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What to look at and where to write what it says.
#[derive(Args, Debug)]
pub(crate) struct CalibrateArguments {
    /// Folder of pictures that show one or more chrome spheres, all from the same place
    folder: PathBuf,
    /// A sphere's outline: middle from the left, from the top, and radius, in pixels, and if it does not rest on the
    /// plane of the surface, the height of its middle; or auto, to look for one. Once a sphere
    #[arg(long, value_name = "X,Y,R[,Z]|auto", required = true, allow_hyphen_values = true)]
    sphere: Vec<SphereChoice>,
    /// The light file to write: a line 'name x y z' for each picture, in the order of their names
    #[arg(short, long, value_name = "FILE.lp")]
    output: PathBuf,
    /// Angle of the pictures' whole width in degrees; without it they are seen from infinitely far
    #[arg(long, value_name = "DEG", value_parser = fov_of, allow_negative_numbers = true)]
    fov: Option<f64>,
    /// Also write where the lamps are, by two or more spheres: lines 'name x y z' from the pictures' middle, in
    /// pixels
    #[arg(long, value_name = "FILE")]
    positions: Option<PathBuf>,
    /// Length of a pixel, such as millimetres, as the unit of --positions
    #[arg(long, value_name = "LENGTH", value_parser = scale_of, requires = "positions", allow_negative_numbers = true)]
    scale: Option<f64>,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SphereChoice {
    Auto,
    Given(SphereOutline),
}

impl FromStr for SphereChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let numbers: Result<Vec<f64>, _> =
            text.split(',').map(|number| number.trim().parse::<f64>()).collect();
        let numbers = numbers.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        let (x, y, radius, rise) = match numbers.as_deref() {
            Some(&[x, y, radius]) => (x, y, radius, None),
            Some(&[x, y, radius, rise]) => (x, y, radius, Some(rise)),
            _ => return Err("write auto or three or four numbers such as 512.5,340,60".to_owned()),
        };
        Ok(Self::Given(SphereOutline { x, y, radius, rise }))
    }
}

/// The angle of a picture's whole width, in degrees.
pub(crate) fn fov_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(angle) if (0.1..=150.0).contains(&angle) => Ok(angle),
        _ => Err("write an angle from 0.1 to 150 degrees".to_owned()),
    }
}

/// The length of a pixel.
pub(crate) fn scale_of(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if (1e-12..=1e12).contains(&scale) => Ok(scale),
        _ => Err("write a length from 1e-12 to 1e12".to_owned()),
    }
}

/// A highlight of less contrast than this part of the median of all pictures' is a reflection in the dark.
const LEAST_CONTRAST: f64 = 0.1;

/// A second spot with more than this part of the light of the first is worth a note.
const RIVAL: f64 = 0.5;

/// A found sphere shows a highlight in at least this part of the pictures.
const LEAST_LIT: f64 = 0.5;

/// Decimals of directions in the file: a hundred-thousandth of a degree.
const DIRECTION_DECIMALS: usize = 7;

/// Decimals of positions.
const POSITION_DECIMALS: usize = 4;

/// Bytes of a decoded picture's luminance for each of its own, and what its decoder takes.
const PICTURE_SHARE: u64 = 8;

/// What the spheres say of the lamp of one picture.
struct Lamp {
    name: String,
    direction: [f64; 3],
    position: Option<LampPosition>,
    /// Largest angle between a sphere's direction and their mean, in radians.
    spread: f64,
    spheres: usize,
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &CalibrateArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let outputs = || std::iter::once(&arguments.output).chain(&arguments.positions);
    for path in outputs() {
        check_writable(path)?;
    }
    if arguments.positions.is_some() && arguments.sphere.len() < 2 {
        return Err(Failure::usage("--positions need two or more spheres; give --sphere once for each"));
    }
    let pictures = pictures_in(&arguments.folder)?;
    check_apart(outputs(), &pictures)?;
    let size = size_of(&pictures)?;
    let viewer = match arguments.fov {
        Some(fov) => {
            Viewer::Perspective { distance: 0.5 * size.0 as f64 / libm::tan(0.5 * fov.to_radians()) }
        }
        None => Viewer::Orthographic,
    };

    let outlines = arguments.outlines(&pictures, &machine)?;
    let spheres: Vec<(SphereOutline, MirrorSphere)> = outlines
        .iter()
        .map(|outline| {
            let sphere = MirrorSphere::from_outline(outline, size, viewer);
            Ok((*outline, sphere.map_err(|error| Failure::usage(error.to_string()))?))
        })
        .collect::<Result<_, Failure>>()?;
    for (sphere, choice) in outlines.iter().zip(&arguments.sphere) {
        let how = if *choice == SphereChoice::Auto { "found" } else { "given" };
        say!("sphere {how} at {:.2}, {:.2}, radius {:.2} pixels", sphere.x, sphere.y, sphere.radius);
    }

    let bar = progress::bar("highlights", pictures.len());
    let found = each_picture(&pictures, &machine, |picture| {
        let found = spheres.iter().map(|(outline, sphere)| {
            find_highlight(&picture.around(outline, 1.0), outline, sphere, size, viewer)
        });
        bar.inc(1);
        Ok(found.collect::<Vec<_>>())
    })?;
    bar.finish_and_clear();
    let found = credible(found);
    for (index, choice) in arguments.sphere.iter().enumerate() {
        let lit = found.iter().filter(|of_picture| of_picture[index].is_some()).count();
        if *choice == SphereChoice::Auto && (lit as f64) < LEAST_LIT * pictures.len() as f64 {
            let message = format!(
                "the circle at {:.0}, {:.0} shows a highlight in {lit} of {} pictures, so it is hardly a chrome sphere; give --sphere X,Y,R",
                outlines[index].x,
                outlines[index].y,
                pictures.len()
            );
            return Err(Failure::new(Exit::BadInput, message));
        }
    }
    let lamps = lamps(&pictures, &found);
    report(&lamps, &found, &pictures, arguments);
    if lamps.is_empty() {
        let message = format!(
            "no picture in {} shows a highlight on a sphere; check --sphere X,Y,R against the pictures",
            arguments.folder.display()
        );
        return Err(Failure::new(Exit::BadInput, message));
    }
    arguments.write(&lamps)
}

/// The size that all pictures have.
fn size_of(pictures: &[PathBuf]) -> Result<(usize, usize), Failure> {
    let infos = pictures.par_iter().map(|path| probe(path)).collect::<Result<Vec<_>, _>>()?;
    let first = (infos[0].width, infos[0].height);
    for (info, path) in infos.iter().zip(pictures) {
        if (info.width, info.height) != first {
            let problem = format!(
                "is {} x {} pixels where {} is {} x {}; spheres stand still only in pictures of one size",
                info.width,
                info.height,
                pictures[0].display(),
                first.0,
                first.1
            );
            return Err(FormatError::invalid(path, problem).into());
        }
    }
    Ok(first)
}

/// What `work` says of every picture, in their order; as many are in memory as fit it.
fn each_picture<T: Send>(
    pictures: &[PathBuf],
    machine: &Machine,
    work: impl Fn(&LuminancePicture) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    let share = machine.memory / machine.threads as u64;
    let one = |path: &PathBuf| {
        interrupt::check()?;
        let picture = decode(path, machine.level, share / 2)?;
        let needed = PICTURE_SHARE * picture.samples.len() as u64;
        if needed > share / 2 {
            return Err(FormatError::too_large(path, needed * 2, share).into());
        }
        work(&luminance_of(&picture, machine))
    };
    pictures.par_iter().map(one).collect()
}

fn luminance_of(picture: &DecodedPicture, machine: &Machine) -> LuminancePicture {
    let mut values = vec![0.0f32; picture.samples.len()];
    picture.samples.copy_to(Space::Linear, machine.level, 0, &mut values);
    let values = match picture.info.channels {
        3 => values.as_chunks().0.iter().map(|rgb| luminance(*rgb)).collect(),
        _ => values,
    };
    LuminancePicture { left: 0, top: 0, width: picture.info.width, values }
}

/// Highlights of picture after picture, sphere by sphere, less those that are far dimmer than the sphere's others.
fn credible(mut found: Vec<Vec<Option<Highlight>>>) -> Vec<Vec<Option<Highlight>>> {
    for sphere in 0..found.first().map_or(0, Vec::len) {
        let mut contrasts: Vec<f64> = found.iter().filter_map(|of| of[sphere]).map(|h| h.contrast).collect();
        contrasts.sort_by(f64::total_cmp);
        let Some(&median) = contrasts.get(contrasts.len() / 2) else { continue };
        for of_picture in &mut found {
            of_picture[sphere] = of_picture[sphere].filter(|h| h.contrast >= LEAST_CONTRAST * median);
        }
    }
    found
}

/// The lamps of those pictures in which a sphere shows one.
fn lamps(pictures: &[PathBuf], found: &[Vec<Option<Highlight>>]) -> Vec<Lamp> {
    let lamp = |(path, highlights): (&PathBuf, &Vec<Option<Highlight>>)| {
        let rays: Vec<Ray> = highlights.iter().flatten().map(|highlight| highlight.ray).collect();
        let (mean, spread) = mean_direction(&rays)?;
        let position = position_of(&rays);
        // What the middle of the pictures sees.
        let from_middle = position.and_then(|lamp| relight_core::vectors::unit(lamp.position));
        let direction = from_middle.unwrap_or(mean.components());
        Some(Lamp { name: name_of(path), direction, position, spread, spheres: rays.len() })
    };
    pictures.iter().zip(found).filter_map(lamp).collect()
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn report(
    lamps: &[Lamp],
    found: &[Vec<Option<Highlight>>],
    pictures: &[PathBuf],
    arguments: &CalibrateArguments,
) {
    let mut worth_saying = Vec::new();
    for (path, highlights) in pictures.iter().zip(found) {
        let name = name_of(path);
        match highlights.iter().flatten().count() {
            0 => worth_saying.push(format!("{name} shows no highlight and is left out")),
            count if count < highlights.len() => {
                worth_saying
                    .push(format!("{name} shows a highlight on {count} of {} spheres", highlights.len()));
            }
            _ => {}
        }
        if highlights.iter().flatten().any(|highlight| highlight.rival > RIVAL) {
            worth_saying
                .push(format!("{name} shows two highlights of like strength; the brighter one is taken"));
        }
    }
    let far = lamps.iter().filter(|lamp| lamp.position.is_none()).count();
    if arguments.positions.is_some() && far > 0 {
        worth_saying.push(format!(
            "{far} lamps have no position: their rays are parallel within 1 degree, or come from one sphere; they are left out of --positions"
        ));
    }
    notes::print(&worth_saying);
    match arguments.sphere.len() {
        1 => say!("       x        y        z  picture"),
        _ => say!("       x        y        z  spheres  apart deg  misses deg  distance  picture"),
    }
    let scale = arguments.scale.unwrap_or(1.0);
    for lamp in lamps {
        let [x, y, z] = lamp.direction;
        if arguments.sphere.len() == 1 {
            say!("{x:8.5} {y:8.5} {z:8.5}  {}", lamp.name);
            continue;
        }
        let (misses, distance) = match lamp.position {
            Some(found) => (
                format!("{:.3}", found.residual.to_degrees()),
                format!("{:.1}", scale * relight_core::vectors::length(found.position)),
            ),
            None => ("-".to_owned(), "-".to_owned()),
        };
        let (spread, name) = (lamp.spread.to_degrees(), &lamp.name);
        say!(
            "{x:8.5} {y:8.5} {z:8.5}  {:7}  {spread:9.3}  {misses:>10}  {distance:>8}  {name}",
            lamp.spheres
        );
    }
}

impl CalibrateArguments {
    /// The outlines that were given, and those that are to be found.
    fn outlines(&self, pictures: &[PathBuf], machine: &Machine) -> Result<Vec<SphereOutline>, Failure> {
        let wanted = self.sphere.iter().filter(|choice| **choice == SphereChoice::Auto).count();
        let given: Vec<SphereOutline> = self
            .sphere
            .iter()
            .filter_map(|choice| match choice {
                SphereChoice::Given(outline) => Some(*outline),
                SphereChoice::Auto => None,
            })
            .collect();
        let mut found = if wanted > 0 { find_outlines(&mean_of(pictures, machine)?) } else { Vec::new() };
        found.retain(|found| !given.iter().any(|given| overlap(given, &found.outline)));
        if found.len() < wanted {
            let circles: Vec<String> = found.iter().map(words_of).collect();
            let circles =
                if circles.is_empty() { String::new() } else { format!(" ({})", circles.join("; ")) };
            let message = format!(
                "{} of {wanted} spheres were found{circles}: no further circle in the mean picture has an edge along {:.0} % of it; give --sphere X,Y,R",
                found.len(),
                100.0 * LEAST_SUPPORT
            );
            return Err(Failure::new(Exit::BadInput, message));
        }
        let mut found = found.into_iter();
        let outline = |choice: &SphereChoice| match choice {
            SphereChoice::Given(outline) => Some(*outline),
            SphereChoice::Auto => found.next().map(|found| found.outline),
        };
        Ok(self.sphere.iter().filter_map(outline).collect())
    }

    fn write(&self, lamps: &[Lamp]) -> Result<(), Failure> {
        let scale = self.scale.unwrap_or(1.0);
        let position = |lamp: &Lamp| Some((lamp.name.clone(), lamp.position?.position.map(|c| scale * c)));
        let positions: Vec<_> = lamps.iter().filter_map(position).collect();
        if self.positions.is_some() && positions.is_empty() {
            let message = "no lamp has a position: all rays are parallel within 1 degree, so the lamps are far; leave --positions out";
            return Err(Failure::new(Exit::BadInput, message));
        }
        let directions: Vec<_> = lamps.iter().map(|lamp| (lamp.name.clone(), lamp.direction)).collect();
        write_light_file(&self.output, &directions, DIRECTION_DECIMALS)?;
        say!("{}: {} lights", self.output.display(), lamps.len());
        if let Some(path) = &self.positions {
            write_light_file(path, &positions, POSITION_DECIMALS)?;
            say!("{}: {} positions", path.display(), positions.len());
        }
        Ok(())
    }
}

fn overlap(a: &SphereOutline, b: &SphereOutline) -> bool {
    let (x, y, reach) = (a.x - b.x, a.y - b.y, a.radius + b.radius);
    x * x + y * y < reach * reach
}

fn words_of(found: &FoundOutline) -> String {
    let FoundOutline { outline: SphereOutline { x, y, radius, .. }, support } = found;
    format!("at {x:.0}, {y:.0}, radius {radius:.0}, seen along {:.0} %", 100.0 * support)
}

/// The mean of all pictures, added up in their order.
fn mean_of(pictures: &[PathBuf], machine: &Machine) -> Result<LuminancePicture, Failure> {
    let bar = progress::bar("mean", pictures.len());
    let mut mean: Option<LuminancePicture> = None;
    for some in pictures.chunks(machine.threads) {
        for picture in each_picture(some, machine, |picture| Ok(picture.clone()))? {
            bar.inc(1);
            match &mut mean {
                None => mean = Some(picture),
                Some(mean) => {
                    mean.values.iter_mut().zip(picture.values).for_each(|(sum, value)| *sum += value)
                }
            }
        }
    }
    bar.finish_and_clear();
    let mut mean = mean.ok_or_else(|| Failure::usage("the folder holds no picture"))?;
    mean.values.iter_mut().for_each(|value| *value /= pictures.len() as f32);
    Ok(mean)
}
