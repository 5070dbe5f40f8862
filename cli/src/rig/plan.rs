//! `relight rig plan`.

use super::bake::{label, positive};
use super::digits;
use super::scene::{Moments, moments};
use super::window::{ringing_record, ringing_words};
use crate::failure::Failure;
use crate::notes;
use crate::options::{MachineOptions, check_apart, check_writable};
use crate::say::say;
use clap::Args;
use relight_core::relighter::Picture;
use relight_formats::{RigFile, picture_depths, read_rig, write_picture, write_whole};
use relight_rig::{LightPlan, Plan, Ringing, Source, SphereTable, TableAxes, plan};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to plan.
#[derive(Args, Debug)]
#[group(id = "rig_plan")]
pub(super) struct PlanArguments {
    /// The rig: .rig
    rig: PathBuf,
    /// The scene: lights, how the mesh moves, a sequence
    #[arg(long, value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Largest error in grey levels of an 8-bit sRGB picture of a white diffuser
    #[arg(long, value_name = "GREY", default_value = "1", allow_negative_numbers = true, value_parser = positive)]
    tolerance: f64,
    /// Write the plan of every picture
    #[arg(short, long, value_name = "FILE.json")]
    output: Option<PathBuf>,
    /// Also write the table by which a shader evaluates sphere lights (.exr), if any of them is evaluated at every point
    #[arg(long, value_name = "FILE.exr")]
    table: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Texels along the side of the table for shaders.
const TABLE: usize = 64;

/// What becomes of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Dropped,
    Rig,
    Transition,
    Analytic,
}

impl Way {
    const ALL: [Self; 4] = [Self::Analytic, Self::Transition, Self::Rig, Self::Dropped];

    fn of(plan: &LightPlan) -> Self {
        match plan.analytic {
            _ if plan.dropped => Self::Dropped,
            0.0 => Self::Rig,
            1.0 => Self::Analytic,
            _ => Self::Transition,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Dropped => "dropped",
            Self::Rig => "rig",
            Self::Transition => "transition",
            Self::Analytic => "analytic",
        }
    }
}

/// Runs the subcommand.
pub(super) fn run(arguments: &PlanArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let outputs = || arguments.output.iter().chain(&arguments.table);
    if let Some(table) = &arguments.table {
        check_table(table)?;
    }
    let file = read_rig(&arguments.rig, machine.memory)?;
    let moments = moments(&arguments.scene, &file, &machine)?;
    check_apart(outputs(), moments.inputs.iter().chain([&arguments.rig]))?;
    for output in outputs() {
        check_writable(output)?;
    }
    let start = Instant::now();
    let plan = plan(&moments.pictures(&file), file.rig.bands, arguments.tolerance, machine.level);
    let seconds = start.elapsed().as_secs_f64();
    print(&plan, &moments, &file, arguments.tolerance, seconds);
    let has_spheres = has_analytic_spheres(&plan, &moments);
    if let Some(path) = &arguments.output {
        let tables: &[&str] = if has_spheres { &["sphere"] } else { &[] };
        let record = json!({
            "tolerance_grey": arguments.tolerance,
            "rules": file.rig.parts.iter().zip(&plan.rules).map(|(part, rule)| json!({
                "part": part.name, "strictness": rule.strictness, "dropped": rule.dropped,
            })).collect::<Vec<_>>(),
            "tables": tables,
            "seconds": seconds,
            "pictures": records(&plan, &moments, &file),
        });
        write_whole(path, format!("{record:#}\n").as_bytes())?;
    }
    match &arguments.table {
        Some(path) if has_spheres => write_table(path),
        Some(path) => {
            say!("{}: not written; no sphere light is evaluated at every point", path.display());
            Ok(())
        }
        None => Ok(()),
    }
}

fn check_table(path: &Path) -> Result<(), Failure> {
    let depth = picture_depths(path).map_err(Failure::of_output)?[1];
    if depth.is_linear() {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{}: the table has values above 1; give a name that ends in .exr",
        path.display()
    )))
}

/// Whether a sphere light is evaluated at any point of any picture.
fn has_analytic_spheres(plan: &Plan, moments: &Moments) -> bool {
    plan.pictures.iter().zip(&moments.list).any(|(picture, moment)| {
        picture.parts.iter().any(|part| {
            let spheres = part
                .iter()
                .zip(&moment.lights)
                .filter(|(_, light)| matches!(light.source, Source::Sphere { .. }));
            spheres.into_iter().any(|(plan, _)| plan.analytic > 0.0)
        })
    })
}

fn write_table(path: &Path) -> Result<(), Failure> {
    let table = SphereTable::new(TableAxes::Angles, TABLE);
    let paper = SphereTable::new(TableAxes::Cosine, 128);
    let grey = |table: &SphereTable| digits(table.largest_error());
    say!(
        "{}: {TABLE} x {TABLE}, errs by {} grey levels at most (the paper's parameters in 128 x 128: {})",
        path.display(),
        grey(&table),
        grey(&paper)
    );
    let picture = Picture { width: TABLE, height: TABLE, channels: 1, samples: table.values };
    let depth = picture_depths(path).map_err(Failure::of_output)?[1];
    Ok(write_picture(path, &picture, depth)?)
}

/// How many lights of a part go each way.
fn counts(plans: &[LightPlan]) -> [usize; 4] {
    Way::ALL.map(|way| plans.iter().filter(|plan| Way::of(plan) == way).count())
}

fn print(plan: &Plan, moments: &Moments, file: &RigFile, tolerance: f64, seconds: f64) {
    let errors: Vec<f64> = plan.pictures.iter().filter_map(|picture| picture.error_grey).collect();
    let measured = match (plan.pictures.len(), errors.len()) {
        (all, some) if some < all => format!("{some} of them, evenly through the sequence"),
        _ => "all of them".to_owned(),
    };
    say!(
        "{} pictures, errors up to {} of {tolerance} grey levels at surface points of {measured}, {seconds:.2} s",
        plan.pictures.len(),
        digits(errors.iter().copied().fold(0.0, f64::max)),
    );
    if errors.iter().any(|error| *error > tolerance) {
        notes::print(&[format!(
            "the strictest plan that was tried errs by more than the tolerance of {tolerance}; give a larger one"
        )]);
    }
    for (part, rule) in file.rig.parts.iter().zip(&plan.rules) {
        say!("  {}: tabulated errors count {} times", label(&part.name), digits(rule.strictness));
    }
    for (index, part) in file.rig.parts.iter().enumerate() {
        let measured = plan.pictures.iter().filter_map(|picture| picture.ringing.as_ref());
        let ringing = measured.fold(Ringing::default(), |sum, of_parts| sum.and(of_parts[index]));
        say!("  {}", ringing_words(&part.name, &ringing, "points"));
    }
    say!("  time    part             analytic  transition   rig  dropped");
    for (picture, moment) in plan.pictures.iter().zip(&moments.list) {
        for (part, plans) in file.rig.parts.iter().zip(&picture.parts) {
            let [analytic, transition, rig, dropped] = counts(plans);
            let time = moment.time;
            say!(
                "  {time:<7.3} {:<16} {analytic:>8}  {transition:>10} {rig:>5}  {dropped:>7}",
                label(&part.name)
            );
        }
    }
    if let ([picture], [moment]) = (&plan.pictures[..], &moments.list[..]) {
        for (part, plans) in file.rig.parts.iter().zip(&picture.parts) {
            say!("lights of {}:", label(&part.name));
            for (plan, light) in plans.iter().zip(&moment.lights) {
                say!("  {:<24} {}", light.name, words(plan));
            }
        }
    }
}

/// What becomes of a light, in words.
fn words(plan: &LightPlan) -> String {
    let way = Way::of(plan).name();
    let place = match plan.distance.is_finite() {
        true => format!(
            " at {} radii (near {}, far {})",
            digits(plan.distance),
            digits(plan.near),
            digits(plan.far)
        ),
        false => " from afar".to_owned(),
    };
    match Way::of(plan) {
        Way::Transition => format!("{way}, {:.0} % analytic{place}", 100.0 * plan.analytic),
        _ => format!("{way}{place}"),
    }
}

fn records(plan: &Plan, moments: &Moments, file: &RigFile) -> Vec<Value> {
    let light_record = |plan: &LightPlan, name: &str| {
        // JSON has no infinity: what is from afar has no distances.
        let finite = |value: f64| value.is_finite().then_some(value);
        let is_local = plan.distance.is_finite();
        json!({
            "name": name,
            "way": Way::of(plan).name(),
            "analytic": plan.analytic,
            "distance": finite(plan.distance),
            "near": is_local.then_some(finite(plan.near)).flatten(),
            "far": is_local.then_some(finite(plan.far)).flatten(),
        })
    };
    let pictures = plan.pictures.iter().zip(&moments.list);
    pictures.map(|(picture, moment)| {
        let parts = file.rig.parts.iter().zip(&picture.parts).enumerate().map(|(index, (part, plans))| {
            let [analytic, transition, rig, dropped] = counts(plans);
            let ringing = picture.ringing.as_ref().map(|of_parts| ringing_record(&of_parts[index]));
            let lights: Vec<_> =
                plans.iter().zip(&moment.lights).map(|(plan, light)| light_record(plan, &light.name)).collect();
            json!({
                "name": part.name,
                "counts": { "analytic": analytic, "transition": transition, "rig": rig, "dropped": dropped },
                "ringing": ringing,
                "lights": lights,
            })
        });
        json!({ "time": moment.time, "error_grey": picture.error_grey, "parts": parts.collect::<Vec<_>>() })
    }).collect()
}
