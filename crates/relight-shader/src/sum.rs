//! The sum over the layers of an asset, by texel and by sampler, whole and in passes.

use crate::Language;
use crate::language::Type;
use crate::layers::{Layers, Part, Route, Run};
use crate::source::{Index, Parameter, Source, Takes};
use relight_core::{Layout, Model};

/// How a function reads the maps.
#[derive(Clone, Copy, Debug)]
enum Reads {
    /// A texel of a level by its column and row.
    Texel,
    /// A sampler at a place, the level by how fast the place changes.
    Sampler,
    /// A sampler at a place of a level.
    SamplerAtLevel,
}

impl Reads {
    const ALL: [Self; 3] = [Self::Texel, Self::Sampler, Self::SamplerAtLevel];

    fn function(self) -> &'static str {
        match self {
            Self::Texel => "relight_shade",
            Self::Sampler => "relight_sample",
            Self::SamplerAtLevel => "relight_sample_level",
        }
    }

    fn about(self) -> &'static str {
        match self {
            Self::Texel => "at a texel (column, row from the top) of a mip level",
            Self::Sampler => {
                "through a sampler at uv ((0, 0) is the\n\
                 top left corner, (1, 1) the bottom right); for fragment shaders, in uniform control flow"
            }
            Self::SamplerAtLevel => "through a sampler at uv of a mip level, for any stage",
        }
    }

    fn parameters(self) -> Vec<Parameter> {
        let sampler = Parameter::new("maps_sampler", Takes::Sampler);
        let uv = Parameter::value("uv", Type::Float2);
        match self {
            Self::Texel => vec![Parameter::value("texel", Type::Int2), Parameter::value("level", Type::Int)],
            Self::Sampler => vec![sampler, uv],
            Self::SamplerAtLevel => vec![sampler, uv, Parameter::value("level", Type::Float)],
        }
    }

    /// The texel of `layer` of an array texture.
    fn read(self, language: Language, maps: &str, layer: &str) -> String {
        match (self, language) {
            (Self::Texel, Language::Wgsl) => format!("textureLoad({maps}, texel, {layer}, level)"),
            (Self::Texel, Language::Glsl) => format!("texelFetch({maps}, ivec3(texel, {layer}), level)"),
            (Self::Texel, Language::Hlsl) => format!("{maps}.Load(int4(texel, {layer}, level))"),
            (Self::Sampler, Language::Wgsl) => format!("textureSample({maps}, maps_sampler, uv, {layer})"),
            (Self::Sampler, Language::Glsl) => format!("texture({maps}, vec3(uv, float({layer})))"),
            (Self::Sampler, Language::Hlsl) => {
                format!("{maps}.Sample(maps_sampler, float3(uv, float({layer})))")
            }
            (Self::SamplerAtLevel, Language::Wgsl) => {
                format!("textureSampleLevel({maps}, maps_sampler, uv, {layer}, level)")
            }
            (Self::SamplerAtLevel, Language::Glsl) => {
                format!("textureLod({maps}, vec3(uv, float({layer})), level)")
            }
            (Self::SamplerAtLevel, Language::Hlsl) => {
                format!("{maps}.SampleLevel(maps_sampler, float3(uv, float({layer})), level)")
            }
        }
    }
}

/// The functions that sum.
pub(crate) fn write(source: &mut Source, model: &Model, layers: &Layers, maps_per_pass: Option<usize>) {
    if layers.names_channels() {
        in_channel(source);
    }
    for reads in Reads::ALL {
        source.comment(&format!("The color under the light of `weights`, {}.", reads.about()));
        let parameters = parameters(layers, reads, &[weights_parameter(layers)]);
        source.function(Type::Float3, reads.function(), &parameters, |source| {
            let sum = sum_of(source, model, layers, Part::Light, reads, None);
            match model.layout {
                Layout::Rgb => source.line(&format!("return {sum};")),
                Layout::Shared => source.line(&format!("return {sum} + {};", mean(layers))),
                Layout::Grey => source.line(&format!("return {};", all_channels(source, sum))),
                Layout::Lrgb => {
                    let base = sum_of(source, model, layers, Part::BaseColor, reads, None);
                    source.line(&format!("return {sum} * {base};"));
                }
            }
        });
    }
    if let Some(maps) = maps_per_pass {
        passes(source, model, layers, maps.max(1));
    }
}

fn weights_parameter(layers: &Layers) -> Parameter {
    Parameter::new("weights", Takes::Array(Type::Float4, layers.weights().1))
}

/// What shared planes' sum lacks.
fn mean(layers: &Layers) -> String {
    format!("weights[{}].xyz", layers.weights().0 - 1)
}

/// `before`, the array textures, and what `reads` wants.
fn parameters(layers: &Layers, reads: Reads, before: &[Parameter]) -> Vec<Parameter> {
    let arrays = layers.runs.last().map_or(0, |run| run.array + 1);
    let maps = (0..arrays).map(|array| Parameter::new(format!("maps_{array}"), Takes::Texture));
    before.iter().cloned().chain(maps).chain(reads.parameters()).collect()
}

fn all_channels(source: &Source, value: &str) -> String {
    format!("{}({value}, {value}, {value})", source.word(Type::Float3))
}

/// Writes the sum over the layers of a part, by array, then layer, then channel, all of them or,
/// with so many a pass, those of pass `pass_index`; returns its name.
fn sum_of(
    source: &mut Source,
    model: &Model,
    layers: &Layers,
    part: Part,
    reads: Reads,
    in_pass: Option<usize>,
) -> &'static str {
    let name = match part {
        Part::BaseColor => "base_color",
        Part::Light if matches!(model.layout, Layout::Rgb | Layout::Shared) => "color",
        Part::Light => "luminance",
    };
    if name == "luminance" {
        source.variable(Type::Float, name, "0.0");
    } else {
        source.variable(Type::Float3, name, &all_channels(source, "0.0"));
    }
    for run in layers.runs_of(part) {
        add_run(source, layers, run, reads, name, in_pass);
    }
    name
}

/// Adds the products of a run's layers to `sum`, one by one; with `in_pass` layers a pass those of pass
/// `pass_index` alone.
fn add_run(source: &mut Source, layers: &Layers, run: &Run, reads: Reads, sum: &str, in_pass: Option<usize>) {
    let maps = format!("maps_{}", run.array);
    source.each_of("layer", run.layers.clone(), |source, layer| {
        let q = reads.read(source.language, &maps, &layer.minus(run.array_start));
        let [scale, bias] = ["RELIGHT_SCALE", "RELIGHT_BIAS"].map(|table| source.element(table, layer));
        let coefficient = format!("{scale} * {q} + {bias}");
        let product = match run.part {
            Part::Light if layers.shared.is_some() => coefficient,
            Part::Light => format!("weights[{layer}] * ({coefficient})"),
            Part::BaseColor => coefficient,
        };
        let components = ["x", "y", "z", "w"];
        let named = |c: usize| {
            let channel = match layer {
                Index::Number(number) => layers.layers[number].channels[c].to_string(),
                Index::Variable(name) => format!("RELIGHT_CHANNEL[{name}].{}", components[c]),
            };
            format!("relight_in_channel(p.{}, {channel})", components[c])
        };
        let terms: Vec<String> = match run.route {
            Route::Shared(planes) => {
                let weight = |c| layers.shared.map_or(String::new(), |shared| shared.weight(layer, c));
                (0..planes).map(|c| format!("weights[{}].xyz * p.{}", weight(c), components[c])).collect()
            }
            Route::Luminance(planes) => components[..planes].iter().map(|c| format!("p.{c}")).collect(),
            Route::Rgb => vec!["p.xyz".to_owned()],
            Route::RgbAndOther => vec!["p.xyz".to_owned(), named(3)],
            Route::Named(planes) => (0..planes).map(named).collect(),
        };
        let product = source.value_statement(Type::Float4, "p", &product);
        let add = format!("{sum} = {sum} + {};", terms.join(" + "));
        let Some(maps) = in_pass else {
            return vec![product, add];
        };
        let not_lit = run.layers.start - run.number;
        let pass = match layer {
            Index::Number(index) => ((index - not_lit) / maps).to_string(),
            Index::Variable(_) => format!("{} / RELIGHT_MAPS_PER_PASS", layer.minus(not_lit)),
        };
        vec![format!("if (pass_index == {pass}) {{ {product} {add} }}")]
    });
}

fn in_channel(source: &mut Source) {
    source.comment("A value in channel 0, 1 or 2 of a color that is otherwise black.");
    let parameters = [Parameter::value("value", Type::Float), Parameter::value("channel", Type::Int)];
    source.function(Type::Float3, "relight_in_channel", &parameters, |source| {
        let channels = [0, 1, 2].map(|c| source.choice(&format!("channel == {c}"), "value", "0.0"));
        source.line(&format!("return {}({});", source.word(Type::Float3), channels.join(", ")));
    });
}

/// Sums of `maps` layers at a time, and the factor at the end.
fn passes(source: &mut Source, model: &Model, layers: &Layers, maps: usize) {
    let has_base_color = model.layout == Layout::Lrgb;
    source.comment(&format!(
        "In passes, where one shader can't read all maps: draw RELIGHT_PASSES times into a float target\n\
         that was cleared to 0, with additive blending (one, one). Each pass adds the terms of its own\n\
         RELIGHT_MAPS_PER_PASS layers, bias included; terms may be negative, which a target of 8 bits\n\
         would clip. {}\n\
         Source: Wong, Leung, Choy, Lighting Precomputation Using the Relighting Map.",
        if has_base_color {
            "A _finish function makes the color of the sum, once."
        } else {
            "The sum is the color."
        }
    ));
    source.constant(Type::Int, "RELIGHT_MAPS_PER_PASS", &maps.to_string());
    source.constant(Type::Int, "RELIGHT_PASSES", &layers.lit().div_ceil(maps).to_string());
    let before = [Parameter::value("pass_index", Type::Int), weights_parameter(layers)];
    for reads in Reads::ALL {
        source.comment(&format!("The terms of pass 0 .. RELIGHT_PASSES - 1, {}.", reads.about()));
        let (parameters, name) = (parameters(layers, reads, &before), format!("{}_pass", reads.function()));
        source.function(Type::Float3, &name, &parameters, |source| {
            let sum = sum_of(source, model, layers, Part::Light, reads, Some(maps));
            if model.layout == Layout::Shared {
                source.line(&format!("if (pass_index == 0) {{ {sum} = {sum} + {}; }}", mean(layers)));
            }
            let sum = if sum == "luminance" { all_channels(source, sum) } else { sum.to_owned() };
            source.line(&format!("return {sum};"));
        });
    }
    for reads in Reads::ALL.into_iter().filter(|_| has_base_color) {
        source.comment(&format!("The color from the sum of all passes, {}.", reads.about()));
        let parameters = parameters(layers, reads, &[Parameter::value("sum", Type::Float3)]);
        source.function(Type::Float3, &format!("{}_finish", reads.function()), &parameters, |source| {
            let base = sum_of(source, model, layers, Part::BaseColor, reads, None);
            source.line(&format!("return sum * {base};"));
        });
    }
}
