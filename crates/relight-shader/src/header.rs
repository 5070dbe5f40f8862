//! The comment at the head of the source, and the asset's numbers.

use crate::Language;
use crate::language::Type;
use crate::layers::{Layers, TABLE};
use crate::source::Source;
use relight_core::{Basis, Layout, Model, Space};
use relight_texture::{Packing, TexelFormat, Wrap};

/// Columns of the names of functions before they are cut short.
const NAMED_FUNCTIONS: usize = 60;

fn plural(count: usize, of: &str) -> String {
    format!("{count} {of}{}", if count == 1 { "" } else { "s" })
}

pub(crate) fn comment(
    source: &mut Source,
    model: &Model,
    packing: &Packing,
    layers: &Layers,
    (width, height): (usize, usize),
) {
    let functions: Vec<String> = (0..model.basis.count()).map(|f| model.basis.label(f)).collect();
    let mut functions = functions.join(" ");
    if functions.len() > NAMED_FUNCTIONS {
        functions =
            functions[..NAMED_FUNCTIONS].rsplit_once(' ').map_or("", |(names, _)| names).to_owned() + " ..";
    }
    let layout = match model.layout {
        Layout::Grey => "grey: a plane a function",
        Layout::Rgb => "rgb: three planes a function",
        Layout::Shared => "shared: planes that each serve all channels, and a mean",
        Layout::Lrgb => {
            "lrgb: a plane of luminance a function, and three of base colour that multiply the sum"
        }
    };
    let space = match model.space {
        Space::Encoded => "encoded: shaded colors are sRGB-encoded",
        Space::Linear => "linear: shaded colors are linear light",
    };
    let wrap = match packing.wrap {
        Wrap::Clamp => "clamp to the edge",
        Wrap::Repeat => "repeat",
        Wrap::Mirror => "repeat mirrored",
    };
    let maps: Vec<String> = packing
        .arrays
        .iter()
        .enumerate()
        .map(|(array, plan)| {
            let channels = match plan.format {
                TexelFormat::Plain { channels, .. } => format!(" in {}", plural(channels, "channel")),
                TexelFormat::Block(_) => String::new(),
            };
            let count = plural(plan.layers.len(), "layer");
            format!("        maps_{array}: {count}, {}{channels}", plan.format.name())
        })
        .collect();
    let bind = match source.language {
        Language::Glsl => "a sampler2DArray each; repeat a sampler's filter and wrap on all of them",
        Language::Wgsl | Language::Hlsl => "where a function wants it, one sampler for all",
    };
    source.comment(&format!(
        "Lights an asset of {width} x {height} texels. Written by relight; needs no other source.\n\
         \n\
         Basis   {} of {}: {functions}\n\
         Layout  {layout}\n\
         Space   {space}\n\
         Levels  {}; beyond the edges: {wrap}\n\
         Maps    {} in all, as array textures without sRGB decoding:\n{}\n\
         \n\
         Bind the arrays as you like and pass them as maps_0, maps_1 ..;\n\
         {bind}.\n\
         {}\n\
         \x20   once a light    weights = relight_weights(direction{})\n\
         \x20   once a pixel    color = relight_shade(weights, maps_0 .., texel, level)\n\
         \x20                   or relight_sample(weights, maps_0 .., uv)\n\
         \n\
         The sum runs by array, then layer, then channel: coefficient = scale * texel + bias, then\n\
         sum = sum + weight * coefficient, in this order and unfolded, as the CPU reference does.",
        model.basis.family().name,
        plural(model.basis.count(), "function"),
        plural(packing.levels, "mip level"),
        plural(layers.layers.len(), "layer"),
        maps.join("\n"),
        match &model.basis {
            Basis::Learned(learned) => format!(
                "The functions of light are a table in one more array texture, {TABLE}: {0} x {0} texels of\n\
                 f16, unfiltered (relight shader --table writes it).\n",
                learned.square().nodes
            ),
            _ => String::new(),
        },
        if layers.shared.is_some() { format!(", {TABLE}") } else { String::new() },
    ));
}

pub(crate) fn constants(
    source: &mut Source,
    model: &Model,
    packing: &Packing,
    layers: &Layers,
    (width, height): (usize, usize),
) {
    if source.language == Language::Glsl {
        source.comment("ES has no default for array textures; elsewhere these lines mean nothing.");
        for of in ["float", "int", "sampler2DArray"] {
            source.line(&format!("precision highp {of};"));
        }
    }
    source.line("");
    let (weights, of_weights) = layers.weights();
    for (name, value) in [
        ("RELIGHT_WIDTH", width),
        ("RELIGHT_HEIGHT", height),
        ("RELIGHT_LEVELS", packing.levels),
        ("RELIGHT_FUNCTIONS", model.basis.count()),
        ("RELIGHT_LAYERS", layers.layers.len()),
    ]
    .into_iter()
    .chain(layers.shared.map(|_| (of_weights, weights)))
    {
        source.constant(Type::Int, name, &value.to_string());
    }
}
