//! What the generated WGSL computes on a GPU, against the reference on the CPU.
//!
//! Without an adapter these tests say that they skip; RELIGHT_REQUIRE_GPU=1 makes that a failure.

use crate::gpu::{Gpu, Texture};
use crate::lopsided::{bases, layouts_of, learned, model, packed, packings, quantizer, table_of};
use relight_core::basis::{Kernel, Srbf};
use relight_core::maps::{RelightingMap, RelightingMaps, Texels};
use relight_core::relighter::relight;
use relight_core::{Basis, CpuLevel, Direction, Layout, Model, Space, linear_from_srgb, srgb_from_linear};
use relight_shader::{Language, ShaderOptions, layer_weights, shader, weight_count};
use relight_texture::{BlockFormat, LayerPlan, Packing, Quantizer, TexelFormat};

const WGSL: ShaderOptions = ShaderOptions { language: Language::Wgsl, maps_per_pass: None };

/// Directions as shaders get them: the components are floats, and the reference sees the same.
fn direction(x: f64, y: f64, z: f64) -> ([f32; 3], Direction) {
    let unit = Direction::new(x, y, z).unwrap().components().map(|c| c as f32);
    let [x, y, z] = unit.map(f64::from);
    (unit, Direction::new(x, y, z).unwrap())
}

/// Lights all over the sphere; the poles, the horizon and next to both; every centre of an SRBF, next to
/// it, its opposite and next to that.
fn hard_lights(basis: &Basis) -> Vec<([f32; 3], Direction)> {
    let mut lights = Vec::new();
    let mut state = 7u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1u32 << 23) - 1.0
    };
    while lights.len() < 400 {
        let v = [random(), random(), random()];
        if v.iter().map(|c| c * c).sum::<f64>() > 1e-4 {
            lights.push(direction(v[0], v[1], v[2]));
        }
    }
    for z in [1.0, -1.0] {
        for aside in [0.0, 1e-7, 1e-4, 1e-2] {
            lights.push(direction(aside, -0.3 * aside, z));
        }
    }
    for z in [0.0, 1e-7, -1e-7, 1e-3, -1e-3] {
        for [x, y] in [[1.0, 0.0], [0.0, -1.0], [-0.6, 0.8]] {
            lights.push(direction(x, y, z));
        }
    }
    if let Basis::Srbf(srbf) = basis {
        for centre in srbf.centres() {
            let [x, y, z] = centre.components();
            for sign in [1.0, -1.0] {
                for aside in [0.0, 1e-6, 1e-3, 0.02, 0.1] {
                    lights.push(direction(sign * x + aside, sign * y, sign * z - aside));
                }
            }
        }
    }
    lights
}

/// The declaration of the texture of learned functions at a binding, and the argument that it is.
fn declared_table(model: &Model, binding: usize) -> (String, &'static str) {
    match model.layout {
        Layout::Shared => {
            let text = format!("@group(0) @binding({binding}) var functions: texture_2d_array<f32>;");
            (text, ", functions")
        }
        _ => (String::new(), ""),
    }
}

fn texture_of((nodes, texels): (usize, Vec<[f32; 4]>)) -> Texture {
    Texture { width: nodes, height: nodes, levels: vec![texels] }
}

/// `relight_basis` and `relight_layer_weights` of it at each light: functions, then four a layer.
fn weights_on(gpu: &Gpu, model: &Model, packing: &Packing, lights: &[[f32; 3]]) -> Vec<Vec<f32>> {
    let source = shader(model, packing, 1, 1, &WGSL);
    let (count, count_name) = weight_count(model, packing);
    let table = table_of(&model.basis);
    let (declared, argument) = declared_table(model, 2);
    let source = format!(
        "{source}
        {declared}
        @group(0) @binding(0) var<storage, read> input: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> output: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {{
            if (id.x >= arrayLength(&input)) {{ return; }}
            var basis = relight_basis(input[id.x].xyz{argument});
            var weights = relight_layer_weights(basis);
            var at = i32(id.x) * (RELIGHT_FUNCTIONS + 4 * {count_name});
            for (var i = 0; i < RELIGHT_FUNCTIONS; i++) {{ output[at] = basis[i]; at++; }}
            for (var i = 0; i < {count_name}; i++) {{
                for (var c = 0; c < 4; c++) {{ output[at] = weights[i][c]; at++; }}
            }}
        }}"
    );
    let input: Vec<[f32; 4]> = lights.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
    let each = model.basis.count() + 4 * count;
    let textures: Vec<Texture> = table.into_iter().map(texture_of).collect();
    let output = gpu.compute(&source, &input, &textures, lights.len() * each, lights.len().div_ceil(64));
    output.chunks(each).map(<[f32]>::to_vec).collect()
}

/// The largest difference between `relight_basis` and the reference, relative where they exceed 1, and
/// where it is.
fn worst_error(gpu: &Gpu, basis: &Basis, lights: &[([f32; 3], Direction)]) -> (f64, String) {
    let layout = *layouts_of(basis).iter().find(|layout| **layout != Layout::Grey).unwrap();
    let model = model(basis, layout);
    let packing = packed(&model, TexelFormat::Block(BlockFormat::Bc3));
    let floats: Vec<[f32; 3]> = lights.iter().map(|light| light.0).collect();
    let mut worst = (0.0f64, String::new());
    for (got, (float, light)) in weights_on(gpu, &model, &packing, &floats).iter().zip(lights) {
        let mut expected = vec![0.0; basis.count()];
        basis.evaluate(*light, &mut expected);
        let (functions, layers) = got.split_at(basis.count());
        for (j, (got, expected)) in functions.iter().zip(&expected).enumerate() {
            let error = (f64::from(*got) - expected).abs() / expected.abs().max(1.0);
            assert!(error.is_finite(), "{} at {float:?}: {got}", basis.label(j));
            if error > worst.0 {
                worst = (error, format!("{} at {float:?}: {got} for {expected}", basis.label(j)));
            }
        }
        let functions: Vec<f64> = functions.iter().map(|&weight| f64::from(weight)).collect();
        let weights = layer_weights(&model, &packing, &functions).concat();
        assert_eq!(layers, weights, "layers are weighed by these functions, bit for bit");
    }
    worst
}

#[test]
fn weights_are_the_reference_s_to_2e_6() {
    let Some(gpu) = Gpu::for_tests() else { return };
    // Of the large ones one each: drivers take seconds to compile them.
    let large = bases(&[121]).into_iter().take(2);
    for basis in bases(&[1, 4, 6, 9, 10, 15, 16, 25, 36]).into_iter().chain(large) {
        let worst = worst_error(&gpu, &basis, &hard_lights(&basis));
        println!("{} {}: {:.2e} ({})", basis.family().name, basis.count(), worst.0, worst.1);

        assert!(worst.0 <= 2e-6, "{} of {}: {}", basis.family().name, basis.count(), worst.1);
    }
}

/// Asks for more than a driver's `acos`, `asin` or a cosine minus 1 would give.
#[test]
fn narrow_gaussians_keep_the_digits_that_their_centres_have() {
    let Some(gpu) = Gpu::for_tests() else { return };
    for (kernel, spread, bound) in [
        (Kernel::Geodesic, 0.1, 1e-6),
        (Kernel::Geodesic, 0.02, 5e-6),
        (Kernel::Spherical, 0.1, 1e-6),
        (Kernel::Spherical, 0.02, 5e-6),
        (Kernel::Geodesic, 10.0, 1e-6),
        (Kernel::Spherical, 10.0, 1e-6),
    ] {
        let centres =
            (0..12).map(|i| direction(lopsided_number(i), 0.3 - 0.1 * f64::from(i), 0.8).1).collect();
        let basis = Basis::Srbf(Srbf::new(centres, spread, kernel).unwrap());
        let worst = worst_error(&gpu, &basis, &hard_lights(&basis));
        println!("{kernel:?} of {spread} rad: {:.2e} ({})", worst.0, worst.1);
        assert!(worst.0 <= bound, "{kernel:?} of {spread} rad: {}", worst.1);
    }
}

/// A lopsided number in -1..1.
fn lopsided_number(i: i32) -> f64 {
    f64::from((i * 37) % 101) / 50.5 - 1.0
}

/// Texels q of every plane that differ from each other, levels halving: plane, then level.
fn texels(model: &Model, width: usize, height: usize, levels: usize) -> Vec<Vec<Vec<f32>>> {
    let level = |plane: usize, level: usize| {
        let size = (width >> level).max(1) * (height >> level).max(1);
        (0..size).map(|x| ((x * 7 + plane * 31 + level * 57) % 251) as f32 / 250.0).collect()
    };
    (0..model.plane_count()).map(|plane| (0..levels).map(|l| level(plane, l)).collect()).collect()
}

/// The array textures of `packing`, whatever its formats, as floats: unused channels 0, the fourth 1.
fn textures(packing: &Packing, texels: &[Vec<Vec<f32>>], width: usize, height: usize) -> Vec<Texture> {
    let texture = |layers: &[LayerPlan]| {
        let level = |level: usize| {
            let layer = |layer: &LayerPlan| {
                let texel = |x: usize| {
                    let mut texel = [0.0, 0.0, 0.0, 1.0];
                    for (channel, plane) in texel.iter_mut().zip(&layer.planes) {
                        *channel = texels[*plane][level][x];
                    }
                    texel
                };
                (0..texels[0][level].len()).map(texel).collect::<Vec<_>>()
            };
            layers.iter().flat_map(layer).collect()
        };
        Texture { width, height, levels: (0..packing.levels).map(level).collect() }
    };
    packing.arrays.iter().map(|array| texture(&array.layers)).collect()
}

/// What `expression` makes of each texel of `level`, whose column and row are in `texel`.
fn shaded(
    gpu: &Gpu,
    (source, model, textures): (&str, &Model, &[Texture]),
    light: [f32; 3],
    (width, height, level): (usize, usize, usize),
    expression: &str,
) -> Vec<f32> {
    let mut source = source.to_owned();
    let learned = usize::from(model.layout == Layout::Shared);
    let arrays = textures.len() - learned;
    let (declared, argument) = declared_table(model, arrays + 2);
    source += &declared;
    for array in 0..arrays {
        let binding = array + 2;
        source += &format!("@group(0) @binding({binding}) var maps_{array}: texture_2d_array<f32>;\n");
    }
    let maps = (0..arrays).map(|array| format!("maps_{array}")).collect::<Vec<_>>().join(", ");
    let expression = expression.replace("MAPS", &maps);
    let binding = textures.len() + 2;
    source += &format!(
        "@group(0) @binding({binding}) var nearest: sampler;
        @group(0) @binding(0) var<storage, read> input: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> output: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {{
            let weights = relight_weights(input[0].xyz{argument});
            let texel = vec2i(i32(id.x) % {width}, i32(id.x) / {width});
            if (texel.y >= {height}) {{ return; }}
            let uv = (vec2f(texel) + 0.5) / vec2f({width}.0, {height}.0);
            let level = {level};
            {expression}
            output[3u * id.x] = color.x; output[3u * id.x + 1u] = color.y; output[3u * id.x + 2u] = color.z;
        }}"
    );
    let [x, y, z] = light;
    let pixels = width * height;
    gpu.compute(&source, &[[x, y, z, 0.0]], textures, 3 * pixels, pixels.div_ceil(64))
}

#[test]
fn shaded_texels_are_the_reference_s_to_1e_5_in_every_packing_by_texel_sampler_and_pass() {
    let Some(gpu) = Gpu::for_tests() else { return };
    let (width, height) = (13, 7);
    let mut worst = 0.0f32;
    // Five functions leave a remainder in every format.
    let learned =
        [(6, 1, true), (5, 3, true), (4, 3, false)].map(|(k, channels, half)| learned(k, channels, half));
    for basis in [bases(&[10]).swap_remove(0), bases(&[5]).swap_remove(0)].into_iter().chain(learned) {
        for &layout in layouts_of(&basis) {
            let model = model(&basis, layout);
            for packing in packings(&model) {
                let q = texels(&model, width, height, packing.levels);
                let mut textures = textures(&packing, &q, width, height);
                textures.extend(table_of(&basis).map(texture_of));
                let options = ShaderOptions { maps_per_pass: Some(2), ..WGSL };
                let source = shader(&model, &packing, width, height, &options);
                let (float, light) = direction(0.3, -0.5, 0.6);
                let level = packing.levels - 1;
                let (width, height) = ((width >> level).max(1), (height >> level).max(1));
                let planes = (0..model.plane_count()).map(|plane| {
                    let Quantizer { scale, bias } = quantizer(plane);
                    RelightingMap { scale, bias, texels: Texels::F32(q[plane][level].clone()) }
                });
                let maps = RelightingMaps { width, height, model: model.clone(), planes: planes.collect() };
                let expected = relight(&maps, light, CpuLevel::BASELINE);
                let finish = if layout == Layout::Lrgb {
                    "color = relight_shade_finish(color, MAPS, texel, level);"
                } else {
                    ""
                };
                for expression in [
                    "let color = relight_shade(weights, MAPS, texel, level);".to_owned(),
                    "let color = relight_sample_level(weights, MAPS, nearest, uv, f32(level));".to_owned(),
                    format!(
                        "var color = vec3f();
                        for (var i = 0; i < RELIGHT_PASSES; i++) {{
                            color += relight_shade_pass(i, weights, MAPS, texel, level);
                        }}
                        {finish}"
                    ),
                ] {
                    let size = (width, height, level);
                    let got = shaded(&gpu, (&source, &model, &textures), float, size, &expression);
                    for (i, got) in got.iter().enumerate() {
                        let expected = expected.samples[i / 3 * expected.channels + i % expected.channels];
                        let error = (got - expected).abs() / expected.abs().max(1.0);
                        let formats: Vec<_> = packing.formats().map(TexelFormat::name).collect();
                        assert!(
                            error <= 1e-5,
                            "{} {layout:?} {formats:?} sample {i}: {got} for {expected}\n{expression}",
                            basis.family().name
                        );
                        worst = worst.max(error);
                    }
                }
            }
        }
    }
    println!("largest difference: {worst:.2e}");
}

#[test]
fn transfer_and_point_light_are_what_they_say() {
    let Some(gpu) = Gpu::for_tests() else { return };
    let model = |space| Model { space, ..model(&bases(&[6])[0], Layout::Grey) };
    let inputs = [
        [-0.5f32, 0.0, 0.02, 0.0],
        [0.04045, 0.0405, 0.5, 0.0],
        [1.0, 1.5, 0.2, 0.0],
        // Lights seen from (1, 2, 3): beside, at the surface, nearly at it, very far.
        [1.0, 2.0, 5.0, 1.0],
        [1.0, 2.0, 3.0, 1.0],
        [4.0, 6.0, 3.0, 1.0],
        [1.0e25, 2.0, 3.0, 1.0],
    ];
    let run = |space| {
        let model = model(space);
        let packing = packed(&model, TexelFormat::Block(BlockFormat::Bc4));
        let source = shader(&model, &packing, 1, 1, &WGSL);
        let source = format!(
            "{source}
            @group(0) @binding(0) var<storage, read> input: array<vec4f>;
            @group(0) @binding(1) var<storage, read_write> output: array<vec4f>;
            @compute @workgroup_size(1) fn main(@builtin(global_invocation_id) id: vec3u) {{
                let value = input[id.x];
                if (value.w == 1.0) {{
                    output[2u * id.x] = relight_point_light(vec3f(1.0, 2.0, 3.0), value.xyz, 0.25);
                }} else {{
                    output[2u * id.x] = vec4f(relight_to_linear(value.xyz), 0.0);
                    output[2u * id.x + 1u] = vec4f(relight_to_encoded(value.xyz), 0.0);
                }}
            }}"
        );
        gpu.compute(&source, &inputs, &[], 8 * inputs.len(), inputs.len())
    };
    let (encoded, linear) = (run(Space::Encoded), run(Space::Linear));
    for (i, input) in inputs[..3].iter().enumerate() {
        for c in 0..3 {
            let close = |got: f32, expected: f32| {
                assert!((got - expected).abs() <= 1e-6 * expected.abs().max(1.0), "{got} for {expected}");
            };
            close(encoded[8 * i + c], linear_from_srgb(input[c]));
            close(encoded[8 * i + 4 + c], input[c]);
            close(linear[8 * i + c], input[c]);
            close(linear[8 * i + 4 + c], srgb_from_linear(input[c]));
        }
    }
    let lights = [[0.0, 0.0, 1.0, 0.25], [0.0, 0.0, 1.0, 16.0], [0.6, 0.8, 0.0, 0.04], [1.0, 0.0, 0.0, 0.0]];
    for (i, expected) in (3..).zip(lights) {
        let got = &encoded[8 * i..8 * i + 4];
        for (got, expected) in got.iter().zip(expected) {
            assert!((got - expected).abs() <= 1e-6 * expected.max(1.0), "{got} for {expected} of {i}");
        }
    }
}
