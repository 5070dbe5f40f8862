//! `relight rig bake`.

use super::digits;
use super::mesh::{PartMeshes, surface_of};
use crate::failure::{Exit, Failure};
use crate::interrupt;
use crate::options::{MachineOptions, check_apart, check_extension, check_writable};
use crate::say::say;
use clap::{Args, ValueEnum};
use relight_formats::{RigFile, write_rig, write_whole};
use relight_rig::{
    Choice, Envelope, Fitting, Ground, LightFamily, MOST_BANDS, MOST_PARAMETERS, Model, Rig, RigPart,
    SAMPLES, cheapest,
};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

/// What to fit.
#[derive(Args, Debug)]
#[group(id = "rig_bake")]
pub(super) struct BakeArguments {
    /// The mesh: .glb, .gltf or .obj
    mesh: PathBuf,
    /// The rig to write (.rig)
    #[arg(short, long, value_name = "RIG")]
    output: PathBuf,
    /// How lighting varies over the mesh: constant, gradient, lattice:XxYxZ, mixed:X,Y,Z (each constant, gradient or a number
    /// of nodes), or auto for the cheapest that meets --target-error
    #[arg(long, value_name = "MODEL", default_value = "auto")]
    model: String,
    /// Samples of the surface from which lights are seen
    #[arg(long, value_name = "N", default_value = "512", value_parser = samples_of)]
    samples: usize,
    /// surface: least squares over the samples; nodes: the middle and the lattice's nodes, without looking at the surface
    #[arg(long, value_name = "WAY", value_enum, default_value = "surface")]
    fit: FitChoice,
    /// Bands of the harmonics
    #[arg(long, value_name = "N", default_value = "3", value_parser = clap::value_parser!(u8).range(1..=MOST_BANDS as i64))]
    bands: u8,
    /// A rig for each node of a glTF file or object of an OBJ file, which move by themselves
    #[arg(long)]
    parts: bool,
    /// Largest error in grey levels (255 x reflected light) that auto allows under the lights that --nearest and --brightness
    /// describe
    #[arg(long, value_name = "GREY", default_value = "4", allow_negative_numbers = true, value_parser = positive)]
    target_error: f64,
    /// How near the lights come, in radii of the mesh from its middle
    #[arg(long, value_name = "RADII", default_value = "4", value_parser = beyond_one)]
    nearest: f64,
    /// What a white diffuser at the mesh's middle reflects when it faces the nearest light
    #[arg(long, value_name = "VALUE", default_value = "0.25", allow_negative_numbers = true, value_parser = positive)]
    brightness: f64,
    /// Also write models that were tried, errors by distance and times
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FitChoice {
    Surface,
    Nodes,
}

pub(super) fn samples_of(text: &str) -> Result<usize, String> {
    let within = text.parse().ok().filter(|samples| SAMPLES.contains(samples));
    within.ok_or_else(|| {
        format!("'{text}' is not a number of samples within {}..{}", SAMPLES.start(), SAMPLES.end())
    })
}

/// A finite number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number > 0.0 && number.is_finite());
    number.ok_or_else(|| format!("'{text}' is not a number above 0"))
}

fn beyond_one(text: &str) -> Result<f64, String> {
    let number = positive(text)?;
    if number > 1.0 {
        Ok(number)
    } else {
        Err(format!("'{text}' is within the mesh's sphere; give more than 1 radius"))
    }
}

/// Runs the subcommand.
pub(super) fn run(arguments: &BakeArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let model = match arguments.model.as_str() {
        "auto" => None,
        text => Some(Model::parse(text)?),
    };
    check_apart([&arguments.output].into_iter().chain(&arguments.report), [&arguments.mesh])?;
    check_extension(&arguments.output, "rig")?;
    arguments.report.iter().try_for_each(|path| check_extension(path, "json"))?;
    for output in [&arguments.output].into_iter().chain(&arguments.report) {
        check_writable(output)?;
    }
    let meshes = PartMeshes::read(&arguments.mesh, arguments.parts, machine.memory)?;
    let bands = usize::from(arguments.bands);
    let mut parts = Vec::new();
    let mut records = Vec::new();
    let mut misses = Vec::new();
    for (name, mesh) in &meshes.parts {
        interrupt::check()?;
        let start = Instant::now();
        let ground = Ground::new(name, &surface_of(mesh), arguments.samples)?;
        let chosen = arguments.chosen(&ground, model.as_ref(), bands)?;
        interrupt::check()?;
        let part = ground.part(&chosen.last().model, arguments.fitting(), bands);
        if chosen.last().error_grey > arguments.target_error && model.is_none() {
            misses.push(format!(
                "{} reaches {} grey levels with {}",
                label(name),
                digits(chosen.last().error_grey),
                chosen.last().model.text()
            ));
        }
        let seconds = start.elapsed().as_secs_f64();
        print(&part, &chosen, seconds);
        records.push(record(&part, &chosen, bands, seconds));
        parts.push(part);
    }
    if let Some(path) = &arguments.report {
        let report = json!({
            "mesh": arguments.mesh.display().to_string(),
            "bands": bands,
            "lights": { "nearest_radii": arguments.nearest, "brightness": arguments.brightness },
            "target_error_grey": model.is_none().then_some(arguments.target_error),
            "parts": records,
        });
        write_whole(path, format!("{report:#}\n").as_bytes())?;
    }
    if !misses.is_empty() {
        let words = format!(
            "no model of up to {MOST_PARAMETERS} vectors errs by at most {} grey levels: {}; raise --target-error or --nearest, or \
             split the mesh by --parts",
            arguments.target_error,
            misses.join(", ")
        );
        return Err(Failure::new(Exit::CheckFailed, words));
    }
    let file = RigFile { mesh: meshes.key(&arguments.mesh)?, rig: Rig { bands, parts } };
    Ok(write_rig(&arguments.output, &file)?)
}

/// Models that were tried; the last one is taken.
struct Chosen(Vec<Choice>);

impl Chosen {
    fn last(&self) -> &Choice {
        &self.0[self.0.len() - 1]
    }
}

impl BakeArguments {
    fn fitting(&self) -> Fitting {
        match self.fit {
            FitChoice::Surface => Fitting::Surface,
            FitChoice::Nodes => Fitting::Nodes,
        }
    }

    fn chosen(&self, ground: &Ground, model: Option<&Model>, bands: usize) -> Result<Chosen, Failure> {
        let lights = LightFamily { nearest: self.nearest, brightness: self.brightness };
        let fitting = self.fitting();
        Ok(Chosen(match model {
            Some(model) => {
                let error_grey = lights.error_grey(&ground.without_errors(model, fitting), bands);
                vec![Choice { model: model.clone(), error_grey }]
            }
            None => cheapest(ground, fitting, bands, lights, self.target_error, MOST_PARAMETERS)?,
        }))
    }
}

/// A part in words.
pub(super) fn label(name: &str) -> String {
    if name.is_empty() { "the mesh".to_owned() } else { format!("part '{name}'") }
}

fn print(part: &RigPart, chosen: &Chosen, seconds: f64) {
    let Choice { model, error_grey } = chosen.last();
    say!(
        "{}: {}, {} vectors from {} samples, {} grey levels, {:.2} s",
        label(&part.name),
        model.text(),
        model.parameters().len(),
        part.samples.len(),
        digits(*error_grey),
        seconds
    );
    say!(
        "  distance / radius   rig error   with truncation   (reflected light, per radiance x (light's radius / mesh's radius)^2)"
    );
    for (i, distance) in part.errors.distances.iter().enumerate() {
        say!("  {distance:>17}   {:>9}   {:>15}", digits(part.errors.rig[i]), digits(part.errors.total[i]));
    }
}

fn record(part: &RigPart, chosen: &Chosen, bands: usize, seconds: f64) -> Value {
    let tried: Vec<_> = chosen.0.iter().map(choice_record).collect();
    let transitions: Vec<_> = Envelope::new(&part.errors)
        .into_iter()
        .flat_map(|envelope| {
            [0.25, 1.0, 4.0, 16.0, 64.0].map(|strength: f64| {
            json!({ "strength": strength, "distance_at_1_grey": envelope.distance(strength, 1.0 / 255.0) })
        })
        })
        .collect();
    json!({
        "name": part.name,
        "model": part.model.text(),
        "vectors": part.model.parameters().len(),
        "floats": part.model.parameters().len() * bands * bands * 3,
        "samples": part.samples.len(),
        "frame": { "centre": part.frame.centre, "half_extent": part.frame.half_extent, "radius": part.frame.radius },
        "error_grey": chosen.last().error_grey,
        "tried": tried,
        "errors": { "distance": part.errors.distances, "rig": part.errors.rig, "total": part.errors.total },
        "transitions": transitions,
        "seconds": seconds,
    })
}

fn choice_record(choice: &Choice) -> Value {
    json!({ "model": choice.model.text(), "vectors": choice.model.parameters().len(), "error_grey": choice.error_grey })
}
