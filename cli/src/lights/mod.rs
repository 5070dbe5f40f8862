//! `relight lights`: the capture doctor.

mod plot;

use crate::failure::{Exit, Failure};
use crate::options::{Machine, MachineOptions};
use crate::say::say;
use crate::{interrupt, notes, progress};
use clap::Args;
use rayon::prelude::*;
use relight_core::basis::{FAMILIES, SrbfDesign};
use relight_core::sphere::largest_hole;
use relight_core::{Design, Direction, LightSet};
use relight_fit::{Usability, largest_usable, usability};
use relight_formats::{
    Capture, LightFile, Samples, decode, light_file_in, open_capture, read_light_file, unmatched,
};
use std::path::PathBuf;

/// What to examine.
#[derive(Args, Debug)]
pub(crate) struct LightsArguments {
    /// A .lp file, or a folder that holds one
    set: PathBuf,
    /// Draw the light sphere seen from the camera
    #[arg(long, value_name = "FILE.svg|.png")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Lights closer than this (degrees) are reported as duplicates.
const DUPLICATE_DEG: f64 = 0.1;

/// A picture with more than this part of its samples at full scale is over-exposed.
const CLIPPED: f64 = 0.02;

/// A picture whose brightest percent stays below this part of full scale is under-exposed.
const DIM: f64 = 0.1;

/// Lines of a list before it is cut.
const LISTED: usize = 10;

/// Runs the subcommand.
pub(crate) fn run(arguments: &LightsArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    if let Some(path) = &arguments.plot {
        plot::check(path)?;
    }
    let file = read_light_file(&light_file_in(&arguments.set)?)?;
    let lights = light_set(&file);
    say!("{}: {} lights", file.path.display(), lights.len());
    coverage(&lights);
    vectors(&file);
    let matched = names(&file)?;
    match &matched {
        Ok(capture) => {
            notes::print(&capture.notes);
            exposures(capture, &machine)?;
        }
        Err(_) => notes::print(&file.notes),
    }
    bases(&lights)?;
    if let Some(path) = &arguments.plot {
        plot::write(path, &lights)?;
    }
    match matched {
        Ok(_) => Ok(()),
        Err(problem) => Err(Failure::new(Exit::CheckFailed, problem)),
    }
}

fn light_set(file: &LightFile) -> LightSet {
    let lights = file
        .entries
        .iter()
        .map(|entry| relight_core::Light { name: entry.name.clone(), direction: entry.direction });
    LightSet { lights: lights.collect() }
}

/// Azimuth and elevation in words.
fn place(direction: Direction) -> String {
    let (azimuth, elevation) = (direction.azimuth().to_degrees(), direction.elevation().to_degrees());
    format!("azimuth {azimuth:.0}, elevation {elevation:.0} deg")
}

fn coverage(lights: &LightSet) {
    let directions = lights.directions();
    if let Some(hole) = largest_hole(&directions) {
        say!("largest hole: {:.1} deg around {}", hole.radius.to_degrees(), place(hole.centre));
    }
    let lowest = lights.lights.iter().min_by(|a, b| a.direction.z().total_cmp(&b.direction.z()));
    if let Some(lowest) = lowest {
        let elevation = lowest.direction.elevation().to_degrees();
        say!("lowest light: {elevation:.1} deg above the picture plane ({})", lowest.name);
    }
    let below = directions.iter().filter(|d| d.z() < 0.0).count();
    if below > 0 {
        say!("{below} lights lie below the picture plane: hsh sees them at the horizon, ptm as if above");
    }
}

fn vectors(file: &LightFile) {
    let mut pairs = Vec::new();
    for (i, a) in file.entries.iter().enumerate() {
        for b in &file.entries[i + 1..] {
            if a.direction.angle_to(b.direction).to_degrees() < DUPLICATE_DEG {
                pairs.push(format!("{} (line {}) and {} (line {})", a.name, a.line, b.name, b.line));
            }
        }
    }
    list("pairs of lights less than 0.1 deg apart", &pairs);
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let odd: Vec<String> = file
        .entries
        .iter()
        .filter(|entry| (length(entry.vector) - 1.0).abs() > 0.01)
        .map(|entry| format!("{} (line {}): length {:.3}", entry.name, entry.line, length(entry.vector)))
        .collect();
    list("vectors that are not of unit length (directions are used)", &odd);
}

/// Prints names without files and files without names; the capture, or why a bake would refuse it.
fn names(file: &LightFile) -> Result<Result<Capture, String>, Failure> {
    let found = unmatched(file)?;
    let names: Vec<String> =
        found.entries.iter().map(|entry| format!("{} (line {})", entry.name, entry.line)).collect();
    list("names that match no file", &names);
    let pictures: Vec<String> = found.pictures.iter().map(|path| path.display().to_string()).collect();
    list("pictures that no line names", &pictures);
    Ok(open_capture(&file.path).map(|open| open.capture).map_err(|error| error.to_string()))
}

fn exposures(capture: &Capture, machine: &Machine) -> Result<(), Failure> {
    let bar = progress::bar("exposure", capture.pictures.len());
    let examined = capture.pictures.par_iter().zip(&capture.lights.lights).map(|(path, light)| {
        interrupt::check()?;
        let picture = decode(path, machine.level, machine.memory / machine.threads as u64)?;
        bar.inc(1);
        Ok(exposure(&picture.samples).map(|words| format!("{}: {words}", light.name)))
    });
    let odd: Vec<Option<String>> = examined.collect::<Result<_, Failure>>()?;
    bar.finish_and_clear();
    let odd: Vec<String> = odd.into_iter().flatten().collect();
    list("pictures over- or under-exposed", &odd);
    Ok(())
}

/// What is wrong with a picture's exposure; float pictures have no full scale to clip at.
fn exposure(samples: &Samples) -> Option<String> {
    let mut histogram = vec![0usize; 256];
    match samples {
        Samples::U8(codes) => codes.iter().for_each(|&code| histogram[usize::from(code)] += 1),
        Samples::U16(codes) => codes.iter().for_each(|&code| histogram[usize::from(code >> 8)] += 1),
        Samples::F16(_) | Samples::F32(_) => return None,
    }
    let count = samples.len() as f64;
    let clipped = histogram[255] as f64 / count;
    let mut above = 0;
    let bright = (0..256).rev().find(|&code| {
        above += histogram[code];
        above as f64 > 0.01 * count
    });
    let bright = bright.unwrap_or(0) as f64 / 255.0;
    if clipped > CLIPPED {
        Some(format!("over-exposed, {:.1} % of its samples at full scale", 100.0 * clipped))
    } else if bright < DIM {
        Some(format!("under-exposed, 99 % of its samples below {:.0} % of full scale", 100.0 * bright))
    } else {
        None
    }
}

fn bases(lights: &LightSet) -> Result<(), Failure> {
    say!("basis        condition  rank");
    let row = |found: &Usability| {
        let (name, count) = (found.basis.family().name, found.basis.count());
        let usable = if found.usable { "" } else { "  not usable" };
        say!("{name:>5} {count:>4} {:>12.1}  {:>4}{usable}", found.condition, found.rank);
    };
    let mut largest = Vec::new();
    for family in FAMILIES.iter().filter(|family| !family.learned) {
        let srbf = SrbfDesign::default();
        for count in family.counts_up_to(64) {
            // A family of any count is shown at squares.
            if family.counts_up_to(64).len() > 20 && (count < 9 || count.isqrt().pow(2) != count) {
                continue;
            }
            interrupt::check()?;
            row(&usability(family.build(&Design { count, lights, srbf })?, lights)?);
        }
        match largest_usable(family, lights, srbf, 128)? {
            Some(found) => largest.push(format!("{} {}", family.name, found.basis.count())),
            None => largest.push(format!("no {}", family.name)),
        }
    }
    say!("largest usable: {}", largest.join(", "));
    Ok(())
}

/// Prints a headed list, cut after some lines; nothing when it is empty.
fn list(heading: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    say!("{heading}: {}", lines.len());
    for line in lines.iter().take(LISTED) {
        say!("  {line}");
    }
    if lines.len() > LISTED {
        say!("  and {} more", lines.len() - LISTED);
    }
}
