//! What the layers of an asset hold, in the form in which shaders sum them.

use crate::language::Type;
use crate::literal::literal;
use crate::source::{Index, Parameter, Source, Takes};
use relight_core::{Layout, Model, PlaneRole};
use relight_texture::{LayerPlan, Packing};
use std::ops::Range;

/// What a layer's planes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Coefficients of functions of light.
    Light,
    /// Factors of the sum.
    BaseColor,
}

/// A layer, by channel of its texels; channels without a plane have a scale and bias of 0.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    pub(crate) part: Part,
    /// How many of the channels hold planes.
    pub(crate) planes: usize,
    /// The function that weighs the channel; of shared planes the first of those that do.
    pub(crate) functions: [usize; 4],
    /// The picture's channel that gains it; 0 for luminance, which all gain.
    pub(crate) channels: [usize; 4],
    pub(crate) scales: [f32; 4],
    pub(crate) biases: [f32; 4],
}

/// How the channels of texels reach the channels of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Route {
    /// So many channels, all to all.
    Luminance(usize),
    /// So many channels, each to all with a weight of its own in each.
    Shared(usize),
    /// Red, green and blue to their like.
    Rgb,
    /// The same, and the fourth to one that a table names.
    RgbAndOther,
    /// So many channels, each to one that a table names.
    Named(usize),
}

/// Layers of one part that follow each other in one array.
#[derive(Clone, Debug)]
pub(crate) struct Run {
    /// Index of the array texture.
    pub(crate) array: usize,
    pub(crate) part: Part,
    pub(crate) route: Route,
    /// Indices over all arrays.
    pub(crate) layers: Range<usize>,
    /// Index over all arrays of the array's first layer.
    pub(crate) array_start: usize,
    /// Number of the first layer among those of its part.
    pub(crate) number: usize,
}

/// All layers of an asset.
#[derive(Clone, Debug)]
pub(crate) struct Layers {
    /// By array, then layer.
    pub(crate) layers: Vec<Layer>,
    pub(crate) runs: Vec<Run>,
    /// Of shared planes.
    pub(crate) shared: Option<Shared>,
}

/// The weights of shared planes: one a channel of each layer's texels, and at the end the mean; red, green
/// and blue in each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shared {
    /// Channels of a layer.
    pub(crate) planes: usize,
    /// How far from red's function green's and blue's are.
    pub(crate) steps: [usize; 3],
}

fn layer(model: &Model, roles: &[PlaneRole], plan: &LayerPlan) -> Layer {
    let mut part = None;
    let (mut functions, mut channels) = ([0; 4], [0; 4]);
    let (mut scales, mut biases) = ([0.0; 4], [0.0; 4]);
    for (c, (plane, quantizer)) in plan.planes.iter().zip(&plan.quantizers).enumerate() {
        let of_plane = match roles[*plane] {
            PlaneRole::Coefficient { functions: by_channel } => {
                let channel = by_channel.iter().position(Option::is_some).unwrap_or(0);
                functions[c] = by_channel[channel].map_or(0, usize::from);
                channels[c] = if model.layout == Layout::Rgb { channel } else { 0 };
                Part::Light
            }
            PlaneRole::BaseColor { channel } => {
                channels[c] = usize::from(channel);
                Part::BaseColor
            }
        };
        assert!(*part.get_or_insert(of_plane) == of_plane, "base colour has layers of its own");
        (scales[c], biases[c]) = (quantizer.scale, quantizer.bias);
    }
    let planes = plan.planes.len();
    Layer { part: part.unwrap_or(Part::Light), planes, functions, channels, scales, biases }
}

/// The least general route that suits all of `layers`.
fn route(layout: Layout, layers: &[Layer]) -> Route {
    let planes = layers.iter().map(|layer| layer.planes).max().unwrap_or(0);
    let in_order = layers.iter().all(|layer| layer.planes >= 3 && layer.channels[..3] == [0, 1, 2]);
    match layers[0].part {
        Part::Light if layout == Layout::Shared => Route::Shared(planes),
        Part::Light if layout != Layout::Rgb => Route::Luminance(planes),
        _ if in_order && planes == 3 => Route::Rgb,
        _ if in_order => Route::RgbAndOther,
        _ => Route::Named(planes),
    }
}

impl Layers {
    /// # Panics
    /// Where a layer names a plane that the model lacks, or mixes coefficients and base colour.
    pub(crate) fn new(model: &Model, packing: &Packing) -> Self {
        let roles = model.roles();
        let (mut layers, mut runs) = (Vec::<Layer>::new(), Vec::<Run>::new());
        let mut numbers = [0; 2];
        for (array, plan) in packing.arrays.iter().enumerate() {
            let array_start = layers.len();
            layers.extend(plan.layers.iter().map(|plan| layer(model, &roles, plan)));
            let mut start = array_start;
            for of_run in layers[array_start..].chunk_by(|a, b| a.part == b.part) {
                let part = of_run[0].part;
                let (route, end) = (route(model.layout, of_run), start + of_run.len());
                let number = numbers[part as usize];
                runs.push(Run { array, part, route, layers: start..end, array_start, number });
                numbers[part as usize] += of_run.len();
                start = end;
            }
        }
        let shared = (model.layout == Layout::Shared).then(|| Shared {
            planes: layers.iter().map(|layer| layer.planes).max().unwrap_or(0),
            steps: if model.channels() == 3 { [0, 1, 2] } else { [0; 3] },
        });
        Self { layers, runs, shared }
    }

    /// Number of weights under a light, and the constant that has it.
    pub(crate) fn weights(&self) -> (usize, &'static str) {
        match self.shared {
            Some(Shared { planes, .. }) => (self.layers.len() * planes + 1, "RELIGHT_WEIGHTS"),
            None => (self.layers.len(), "RELIGHT_LAYERS"),
        }
    }

    pub(crate) fn runs_of(&self, part: Part) -> impl Iterator<Item = &Run> {
        self.runs.iter().filter(move |run| run.part == part)
    }

    /// How many layers hold coefficients of functions of light.
    pub(crate) fn lit(&self) -> usize {
        self.layers.iter().filter(|layer| layer.part == Part::Light).count()
    }

    /// Whether some channel's way has to be looked up.
    pub(crate) fn names_channels(&self) -> bool {
        self.runs.iter().any(|run| matches!(run.route, Route::RgbAndOther | Route::Named(_)))
    }
}

/// Scales, biases and, where it takes one, the channels' ways.
pub(crate) fn tables(source: &mut Source, layers: &Layers) {
    let components = |values: &[f32; 4]| values.map(literal).join(", ");
    if layers.layers.iter().any(|l| l.scales.iter().chain(&l.biases).any(|v| v.is_subnormal())) {
        source.comment("Numbers below 1.2e-38 are written as 0, which GPUs may take them for.");
    }
    source.comment(
        "By layer, over all arrays in turn: coefficient = scale * texel + bias, channel by channel.",
    );
    let rows: Vec<String> = layers.layers.iter().map(|layer| components(&layer.scales)).collect();
    source.table(Type::Float4, "RELIGHT_SCALE", &rows);
    let rows: Vec<String> = layers.layers.iter().map(|layer| components(&layer.biases)).collect();
    source.table(Type::Float4, "RELIGHT_BIAS", &rows);
    if layers.names_channels() && !source.unrolls() {
        source.comment("By layer: the picture's channel that each channel of the texel belongs to.");
        let rows: Vec<String> = layers.layers.iter().map(|layer| integers(&layer.channels)).collect();
        source.table(Type::Int4, "RELIGHT_CHANNEL", &rows);
    }
}

fn integers(values: &[usize; 4]) -> String {
    values.map(|value| value.to_string()).join(", ")
}

/// The name of the texture that holds a table of learned functions.
pub(crate) const TABLE: &str = "functions";

/// `relight_layer_weights` and `relight_weights`.
pub(crate) fn weights(source: &mut Source, layers: &Layers) {
    let made = (Type::Float4, layers.weights().1, "weights");
    match layers.shared {
        Some(shared) => shared_weights(source, layers, shared, made),
        None => layer_weights(source, layers, made),
    }
    source.comment(
        "The same from the unit direction l of a light. They are alike for all texels: work them out\n\
         once a light, in an earlier stage or outside, rather than once a pixel.",
    );
    let mut parameters = vec![Parameter::value("l", Type::Float3)];
    let mut argument = "l".to_owned();
    if layers.shared.is_some() {
        parameters.push(Parameter::new(TABLE, Takes::Texture));
        argument = format!("l, {TABLE}");
    }
    source.array_function(made, "relight_weights", &parameters, |source| {
        source.array(Type::Float, "RELIGHT_FUNCTIONS", "basis");
        source.fill("basis", "relight_basis", &argument);
        source.fill("weights", "relight_layer_weights", "basis");
    });
}

/// `relight_layer_weights` of shared planes.
fn shared_weights(source: &mut Source, layers: &Layers, shared: Shared, made: (Type, &str, &str)) {
    let Shared { planes, steps } = shared;
    if !source.unrolls() {
        source.comment("By layer: the function that weighs each channel of the texel in red.");
        let rows: Vec<String> = layers.layers.iter().map(|layer| integers(&layer.functions)).collect();
        source.table(Type::Int4, "RELIGHT_FUNCTION", &rows);
    }
    source.comment(&format!(
        "The weights from the functions of light: in xyz how channel c of layer i adds to red, green and blue,\n\
         at {planes} * i + c, and at the end the mean, which is added to the sum.",
    ));
    let float4 = source.word(Type::Float4);
    let basis = [Parameter::new("basis", Takes::Array(Type::Float, "RELIGHT_FUNCTIONS"))];
    source.array_function(made, "relight_layer_weights", &basis, |source| {
        source.each_of("layer", 0..layers.layers.len(), |_, layer| {
            let of_channel = |c: usize| {
                let rgb = steps.map(|step| match layer {
                    Index::Number(number) => format!("basis[{}]", layers.layers[number].functions[c] + step),
                    Index::Variable(name) => {
                        format!("basis[RELIGHT_FUNCTION[{name}].{} + {step}]", ["x", "y", "z", "w"][c])
                    }
                });
                format!("weights[{}] = {float4}({}, 0.0);", shared.weight(layer, c), rgb.join(", "))
            };
            (0..planes).map(of_channel).collect()
        });
        let mean = steps.map(|step| format!("basis[{step}]")).join(", ");
        source.line(&format!("weights[{}] = {float4}({mean}, 0.0);", layers.weights().0 - 1));
    });
}

impl Shared {
    /// Where the weight of channel `c` of a layer stands.
    pub(crate) fn weight(self, layer: Index, c: usize) -> String {
        match layer {
            Index::Number(number) => (number * self.planes + c).to_string(),
            Index::Variable(name) => format!("{name} * {} + {c}", self.planes),
        }
    }
}

/// `relight_layer_weights` of planes that one function weighs.
fn layer_weights(source: &mut Source, layers: &Layers, made: (Type, &str, &str)) {
    let one_function = layers.layers.iter().all(|layer| {
        let of_planes = &layer.functions[..layer.planes];
        of_planes.iter().all(|function| *function == of_planes[0])
    });
    let in_order =
        layers.layers.iter().enumerate().all(|(i, l)| l.part == Part::Light && l.functions[0] == i);
    let as_numbered = one_function && in_order;
    let table = !source.unrolls() && !as_numbered;
    if table && one_function {
        source.comment("By layer: the function that weighs it, 0 for base colour, which none does.");
        let rows: Vec<String> = layers.layers.iter().map(|layer| layer.functions[0].to_string()).collect();
        source.table(Type::Int, "RELIGHT_FUNCTION", &rows);
    } else if table {
        source.comment("By layer: the function that weighs each channel of the texel, 0 where none does.");
        let rows: Vec<String> = layers.layers.iter().map(|layer| integers(&layer.functions)).collect();
        source.table(Type::Int4, "RELIGHT_FUNCTION", &rows);
    }
    source.comment("The weight of each layer's channels, from the functions of light.");
    let basis = [Parameter::new("basis", Takes::Array(Type::Float, "RELIGHT_FUNCTIONS"))];
    source.array_function(made, "relight_layer_weights", &basis, |source| {
        source.each_of("layer", 0..layers.layers.len(), |source, layer| {
            let float4 = source.word(Type::Float4);
            let functions = match layer {
                Index::Number(number) => layers.layers[number].functions.map(|f| f.to_string()),
                Index::Variable(name) if !table => [(); 4].map(|()| name.to_owned()),
                Index::Variable(name) if one_function => {
                    [(); 4].map(|()| format!("RELIGHT_FUNCTION[{name}]"))
                }
                Index::Variable(name) => {
                    ["x", "y", "z", "w"].map(|c| format!("RELIGHT_FUNCTION[{name}].{c}"))
                }
            };
            let functions = functions.map(|function| format!("basis[{function}]"));
            vec![format!("weights[{layer}] = {float4}({});", functions.join(", "))]
        });
    });
}
