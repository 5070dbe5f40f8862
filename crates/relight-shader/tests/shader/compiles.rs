//! Every include is accepted by a compiler of its language: naga for WGSL, Khronos's glslang (Debian's
//! glslang-tools) for GLSL and, by its HLSL front end, for HLSL.

use crate::lopsided::{bases, layouts_of, model, packings};
use relight_core::Model;
use relight_shader::{Language, ShaderOptions, shader};
use relight_texture::Packing;
use std::fmt::Write as _;
use std::process::Command;

/// Includes of every basis, layout and packing in `language`; passes in every other one.
fn sources(counts: &[usize], language: Language) -> Vec<(String, Model, Packing, Option<usize>)> {
    let mut all = Vec::new();
    for basis in bases(counts) {
        for &layout in layouts_of(&basis) {
            let model = model(&basis, layout);
            for packing in packings(&model) {
                let maps_per_pass = if all.len().is_multiple_of(2) { Some(all.len() % 5) } else { None };
                let options = ShaderOptions { language, maps_per_pass };
                all.push((
                    shader(&model, &packing, 640, 480, &options),
                    model.clone(),
                    packing,
                    maps_per_pass,
                ));
            }
        }
    }
    all
}

pub(crate) fn validated(source: &str) -> naga::Module {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{}\n{source}", error.emit_to_string(source)));
    let flags = naga::valid::ValidationFlags::all();
    let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
    validator.validate(&module).unwrap_or_else(|error| panic!("{}\n{source}", error.emit_to_string(source)));
    module
}

/// The constant that counts the weights, and the texture of learned functions as a further argument.
fn words_of(model: &Model) -> (&'static str, &'static str) {
    match model.layout {
        relight_core::Layout::Shared => ("RELIGHT_WEIGHTS", ", functions"),
        _ => ("RELIGHT_LAYERS", ""),
    }
}

/// `maps_0, maps_1`.
fn arguments(packing: &Packing) -> String {
    (0..packing.arrays.len()).map(|array| format!("maps_{array}")).collect::<Vec<_>>().join(", ")
}

#[test]
fn naga_accepts_wgsl() {
    for (mut source, model, packing, maps_per_pass) in sources(&COUNTS, Language::Wgsl) {
        let maps = arguments(&packing);
        let (count, table) = words_of(&model);
        if !table.is_empty() {
            source += "@group(1) @binding(2) var functions: texture_2d_array<f32>;\n";
        }
        for array in 0..packing.arrays.len() {
            writeln!(source, "@group(0) @binding({array}) var maps_{array}: texture_2d_array<f32>;").unwrap();
        }
        let passes = maps_per_pass.map_or(String::new(), |_| {
            let finish = if model.layout == relight_core::Layout::Lrgb {
                format!("color = relight_sample_finish(color, {maps}, linear, at.xy);")
            } else {
                String::new()
            };
            format!(
                "color += relight_sample_pass(RELIGHT_PASSES - 1, weights, {maps}, linear, at.xy); {finish}"
            )
        });
        write!(
            source,
            "@group(1) @binding(0) var linear: sampler;
            @group(1) @binding(1) var<uniform> uniform_weights: array<vec4f, {count}>;
            @fragment fn main(@builtin(position) at: vec4f) -> @location(0) vec4f {{
                let light = relight_point_light(at.xyz, vec3f(1.0, 2.0, 3.0), 0.1);
                let weights = relight_weights(light.xyz{table});
                var color = relight_shade(weights, {maps}, vec2i(at.xy), 0);
                color += relight_sample(uniform_weights, {maps}, linear, at.xy);
                color += relight_sample_level(weights, {maps}, linear, at.xy, 0.5);
                {passes}
                return vec4f(relight_to_linear(color) + relight_to_encoded(color), 1.0);
            }}"
        )
        .unwrap();
        validated(&source);
    }
}

/// Whether glslangValidator is there; says so where it is not.
///
/// # Panics
/// Where it is not although RELIGHT_REQUIRE_GLSLANG is 1.
pub(crate) fn glslang_is_there() -> bool {
    let there = Command::new("glslangValidator").arg("--version").output().is_ok();
    if !there {
        let required = std::env::var("RELIGHT_REQUIRE_GLSLANG").is_ok_and(|value| value == "1");
        assert!(!required, "RELIGHT_REQUIRE_GLSLANG=1 but there is no glslangValidator");
        println!("skipped: no glslangValidator (Debian: glslang-tools)");
    }
    there
}

/// Runs glslangValidator on files of these sources, `at_once` a call; panics with its words and the
/// sources that it refuses.
pub(crate) fn glslang(options: &[&str], suffix: &str, sources: &[String], at_once: usize) {
    let folder = tempfile::tempdir().unwrap();
    for of_call in sources.chunks(at_once) {
        let names: Vec<String> = (0..of_call.len()).map(|i| format!("{i}.{suffix}")).collect();
        for (name, source) in names.iter().zip(of_call) {
            std::fs::write(folder.path().join(name), source).unwrap();
        }
        let mut call = Command::new("glslangValidator");
        let output = call.args(options).args(&names).current_dir(folder.path()).output().unwrap();
        let words = String::from_utf8_lossy(&output.stdout);
        let refused = of_call.iter().map(|source| numbered(source)).collect::<String>();
        assert!(output.status.success(), "{refused}\n{words}");
    }
}

fn numbered(source: &str) -> String {
    source.lines().enumerate().map(|(i, line)| format!("{:4} {line}\n", i + 1)).collect()
}

const COUNTS: [usize; 4] = [1, 6, 16, 121];

#[test]
fn glslang_accepts_glsl_of_es_and_of_the_desktop() {
    if !glslang_is_there() {
        return;
    }
    let all = sources(&COUNTS, Language::Glsl);
    for version in ["300 es", "330", "450"] {
        let whole = |(source, model, packing, maps_per_pass): &(String, Model, Packing, Option<usize>)| {
            let maps = arguments(packing);
            let (count, table) = words_of(model);
            let learned = if table.is_empty() { "" } else { "uniform sampler2DArray functions;\n" };
            let textures = (0..packing.arrays.len())
                .map(|array| format!("uniform sampler2DArray maps_{array};\n"))
                .collect::<String>();
            let passes = maps_per_pass.map_or("", |_| {
                if model.layout == relight_core::Layout::Lrgb {
                    "color += relight_shade_pass(1, weights, MAPS, ivec2(at), 0);
                    color = relight_shade_finish(color, MAPS, ivec2(at), 0);"
                } else {
                    "color += relight_shade_pass(1, weights, MAPS, ivec2(at), 0);"
                }
            });
            format!(
                "#version {version}\n{source}\n{textures}{learned}
                uniform vec4 uniform_weights[{count}];
                in vec2 at;
                out vec4 target;
                void main() {{
                    vec4 light = relight_point_light(vec3(at, 0.0), vec3(1.0, 2.0, 3.0), 0.1);
                    vec4 weights[{count}];
                    relight_weights(light.xyz{table}, weights);
                    vec3 color = relight_shade(weights, {maps}, ivec2(at), 0);
                    color += relight_sample(uniform_weights, {maps}, at);
                    color += relight_sample_level(weights, {maps}, at, 0.5);
                    {}
                    target = vec4(relight_to_linear(color) + relight_to_encoded(color), 1.0);
                }}",
                passes.replace("MAPS", &maps)
            )
        };
        glslang(&[], "frag", &all.iter().map(whole).collect::<Vec<_>>(), 20);
    }
}

#[test]
fn glslang_accepts_hlsl() {
    if !glslang_is_there() {
        return;
    }
    let whole = |(source, model, packing, maps_per_pass): (String, Model, Packing, Option<usize>)| {
        let maps = arguments(&packing);
        let (count, table) = words_of(&model);
        let learned =
            if table.is_empty() { "" } else { "Texture2DArray<float4> functions : register(t9);\n" };
        let textures = (0..packing.arrays.len())
            .map(|array| format!("Texture2DArray<float4> maps_{array} : register(t{array});\n"))
            .collect::<String>();
        let passes = maps_per_pass.map_or("", |_| {
            if model.layout == relight_core::Layout::Lrgb {
                "color += relight_shade_pass(1, weights, MAPS, int2(at.xy), 0);
                color = relight_shade_finish(color, MAPS, int2(at.xy), 0);"
            } else {
                "color += relight_shade_pass(1, weights, MAPS, int2(at.xy), 0);"
            }
        });
        format!(
            "{source}\n{textures}{learned}
            SamplerState linear_sampler : register(s0);
            cbuffer Light : register(b0) {{ float4 uniform_weights[{count}]; }};
            float4 main(float4 at : SV_Position) : SV_Target {{
                float4 light = relight_point_light(at.xyz, float3(1.0, 2.0, 3.0), 0.1);
                float4 weights[{count}];
                relight_weights(light.xyz{table}, weights);
                float3 color = relight_shade(weights, {maps}, int2(at.xy), 0);
                color += relight_sample(uniform_weights, {maps}, linear_sampler, at.xy);
                color += relight_sample_level(weights, {maps}, linear_sampler, at.xy, 0.5);
                {}
                return float4(relight_to_linear(color) + relight_to_encoded(color), 1.0);
            }}",
            passes.replace("MAPS", &maps)
        )
    };
    let all: Vec<String> = sources(&COUNTS, Language::Hlsl).into_iter().map(whole).collect();
    // The front end makes SPIR-V or nothing, and would link several files into one program.
    glslang(&["-D", "-V", "-e", "main", "-S", "frag"], "hlsl", &all, 1);
}

#[test]
fn constants_read_back_to_the_bit() {
    let basis = &bases(&[6])[0];
    let model = model(basis, relight_core::Layout::Grey);
    let mut packing = packed_single(&model);
    let hard = [1e30f32, -1e30, 1e-30, f32::MAX, f32::MIN_POSITIVE, 0.1];
    for (quantizer, value) in packing.arrays[0].layers.iter_mut().flat_map(|l| &mut l.quantizers).zip(hard) {
        (quantizer.scale, quantizer.bias) = (value, -value / 3.0);
    }
    let options = ShaderOptions { language: Language::Wgsl, maps_per_pass: None };
    let module = validated(&shader(&model, &packing, 1, 1, &options));
    let number = |name: String| -> f32 {
        let constant = module.constants.iter().find(|(_, c)| c.name.as_ref() == Some(&name)).unwrap().1;
        let naga::Expression::Compose { components, .. } = &module.global_expressions[constant.init] else {
            panic!("{name} is no vector");
        };
        match module.global_expressions[components[0]] {
            naga::Expression::Literal(naga::Literal::F32(value)) => value,
            ref other => panic!("{name} begins with {other:?}"),
        }
    };
    let numbers = |name: &str| [0, 1, 2, 3, 4, 5].map(|layer| number(format!("{name}_{layer}")));
    assert_eq!(numbers("RELIGHT_SCALE"), hard);
    assert_eq!(numbers("RELIGHT_BIAS"), hard.map(|v| if (v / 3.0).is_subnormal() { 0.0 } else { -v / 3.0 }));
}

/// One plane a layer.
fn packed_single(model: &Model) -> Packing {
    crate::lopsided::packed(model, relight_texture::TexelFormat::Block(relight_texture::BlockFormat::Bc4))
}

#[test]
fn without_passes_nothing_is_said_of_them() {
    let basis = &bases(&[6])[0];
    for language in Language::all() {
        let model = model(basis, relight_core::Layout::Lrgb);
        let source = |maps_per_pass| {
            shader(&model, &packed_single(&model), 1, 1, &ShaderOptions { language, maps_per_pass })
        };
        let words = |text: &str| ["_pass", "_PASS", "_finish", "blending"].map(|word| text.contains(word));
        assert_eq!(words(&source(None)), [false; 4]);
        assert_eq!(words(&source(Some(4))), [true; 4]);
        assert_eq!(source(Some(0)), source(Some(1)), "a pass holds at least one map");
    }
}
