//! `relight convert`: an asset in, another out.

mod loss;
mod target;

use crate::bake::Color;
use crate::bake::textures::{Plan, TextureOptions, Trial, distributions, size_note};
use crate::depfile::BuildOptions;
use crate::failure::{Exit, Failure};
use crate::function_options::FunctionOptions;
use crate::options::{MachineOptions, check_apart};
use crate::say::{self, say};
use crate::{interrupt, notes, progress};
use clap::Args;
use loss::Loss;
use relight_core::{Basis, CoefficientSpan, Layout, Model, RelightingMaps, Texels};
use relight_fit::{Refit, WORST_CONDITION, for_each_span, span_bytes};
use relight_formats::asset::AssetSummary;
use relight_formats::{
    AssetFormat, AssetHeader, AssetPlan, AssetPositions, Parts, read_asset, read_positions, summarize_asset,
};
use relight_texture::{
    PackReport, Precision, Quantizer, TexelFormat, needs_rows, span_pixels, working_bytes,
};
use serde_json::{Value, json};
use std::path::PathBuf;
use target::{Way, choose, way};

/// What to convert, and to what.
#[derive(Args, Debug)]
pub(crate) struct ConvertArguments {
    /// The asset: .ktx2, .dds, .exr, .ptm, .rti or a .web folder
    input: PathBuf,
    /// The asset to write: .ktx2, .dds, .exr, .ptm, .rti, or .web for a folder
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Family of functions: ptm, sh, hsh, srbf, or pca; the asset's own where the output holds it, else the nearest
    #[arg(long, value_name = "NAME")]
    basis: Option<String>,
    #[command(flatten)]
    functions: FunctionOptions,
    /// Three planes a function, or luminance planes and a base colour; of pca: planes of any colour, or of
    /// luminance or chrominance each
    #[arg(long, value_name = "COLOR", value_enum)]
    color: Option<Color>,
    /// Store so many planes instead of all coefficients of ptm, sh, hsh or srbf: those that carry most of them
    #[arg(long, value_name = "N", value_parser = crate::function_options::size_of, allow_negative_numbers = true)]
    planes: Option<usize>,
    /// How strongly new coefficients are held small, 0 to 1 [default: 0 for floats, else 1e-6]
    #[arg(long, value_name = "RIDGE", value_parser = ridge_of, allow_negative_numbers = true)]
    ridge: Option<f64>,
    #[command(flatten)]
    textures: TextureOptions,
    /// Print JSON instead of lines
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    build: BuildOptions,
    #[command(flatten)]
    machine: MachineOptions,
}

/// Ridge of a refit to codes: what functions tell apart by a thousandth only is given up rather than stored in
/// large coefficients that cancel one another.
const RIDGE_OF_CODES: f64 = 1e-6;

fn ridge_of(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(ridge) if (0.0..=1.0).contains(&ridge) => Ok(ridge),
        _ => Err("write a number from 0 to 1".to_owned()),
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &ConvertArguments) -> Result<(), Failure> {
    let ConvertArguments { input, output, textures, .. } = arguments;
    let machine = arguments.machine.machine()?;
    let format = AssetFormat::by_path(output).map_err(Failure::of_output)?;
    format.check_writable(output).map_err(Failure::of_output)?;
    let settings = textures.settings(machine.memory)?;
    let source = summarize_asset(input)?;
    let inputs: Vec<PathBuf> = source.files.iter().chain([input]).cloned().collect();
    check_apart([output], &inputs)?;
    let depfile = arguments.build.depfile(output, &source.files)?;

    let AssetHeader { width, height, model: from, packing } = &source.header;
    let (width, height) = (*width, *height);
    let usual = usual_precision(format, packing.formats());
    let levels = textures.levels(width, height);
    let formats_of = |layout| textures.formats(usual, format, layout);
    let check = |model: &Model| {
        // Options that exclude each other were found before.
        let formats = formats_of(model.layout).unwrap_or_default();
        format.check(output, &AssetPlan { width, height, model, formats: &formats, levels }, &settings)
    };
    formats_of(from.layout)?;
    let target = choose(arguments, from, check)?;
    let mut model = target.model(from)?;
    let formats = formats_of(target.layout)?;
    let mut told = losses_beside(&source, format, textures.levels(width, height));
    if arguments.build.is_dry_run() {
        let plan = textures.plan(&model, (width, height), &formats, &[], None)?;
        let positions = source.positions.is_some() && !format.positions.is_empty();
        let parts = Parts { split: settings.split, positions };
        let outputs = format.outputs(output, &plan.packing, parts).map_err(Failure::of_output)?;
        arguments.build.say_files(&source.files, &outputs);
        return Ok(());
    }

    let maps = read_asset(input, machine.memory)?;
    let positions = match source.positions.as_ref().filter(|_| !format.positions.is_empty()) {
        None => None,
        Some(plan) => {
            let held = format.positions.contains(&plan.precision);
            let precision = if held { plan.precision } else { format.positions[0] };
            let room = machine.memory.saturating_sub(maps.texel_bytes());
            read_positions(input, room)?.map(|map| AssetPositions { map, precision })
        }
    };
    let span = span_pixels(width, needs_rows(formats.iter().copied(), levels));
    let needed = {
        let plan = AssetPlan { width, height, model: &model, formats: &formats, levels };
        let working = working_bytes(formats.iter().copied(), model.plane_count(), span);
        let a_thread = span_bytes(maps.planes.len(), model.maps(), span) + working;
        let spans = machine.threads as u64 * a_thread;
        let points = positions.as_ref().map_or(0, |positions| size_of_val(&positions.map.points[..]));
        let writing = format.held_bytes(&plan, &settings).saturating_add(spans).saturating_add(points as u64);
        // What was written is read again, and relit beside the input.
        let plane = (width * height) as u64;
        let comparing = plane * 4 * model.plane_count() as u64 + plane * 4 * 6;
        maps.texel_bytes().saturating_add(writing.max(comparing))
    };
    if needed > machine.memory {
        let [needed, memory] = [needed, machine.memory].map(|bytes| bytes.div_ceil(1 << 20));
        let message = format!(
            "{}: converting it takes {needed} MiB, more than the {memory} MiB allowed; raise --memory",
            input.display()
        );
        return Err(Failure::new(Exit::OverBudget, message));
    }

    let coded = formats.iter().any(|&texels| format.needs_ranges(texels));
    let ridge = arguments.ridge.unwrap_or(if coded { RIDGE_OF_CODES } else { 0.0 });
    let (way, stack) = way(arguments, &maps, &target, ridge, &machine)?;
    model.basis = way.basis();
    if way.condition() > WORST_CONDITION {
        told.push(format!(
            "{} is hardly determined over these directions (condition {:.1e}): coefficients are large; take fewer \
             functions, or --ridge",
            words_of_basis(&model),
            way.condition()
        ));
    }
    let distributions = match coded {
        true => distributions(&*stack, way.pixel_fit(), machine.level)?,
        false => Vec::new(),
    };
    let trial = match textures.tries() {
        true => {
            let left_out = from.figures.map(|figures| figures.leave_one_out_rmse).into_iter().collect();
            Some(Trial::of(&*stack, way.pixel_fit(), machine.level, left_out)?)
        }
        false => None,
    };
    let mut plan = textures.plan(&model, (width, height), &formats, &distributions, trial.as_ref())?;
    if textures.wrap().is_none() {
        plan.packing.wrap = packing.wrap;
    }
    if let Way::Planes(refit) = &way
        && refit.keeps_planes(from)
        && textures.has_usual_ranges()
    {
        keep_codes(&mut plan, &maps);
    }
    told.extend(size_note(&plan.packing, width, height));
    let header = AssetHeader { width, height, model: model.clone(), packing: plan.packing.clone() };
    let parts = Parts { split: settings.split, positions: positions.is_some() };
    let outputs = format.outputs(output, &plan.packing, parts).map_err(Failure::of_output)?;
    check_apart(&outputs, &inputs)?;
    let writer = format.create_with_positions(output, header, &settings, positions)?;
    let bar = progress::bar("converting", stack.pixels());
    for_each_span::<Failure>(&*stack, way.pixel_fit(), machine.level, span, |span: &CoefficientSpan<'_>| {
        interrupt::check()?;
        writer.write(span)?;
        bar.inc(span.pixels as u64);
        Ok(())
    })?;
    let packed = writer.finish()?;
    bar.finish_and_clear();
    drop(stack);

    let written = read_asset(output, machine.memory.saturating_sub(maps.texel_bytes()))?;
    let loss = Loss::of(&maps, &written, Refit::domain(from, &model.basis), &machine)?;
    let done = Done { arguments, from, to: &model, plan: &plan, way: &way, packed: &packed, loss: &loss };
    notes::print(&told);
    if arguments.json {
        say::json(&done.to_json(&told));
    } else {
        done.print();
    }
    depfile.map_or(Ok(()), |depfile| depfile.write())
}

/// The precision of an asset's texels where `format` has it, else its own first; blocks count as what they are
/// decoded to.
fn usual_precision(format: &AssetFormat, mut texels: impl Iterator<Item = TexelFormat>) -> Precision {
    let own = texels.next().map(TexelFormat::decoded_precision);
    own.filter(|precision| format.precisions.contains(precision)).unwrap_or(format.precisions[0])
}

/// Sentences on what `source` has and a file of `format` with `levels` mip levels will not have.
fn losses_beside(source: &AssetSummary, format: &AssetFormat, levels: usize) -> Vec<String> {
    let mut told = Vec::new();
    let had = source.header.packing.levels;
    if had > 1 && levels == 1 {
        let remedy = if format.textures {
            "give --mips to make them again"
        } else {
            "write .ktx2 or .dds with --mips"
        };
        told.push(format!("its {had} mip levels are left out; {remedy}"));
    }
    if source.positions.is_some() && format.positions.is_empty() {
        told.push(format!(
            "its positions are left out: {} holds none; write .ktx2, .dds or .exr",
            format.name
        ));
    }
    told
}

/// Planes of codes that go to codes of the same kind keep their scale and bias, and so their codes.
fn keep_codes(plan: &mut Plan, maps: &RelightingMaps) {
    let codes = |format| matches!(format, TexelFormat::Plain { precision: Precision::U8, .. });
    for array in plan.packing.arrays.iter_mut().filter(|array| codes(array.format)) {
        for layer in &mut array.layers {
            for (quantizer, &plane) in layer.quantizers.iter_mut().zip(&layer.planes) {
                let plane = &maps.planes[plane];
                if let Texels::U8(_) = plane.texels {
                    *quantizer = Quantizer { scale: plane.scale, bias: plane.bias };
                }
            }
        }
    }
}

/// What was done.
struct Done<'a> {
    arguments: &'a ConvertArguments,
    from: &'a Model,
    to: &'a Model,
    plan: &'a Plan,
    way: &'a Way,
    packed: &'a PackReport,
    loss: &'a Loss,
}

impl Done<'_> {
    fn print(&self) {
        let Self { arguments, from, to, way, .. } = self;
        say!(
            "{}: {}, {}, from {}, {}: {}",
            arguments.output.display(),
            words_of_basis(to),
            self.format_names(),
            arguments.input.display(),
            words_of_basis(from),
            way.words(from),
        );
        say!("{}", self.loss.words());
        if self.packed.relit_rmse > 0.0 {
            say!("of that by storing: RMS {:.3} of 255", self.packed.relit_rmse * 255.0);
        }
    }

    fn format_names(&self) -> String {
        self.plan.packing.format_names().join(" and ")
    }

    fn to_json(&self, told: &[String]) -> Value {
        let Self { arguments, from, to, way, packed, loss, .. } = self;
        let model = |model: &Model| {
            json!({
                "family": model.basis.family().name,
                "maps": model.maps(),
                "layout": model.layout,
                "space": model.space,
            })
        };
        json!({
            "relight": env!("CARGO_PKG_VERSION"),
            "input": arguments.input.to_string_lossy(),
            "output": arguments.output.to_string_lossy(),
            "from": model(from),
            "to": model(to),
            "precision": self.format_names(),
            "way": way.words(from),
            "condition": Some(way.condition()).filter(|condition| condition.is_finite()),
            "storing_rmse": packed.relit_rmse,
            "loss": loss.to_json(),
            "notes": told,
        })
    }
}

/// A model's functions, layout and space.
fn words_of_basis(model: &Model) -> String {
    let functions = match &model.basis {
        Basis::Learned(learned) => format!("{} in {} planes", learned.origin(), learned.planes()),
        basis => format!("{} with {} functions", basis.family().name, basis.count()),
    };
    let layout = match model.layout {
        Layout::Rgb | Layout::Shared => "",
        Layout::Lrgb => " of luminance",
        Layout::Grey => " of grey",
    };
    let space = format!("{:?}", model.space).to_lowercase();
    format!("{functions}{layout} ({space})")
}
