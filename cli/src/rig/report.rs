//! `relight rig report`: errors against distance, a curve a model, and what each model costs.

use super::bake::{label, positive};
use super::curves::{Curve, Mark, Panel, svg};
use super::digits;
use crate::failure::Failure;
use crate::interrupt;
use crate::options::{Machine, MachineOptions, check_apart, check_extension, check_writable};
use crate::say::say;
use crate::view::three_of;
use clap::Args;
use relight_core::vectors::unit;
use relight_formats::{read_rig, write_whole};
use relight_rig::{
    DISTANCES, ErrorTable, Fitting, Ground, Light, Model, Pixels, PlacedPart, Placement, Quantity, RigPart,
    Source, SurfacePoint, directions, error_table,
};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

/// What to report on.
#[derive(Args, Debug)]
#[group(id = "rig_report")]
pub(super) struct ReportArguments {
    /// The rig: .rig
    rig: PathBuf,
    /// Curves of error against distance and of cost against error
    #[arg(short, long, value_name = "FILE.svg")]
    output: Option<PathBuf>,
    /// The same in numbers
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Models to compare with the rig's own, each fitted to its surface anew
    #[arg(
        long,
        value_name = "MODEL,..",
        value_delimiter = ';',
        default_value = "constant;gradient;lattice:2x2x2;mixed:3,gradient,constant;lattice:2x2x3;lattice:4x4x4"
    )]
    models: Vec<String>,
    /// The light stands in this direction only, instead of in any
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of)]
    toward: Option<[f64; 3]>,
    /// Distances of tables, in radii of the mesh
    #[arg(long, value_name = "RADII,..", value_delimiter = ',', default_values_t = DISTANCES, allow_negative_numbers = true, value_parser = positive)]
    distances: Vec<f64>,
    /// Grey levels are those of a light that a white diffuser at the mesh's middle reflects as 1 from this distance, in radii
    #[arg(long, value_name = "RADII", default_value = "4", allow_negative_numbers = true, value_parser = positive)]
    white_at: f64,
    /// The part of a rig of several; the first by default
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    #[command(flatten)]
    machine: MachineOptions,
}

/// A model as it was measured.
struct Row {
    model: String,
    way: &'static str,
    vectors: usize,
    errors: ErrorTable,
    nanoseconds: f64,
    seconds: f64,
}

/// Pixels that are lit for the time of a model.
const TIMED: usize = 65_536;

/// Runs the subcommand.
pub(super) fn run(arguments: &ReportArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let toward =
        match arguments.toward {
            None => directions(),
            Some(v) => vec![unit(v).ok_or_else(|| {
                Failure::usage("--toward 0,0,0 is no direction; give where the light stands")
            })?],
        };
    if let Some(within) = arguments.distances.iter().find(|distance| **distance <= 1.0) {
        return Err(Failure::usage(format!(
            "--distances has {within}, within the mesh's sphere; give more than 1 radius"
        )));
    }
    let models = arguments.models.iter().map(|text| Model::parse(text)).collect::<Result<Vec<_>, _>>()?;
    let file = read_rig(&arguments.rig, machine.memory)?;
    let outputs = || arguments.output.iter().chain(&arguments.json);
    check_apart(outputs(), [&arguments.rig])?;
    arguments.output.iter().try_for_each(|path| check_extension(path, "svg"))?;
    arguments.json.iter().try_for_each(|path| check_extension(path, "json"))?;
    for output in outputs() {
        check_writable(output)?;
    }
    let parts = &file.rig.parts;
    let part = match &arguments.part {
        None => &parts[0],
        Some(name) => parts.iter().find(|part| part.name == *name).ok_or_else(|| {
            let names: Vec<_> = parts.iter().map(|part| format!("'{}'", part.name)).collect();
            Failure::usage(format!("--part {name}: the rig has {}", names.join(", ")))
        })?,
    };
    let bands = file.rig.bands;
    let mut distances = arguments.distances.clone();
    distances.sort_by(f64::total_cmp);
    let ground = ground_of(part);
    let mut rows = Vec::new();
    let mut measure = |part: &RigPart, seconds: f64, way| -> Result<(), Failure> {
        interrupt::check()?;
        let errors = error_table(part, bands, &toward, &distances);
        let nanoseconds = nanoseconds(part, bands, &machine);
        let vectors = part.model.parameters().len();
        rows.push(Row { model: part.model.text().to_owned(), way, vectors, errors, nanoseconds, seconds });
        Ok(())
    };
    measure(part, 0.0, "as baked")?;
    for model in &models {
        for (fitting, way) in [(Fitting::Surface, "least squares"), (Fitting::Nodes, "nodes")] {
            let start = Instant::now();
            let fitted = ground.without_errors(model, fitting);
            measure(&fitted, start.elapsed().as_secs_f64(), way)?;
        }
    }
    let grey = 255.0 * arguments.white_at * arguments.white_at;
    print(part, &rows, &distances, grey);
    if let Some(path) = &arguments.output {
        write_whole(path, drawing(&rows, &distances, grey).as_bytes())?;
    }
    if let Some(path) = &arguments.json {
        let record = json!({
            "part": part.name,
            "bands": bands,
            "toward": arguments.toward,
            "grey_per_error": grey,
            "models": rows.iter().map(|row| record(row, grey)).collect::<Vec<_>>(),
        });
        write_whole(path, format!("{record:#}\n").as_bytes())?;
    }
    Ok(())
}

/// What the rig was made for. A rig from nodes has no samples of its surface; points of it stand for them.
fn ground_of(part: &RigPart) -> Ground {
    let is_surface = part.samples.len() > part.model.parameters().len()
        && part.samples.iter().all(|sample| sample.quantity == Quantity::Value);
    let samples = match is_surface {
        true => part
            .samples
            .iter()
            .map(|s| SurfacePoint { position: s.position, normal: [0.0, 0.0, 1.0] })
            .collect(),
        false => part.surface.iter().step_by(4).copied().collect(),
    };
    Ground { name: part.name.clone(), frame: part.frame, samples, surface: part.surface.clone() }
}

/// Nanoseconds a pixel that the rig takes on one thread, the least of five times.
fn nanoseconds(part: &RigPart, bands: usize, machine: &Machine) -> f64 {
    let placed = PlacedPart { part, placement: Placement::IDENTITY };
    let mut pixels = Pixels::default();
    for point in part.surface.iter().cycle().take(TIMED) {
        pixels.push(&placed, point.position, point.normal);
    }
    let light = Light {
        name: String::new(),
        source: Source::Directional { direction: [0.0, 0.0, 1.0] },
        color: [1.0; 3],
    };
    let time = |_| {
        let start = Instant::now();
        let lit = pixels.by_rig(&placed, std::slice::from_ref(&light), bands, machine.level);
        let seconds = start.elapsed().as_secs_f64();
        std::hint::black_box(lit);
        1e9 * seconds / TIMED as f64
    };
    // As many threads as the command has share the pixels.
    (0..5).map(time).fold(f64::INFINITY, f64::min) * machine.threads as f64
}

fn print(part: &RigPart, rows: &[Row], distances: &[f64], grey: f64) {
    let shown: Vec<usize> =
        [2.0, 3.0, 4.0, 6.0, 12.0].iter().filter_map(|d| distances.iter().position(|x| x == d)).collect();
    let shown = if shown.is_empty() { (0..distances.len().min(6)).collect() } else { shown };
    let heads: String = shown.iter().map(|&i| format!("{:>10}", distances[i])).collect();
    say!(
        "{}: largest error of the rig per radiance x (light's radius / mesh's radius)^2, by distance in radii",
        label(&part.name)
    );
    say!("{:<28} {:<14} vectors  ns/pixel {heads}   grey at {}", "model", "fitted", distances[shown[0]]);
    for row in rows {
        let errors: String = shown.iter().map(|&i| format!("{:>10}", digits(row.errors.rig[i]))).collect();
        let worst = digits(grey * row.errors.rig[shown[0]]);
        say!(
            "{:<28} {:<14} {:>7} {:>9.2} {errors}   {worst}",
            row.model,
            row.way,
            row.vectors,
            row.nanoseconds
        );
    }
}

fn record(row: &Row, grey: f64) -> Value {
    let in_grey: Vec<f64> = row.errors.rig.iter().map(|error| grey * error).collect();
    json!({
        "model": row.model,
        "fitted": row.way,
        "vectors": row.vectors,
        "nanoseconds_a_pixel": row.nanoseconds,
        "seconds_to_fit": row.seconds,
        "distance": row.errors.distances,
        "rig": row.errors.rig,
        "total": row.errors.total,
        "rig_grey": in_grey,
    })
}

fn drawing(rows: &[Row], distances: &[f64], grey: f64) -> String {
    // A curve a model: the rig's own and those of least squares.
    let shown: Vec<&Row> = rows.iter().filter(|row| row.way != "nodes").collect();
    let curve = |row: &&Row| Curve {
        name: format!("{} ({})", row.model, row.vectors),
        points: distances.iter().zip(&row.errors.rig).map(|(d, error)| (*d, grey * error)).collect(),
    };
    let at = distances.iter().position(|d| *d >= 4.0).unwrap_or(distances.len() - 1);
    let mark =
        |row: &&Row| Mark { name: row.model.clone(), place: (row.nanoseconds, grey * row.errors.rig[at]) };
    svg(&[
        Panel {
            title: "Error of the rig against distance".to_owned(),
            x: "distance of the light, radii of the mesh".to_owned(),
            y: "largest error, grey levels".to_owned(),
            curves: shown.iter().map(curve).collect(),
            marks: Vec::new(),
        },
        Panel {
            title: format!("Error at {} radii against cost", distances[at]),
            x: "nanoseconds a pixel".to_owned(),
            y: "largest error, grey levels".to_owned(),
            curves: Vec::new(),
            marks: shown.iter().map(mark).collect(),
        },
    ])
}
