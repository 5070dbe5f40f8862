//! `relight rig export`: what a scene gives a rig, as an engine keeps it.

use super::digits;
use super::scene::{Moment, moment};
use super::window::{WindowChoice, ringing_record, ringing_words};
use crate::failure::Failure;
use crate::options::{MachineOptions, check_apart, check_extension, check_writable};
use crate::say::say;
use clap::{ArgGroup, Args};
use relight_formats::{read_rig, read_scene, write_whole};
use relight_rig::convention::{Axes, HARMONICS, Places, TARGETS, Target, ambient_cubes};
use relight_rig::{AxisFunction, Frame, Placement, RigPart, Ringing, Window};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::PathBuf;

/// What to export.
#[derive(Args, Debug)]
#[group(id = "rig_export")]
#[command(group = ArgGroup::new("reader").args(["target", "zh3"]).required(true))]
pub(super) struct ExportArguments {
    /// The rig: .rig
    rig: PathBuf,
    /// The scene whose lights go through it, all of them
    #[arg(long, value_name = "SCENE.toml")]
    scene: PathBuf,
    /// When: lights and parts stand as keys have them then
    #[arg(long, value_name = "T", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    time: f64,
    /// Who reads it: directxmath, filament, filament-generic, unity, threejs, babylon, godot, bevy, gltf,
    /// gltf-without-phase
    #[arg(long, value_name = "NAME", value_parser = target_of)]
    target: Option<&'static Target>,
    /// Five values a channel instead of nine: bands 0 and 1 and a zonal one of band 2
    #[arg(long)]
    zh3: bool,
    /// Weigh bands so that light does not ring below 0 at points of the surface, and say what that costs
    #[arg(long, value_name = "WINDOW", value_enum)]
    window: Option<WindowChoice>,
    /// The reader's x, y and z in the scene, such as -x,y,z; by default that for unity, x,y,z for others
    #[arg(long, value_name = "X,Y,Z", value_parser = axes_of, allow_hyphen_values = true)]
    axes: Option<Axes>,
    /// The file to write
    #[arg(short, long, value_name = "FILE.json")]
    output: PathBuf,
    #[command(flatten)]
    machine: MachineOptions,
}

fn finite(text: &str) -> Result<f64, String> {
    let time = text.parse().ok().filter(|time: &f64| time.is_finite());
    time.ok_or_else(|| format!("'{text}' is no time; give a number"))
}

fn target_of(text: &str) -> Result<&'static Target, String> {
    Target::by_name(text).ok_or_else(|| {
        let names = TARGETS.map(|target| target.name).join(", ");
        format!("'{text}' is not one of {names}")
    })
}

fn axes_of(text: &str) -> Result<Axes, String> {
    Axes::parse(text)
        .ok_or_else(|| format!("'{text}' is not x, y and z in some order and sign, such as -x,y,z or x,z,-y"))
}

/// Runs the subcommand.
pub(super) fn run(arguments: &ExportArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let target = match arguments.target {
        Some(target) => target,
        None => target_of("zh3").map_err(Failure::usage)?,
    };
    let axes = match arguments.axes {
        Some(axes) => axes,
        None => axes_of(target.axes).map_err(Failure::usage)?,
    };
    let file = read_rig(&arguments.rig, machine.memory)?;
    let scene = read_scene(&arguments.scene, machine.level, machine.memory)?;
    let inputs = [&arguments.rig, &arguments.scene];
    check_apart([&arguments.output], inputs.into_iter().chain(&scene.inputs))?;
    check_extension(&arguments.output, "json")?;
    check_writable(&arguments.output)?;
    let moment = moment(&arguments.scene, &scene, &file, arguments.time)?;
    let lights: Vec<_> = moment.lights.iter().map(|light| (light, 1.0)).collect();
    let parts = file.rig.parts.iter().zip(&moment.placements).map(|(part, placement)| {
        let coefficients = part.coefficients(&lights, placement, file.rig.bands);
        // Bands that no target has are left out before anything is windowed.
        let bands = file.rig.bands.min(HARMONICS.isqrt());
        let vectors = coefficients.chunks_exact(file.rig.bands * file.rig.bands);
        let coefficients: Vec<_> = vectors.flat_map(|vector| &vector[..bands * bands]).copied().collect();
        let (coefficients, ringing) = arguments.windowed(part, placement, coefficients, bands, &moment);
        let mut record = exported(part, placement, &coefficients, target, &axes);
        record["ringing"] = ringing;
        record
    });
    let parts: Vec<_> = parts.collect();
    let record = json!({
        "target": target.name,
        "stores": target.stores,
        "axes": axes.text(),
        "mesh": file.mesh.name,
        "time": arguments.time,
        "values": target.values,
        "parts": parts,
    });
    Ok(write_whole(&arguments.output, format!("{record}\n").as_bytes())?)
}

impl ExportArguments {
    /// Coefficients by the window, and how far they ring; both also said.
    fn windowed(
        &self,
        part: &RigPart,
        placement: &Placement,
        mut coefficients: Vec<[f64; 3]>,
        bands: usize,
        moment: &Moment,
    ) -> (Vec<[f64; 3]>, Value) {
        let points = part.reflectance_by_band(&coefficients, placement, bands);
        let before = Ringing::of(Window::NONE.of_points(&points));
        say!("{}", ringing_words(&part.name, &before, "points"));
        let Some(choice) = self.window else { return (coefficients, ringing_record(&before)) };
        let window = choice.window(bands, || points.clone());
        window.apply(bands, &mut coefficients);
        let after = Ringing::of(window.of_points(&points));
        let exact = part.surface.iter().map(|point| {
            let (place, normal) = (placement.point(point.position), placement.direction(point.normal));
            moment.lights.iter().fold([0.0; 3], |sum, light| {
                let irradiance = light.irradiance(place, normal);
                [0, 1, 2].map(|c| sum[c] + irradiance[c] / PI)
            })
        });
        let exact: Vec<[f64; 3]> = exact.collect();
        let largest_grey = |window: &Window| {
            let differences = window.of_points(&points).zip(&exact);
            let differences = differences.flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).abs()));
            255.0 * differences.fold(0.0, f64::max)
        };
        let errors = [&Window::NONE, &window].map(largest_grey);
        say!(
            "  windowed: {}; largest difference to exact irradiance {} grey levels (reflected light x 255), {} without the window",
            ringing_words(&part.name, &after, "points"),
            digits(errors[1]),
            digits(errors[0])
        );
        let mut record = ringing_record(&after);
        record["without_window"] = ringing_record(&before);
        record["window"] = json!(window.factors[..bands]);
        record["largest_error_grey"] = json!(errors[1]);
        record["without_window"]["largest_error_grey"] = json!(errors[0]);
        (coefficients, record)
    }
}

/// A part in the target's axes.
struct Turned {
    frame: Frame,
    products: Vec<[AxisFunction; 3]>,
    /// Radiance by product.
    vectors: Vec<[[f64; 3]; HARMONICS]>,
}

impl Turned {
    fn new(part: &RigPart, coefficients: &[[f64; 3]], axes: &Axes) -> Self {
        let products = part.model.parameters();
        let turned = products.iter().zip(coefficients.chunks_exact(coefficients.len() / products.len()));
        let turned = turned.map(|(&product, vector)| {
            let (product, sign) = axes.product(product);
            // Bands that the rig has not are 0, those that targets have not are left out.
            let nine =
                std::array::from_fn(|i| vector.get(i).map_or([0.0; 3], |value| value.map(|v| sign * v)));
            (product, axes.harmonics(&nine))
        });
        let (products, vectors) = turned.unzip();
        Self { frame: axes.frame(&part.frame), products, vectors }
    }

    /// Radiance at a point in coordinates of the box.
    fn radiance(&self, point: [f64; 3]) -> [[f64; 3]; HARMONICS] {
        let mut sum = [[0.0; 3]; HARMONICS];
        for (product, vector) in self.products.iter().zip(&self.vectors) {
            let weight = (0..3).fold(1.0, |weight, axis| weight * product[axis].value(point[axis]));
            for (sum, value) in sum.iter_mut().zip(vector) {
                *sum = [0, 1, 2].map(|c| sum[c] + weight * value[c]);
            }
        }
        sum
    }
}

fn exported(
    part: &RigPart,
    placement: &Placement,
    coefficients: &[[f64; 3]],
    target: &Target,
    axes: &Axes,
) -> Value {
    let turned = Turned::new(part, coefficients, axes);
    let half_extent = turned.frame.half_extent.map(|half| if half > 0.0 { half } else { 1.0 });
    let mut record = json!({
        "name": part.name,
        "model": part.model.text(),
        "box": { "centre": turned.frame.centre, "half_extent": half_extent },
        "rotation": axes.matrix(&placement.rotation),
        "translation": axes.vector(placement.translation),
    });
    match target.places {
        Places::Parameters => {
            let weights = turned.products.iter().map(|product| product.map(weight));
            record["weights"] = weights.collect::<Vec<_>>().into();
            let vectors = turned.vectors.iter().map(|vector| floats(&(target.convert)(vector)));
            record["vectors"] = vectors.collect::<Vec<_>>().into();
        }
        Places::Cells => record["volume"] = volume(&turned, target),
    }
    record
}

/// How a vector weighs along an axis.
fn weight(function: AxisFunction) -> Value {
    match function {
        AxisFunction::One => json!("one"),
        AxisFunction::Coordinate => json!("coordinate"),
        AxisFunction::Hat { node, nodes } => json!({ "node": node, "nodes": nodes }),
    }
}

/// As floats, in the fewest digits that read back as the same float.
fn floats(values: &[[f64; 3]]) -> Value {
    let shortest = |v: f64| (v as f32).to_string().parse::<f64>().unwrap_or(v);
    json!(values.iter().map(|value| value.map(shortest)).collect::<Vec<_>>())
}

fn volume(turned: &Turned, target: &Target) -> Value {
    let cubes = ambient_cubes(&turned.frame, &turned.products);
    let [width, height, depth] = cubes.texels();
    let mut texels = vec![[0.0; 3]; width * height * depth];
    let [cells_x, cells_y, cells_z] = cubes.cells;
    for cell in 0..cells_x * cells_y * cells_z {
        let cell = [cell % cells_x, cell / cells_x % cells_y, cell / cells_x / cells_y];
        let sides = (target.convert)(&turned.radiance(cubes.coordinates(cell)));
        for (side, color) in sides.into_iter().enumerate() {
            let [x, y, z] = cubes.texel(cell, side);
            texels[x + width * (y + height * z)] = color;
        }
    }
    json!({
        "cells": cubes.cells,
        "centre": cubes.centre,
        "edges": cubes.edges,
        "texture": [width, height, depth],
        "texels": floats(&texels),
    })
}
