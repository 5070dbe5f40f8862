//! A rig's shader on the GPU, beside sums in f64.

use super::VerifyArguments;
use crate::failure::{Exit, Failure};
use crate::options::Machine;
use crate::say::{self, say};
use crate::{interrupt, progress};
use relight_core::SplitMix64;
use relight_core::vectors::{dot, scaled, unit, wide};
use relight_formats::read_rig;
use relight_gpu::{Gpu, RigBound, RigUnderLights, SphereSight};
use relight_rig::{Light, RigPart, Source};
use serde_json::{Value, json};
use std::f64::consts::PI;

/// Sphere lights that are looked at.
const SIGHTS: usize = 4096;

/// Sines of half their angles: far away, near, on the surface from both sides, inside.
const SINES: [f64; 12] = [1e-6, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.8, 0.95, 0.9999, 1.0, 1.0001, 20.0];

/// What was compared, and the sample that comes closest to what is allowed or goes furthest beyond.
struct Comparison {
    what: String,
    samples: usize,
    max: f64,
    /// The largest sample, or 1 where that is more.
    full_range: f64,
    worst: Worst,
}

/// A sample.
#[derive(Clone, Copy, Default)]
struct Worst {
    /// Of the point or the light's middle, in the order of what was compared.
    index: usize,
    gpu: f64,
    cpu: f64,
    allowed: f64,
    /// Difference over what is allowed.
    share: f64,
}

/// Runs the subcommand for a rig.
pub(super) fn run(arguments: &VerifyArguments, machine: &Machine) -> Result<(), Failure> {
    let of_textures = [
        ("--lights", arguments.lights.is_some()),
        ("--against", arguments.against.is_some()),
        ("--mode", arguments.mode.is_some()),
        ("--maps-per-pass", arguments.maps_per_pass.is_some()),
    ];
    if let Some((option, _)) = of_textures.into_iter().find(|(_, is_given)| *is_given) {
        return Err(Failure::usage(format!(
            "{option} is for textures; {} is a rig",
            arguments.asset.display()
        )));
    }
    let rig = read_rig(&arguments.asset, machine.memory)?.rig;
    let gpu = super::open(arguments)?;
    let sets = usize::from(arguments.count);
    let bar = progress::bar("verifying", rig.parts.len() * sets + 1);
    let mut comparisons = Vec::new();
    let mut random = SplitMix64::new(1);
    for part in &rig.parts {
        let mut of_part = Comparison::of(match &part.name[..] {
            "" => format!("{} at points of the mesh", part.model.text()),
            name => format!("part '{name}': {} at points of the mesh", part.model.text()),
        });
        for _ in 0..sets {
            interrupt::check()?;
            of_part.add_rig(&gpu, part, rig.bands, arguments.tolerance, &mut random)?;
            bar.inc(1);
        }
        comparisons.push(of_part);
    }
    let mut of_spheres = Comparison::of("sphere lights, exact".to_owned());
    of_spheres.add_spheres(&gpu, &rig.parts[0], rig.bands, arguments.tolerance, &mut random)?;
    comparisons.push(of_spheres);
    bar.finish_and_clear();
    if arguments.json {
        let record = json!({
            "adapter": gpu.name(),
            "software": gpu.is_software(),
            "passed": comparisons.iter().all(Comparison::passes),
            "comparisons": comparisons.iter().map(Comparison::to_json).collect::<Vec<_>>(),
        });
        say::json(&record);
    } else {
        say!("adapter: {}{}", gpu.name(), if gpu.is_software() { ", a program on the CPU" } else { "" });
        say!("      max  of what is allowed  samples");
        comparisons.iter().for_each(Comparison::print);
    }
    match comparisons.iter().find(|comparison| !comparison.passes()) {
        Some(comparison) => Err(Failure::new(Exit::CheckFailed, comparison.words())),
        None => Ok(()),
    }
}

impl Comparison {
    fn of(what: String) -> Self {
        let worst = Worst { share: -1.0, ..Worst::default() };
        Self { what, samples: 0, max: 0.0, full_range: 1.0, worst }
    }

    /// Takes a sample in; `bound` is what rounding explains.
    fn add(&mut self, index: usize, [gpu, cpu]: [f64; 2], bound: f64, tolerance: Option<f64>) {
        self.full_range = self.full_range.max(cpu.abs());
        let allowed = tolerance.map_or(bound, |tolerance| tolerance * cpu.abs().max(1.0));
        let difference = (gpu - cpu).abs();
        // NaN, which no lighting makes, is as wrong as can be.
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        let share = if difference == 0.0 { 0.0 } else { difference / allowed };
        if share > self.worst.share {
            self.worst = Worst { index, gpu, cpu, allowed, share };
        }
        self.max = self.max.max(difference);
        self.samples += 1;
    }

    /// All points of a part's surface under random coefficients.
    fn add_rig(
        &mut self,
        gpu: &Gpu,
        part: &RigPart,
        bands: usize,
        tolerance: Option<f64>,
        random: &mut SplitMix64,
    ) -> Result<(), Failure> {
        let (model, frame) = (&part.model, &part.frame);
        let count = model.parameters().len() * bands * bands;
        let coefficients: Vec<[f32; 3]> =
            (0..count).map(|_| [(); 3].map(|()| either_side(random) as f32)).collect();
        let floats = |v: [f64; 3]| v.map(|c| c as f32);
        let points: Vec<_> =
            part.surface.iter().map(|point| (floats(point.position), floats(point.normal))).collect();
        let lit = RigUnderLights { model, frame, bands, coefficients: &coefficients };
        let drawn = lit.reflectance(gpu, &points)?;
        let bound = RigBound::new(model, frame, bands, &coefficients);
        let coefficients: Vec<[f64; 3]> = coefficients.into_iter().map(wide).collect();
        for (index, (&(position, normal), drawn)) in points.iter().zip(drawn).enumerate() {
            let expected = part.reflectance(&coefficients, wide(position), wide(normal));
            let allowed = bound.at(wide(position));
            for (gpu, cpu) in wide(drawn).into_iter().zip(expected) {
                self.add(index, [gpu, cpu], allowed, tolerance);
            }
        }
        Ok(())
    }

    /// Sphere lights around points, most of them about to rise or set.
    fn add_spheres(
        &mut self,
        gpu: &Gpu,
        part: &RigPart,
        bands: usize,
        tolerance: Option<f64>,
        random: &mut SplitMix64,
    ) -> Result<(), Failure> {
        let sights: Vec<_> = (0..SIGHTS).map(|i| sight(i, random)).collect();
        let lit = RigUnderLights { model: &part.model, frame: &part.frame, bands, coefficients: &[] };
        let drawn = lit.sphere_reflectance(gpu, &sights)?;
        for (index, (sight, drawn)) in sights.iter().zip(drawn).enumerate() {
            let source = Source::Sphere { centre: wide(sight.centre), radius: f64::from(sight.radius) };
            let light = Light { name: String::new(), source, color: [1.0; 3] };
            let [expected, ..] = light.irradiance(wide(sight.position), wide(sight.normal));
            self.add(index, [f64::from(drawn), expected / PI], sight.bound(), tolerance);
        }
        Ok(())
    }

    fn passes(&self) -> bool {
        self.worst.share <= 1.0
    }

    fn print(&self) {
        let verdict = if self.passes() { "" } else { ": MORE than is allowed" };
        let share = 100.0 * self.worst.share;
        say!("{:9.2e}  {share:17.1} %  {:7}  {}{verdict}", self.max, self.samples, self.what);
    }

    fn words(&self) -> String {
        let Worst { index, gpu, cpu, allowed, .. } = self.worst;
        format!(
            "{}: the GPU has {gpu:e} at sample {index} where the CPU has {cpu:e}; {allowed:.2e} is allowed",
            self.what
        )
    }

    fn to_json(&self) -> Value {
        let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
        let Worst { index, gpu, cpu, allowed, share } = self.worst;
        json!({
            "what": self.what,
            "samples": self.samples,
            "max": finite(self.max),
            "full_range": self.full_range,
            "passed": self.passes(),
            "worst": {
                "index": index, "gpu": finite(gpu), "cpu": finite(cpu), "allowed": allowed, "share": finite(share),
            },
        })
    }
}

/// -1 to 1.
fn either_side(random: &mut SplitMix64) -> f64 {
    2.0 * random.unit() - 1.0
}

/// A unit vector.
fn direction(random: &mut SplitMix64) -> [f64; 3] {
    loop {
        let vector = [(); 3].map(|()| either_side(random));
        if let (Some(direction), 0.01..1.0) = (unit(vector), dot(vector, vector)) {
            return direction;
        }
    }
}

/// A light of one of [`SINES`], at most 1.2 of its half angles from the horizon, above or below; one in five anywhere (which shares no factor with how many there are).
fn sight(i: usize, random: &mut SplitMix64) -> SphereSight {
    let sine = SINES[i % SINES.len()];
    let (normal, aside) = (direction(random), direction(random));
    let height = either_side(random) * if i.is_multiple_of(5) { 1.0 } else { (1.2 * sine).min(1.0) };
    let along = dot(normal, aside);
    let level = [0, 1, 2].map(|c| aside[c] - along * normal[c]);
    let level = unit(level).unwrap_or(aside);
    let flat = (1.0 - height * height).sqrt();
    let distance = 2.0 + either_side(random);
    let to_centre = [0, 1, 2].map(|c| distance * (flat * level[c] + height * normal[c]));
    let position = scaled(direction(random), 0.5);
    SphereSight {
        position: position.map(|c| c as f32),
        normal: normal.map(|c| c as f32),
        centre: [0, 1, 2].map(|c| (position[c] + to_centre[c]) as f32),
        radius: (sine * distance) as f32,
    }
}
