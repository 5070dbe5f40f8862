//! What the source of rigs computes on a GPU, against the sums and the closed form in f64, and its text.

use crate::compiles::{glslang, glslang_is_there, validated};
use crate::gpu::Gpu;
use relight_core::Direction;
use relight_core::basis::evaluate_sh;
use relight_rig::{Frame, Model};
use relight_shader::{Language, RigShaderOptions, rig_shader};
use std::f64::consts::PI;

const MODELS: [&str; 6] = [
    "constant",
    "gradient",
    "lattice:2x2x2",
    "lattice:4x1x3",
    "mixed:3,gradient,constant",
    "mixed:gradient,7,2",
];

const FRAME: Frame = Frame { centre: [0.3, -1.7, 40.0], half_extent: [2.0, 0.4, 5.0], radius: 6.0 };

fn text(model: &str, bands: usize, language: Language, sphere_lights: bool) -> String {
    let options = RigShaderOptions { language, sphere_lights };
    rig_shader(&Model::parse(model).unwrap(), &FRAME, bands, &options)
}

/// -1 to 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f64 / f64::from(1u32 << 23) - 1.0
}

fn unit(state: &mut u64) -> [f32; 3] {
    loop {
        let v = [random(state), random(state), random(state)];
        if (0.01..1.0).contains(&v.iter().map(|c| c * c).sum::<f64>()) {
            let [x, y, z] = v;
            return Direction::new(x, y, z).unwrap().components().map(|c| c as f32);
        }
    }
}

/// `expression` of `input[at]`, `input[at + 1]` .. for each of so many, `each` inputs apart and after `skip`.
fn computed(
    gpu: &Gpu,
    source: &str,
    input: &[[f32; 4]],
    skip: usize,
    each: usize,
    expression: &str,
) -> Vec<[f32; 3]> {
    let count = (input.len() - skip) / each;
    let source = format!(
        "{source}
        fn relight_coefficient(index: i32) -> vec3f {{ return input[index].xyz; }}
        @group(0) @binding(0) var<storage, read> input: array<vec4f>;
        @group(0) @binding(1) var<storage, read_write> output: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {{
            if (id.x >= {count}u) {{ return; }}
            let at = {skip}u + id.x * {each}u;
            let made = {expression};
            for (var c = 0u; c < 3u; c++) {{ output[3u * id.x + c] = made[c]; }}
        }}"
    );
    let output = gpu.compute(&source, input, &[], 3 * count, count.div_ceil(64));
    output.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect()
}

#[test]
fn every_model_and_number_of_bands_is_blended_as_the_cpu_does() {
    let Some(gpu) = Gpu::for_tests() else { return };
    let lobe = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0, 0.0];
    let mut state = 3;
    for (name, bands) in MODELS.into_iter().zip([3, 6, 4, 5, 1, 2]) {
        let model = Model::parse(name).unwrap();
        let (functions, parameters) = (bands * bands, model.parameters().len());
        let coefficients: Vec<[f64; 3]> = (0..parameters * functions)
            .map(|_| [0, 1, 2].map(|_| f64::from(random(&mut state) as f32)))
            .collect();
        let mut input: Vec<[f32; 4]> =
            coefficients.iter().map(|c| [c[0] as f32, c[1] as f32, c[2] as f32, 9.0]).collect();
        for i in 0..500 {
            // Also beyond the box, at its corners, and on nodes.
            let at = [0, 1, 2].map(|_| match i % 5 {
                0 => random(&mut state).signum(),
                1 => (3.0 * random(&mut state)).round() / 3.0,
                _ => 1.2 * random(&mut state),
            });
            let point = [0, 1, 2].map(|c| (FRAME.centre[c] + FRAME.half_extent[c] * at[c]) as f32);
            let normal = unit(&mut state);
            input.extend([point, normal].map(|[x, y, z]| [x, y, z, 7.0]));
        }
        let source = text(name, bands, Language::Wgsl, false);
        let skip = coefficients.len();
        let got = computed(
            &gpu,
            &source,
            &input,
            skip,
            2,
            "relight_reflectance(input[at].xyz, input[at + 1u].xyz)",
        );
        let mut worst = 0.0f64;
        for (got, at) in got.iter().zip(input[skip..].chunks_exact(2)) {
            let wide = |v: [f32; 4]| [0, 1, 2].map(|c| f64::from(v[c]));
            let [x, y, z] = wide(at[1]);
            let mut harmonics = vec![0.0; functions];
            evaluate_sh(bands - 1, Direction::new(x, y, z).unwrap(), &mut harmonics);
            let mut weights = vec![0.0; parameters];
            model.weights(FRAME.coordinates(wide(at[0])), &mut weights);
            for c in 0..3 {
                let of_parameter = |p: usize| -> f64 {
                    let term =
                        |i: usize| lobe[i.isqrt()] / PI * harmonics[i] * coefficients[p * functions + i][c];
                    (0..functions).map(term).sum()
                };
                let expected: f64 = (0..parameters).map(|p| weights[p] * of_parameter(p)).sum();
                worst = worst.max((f64::from(got[c]) - expected).abs());
            }
        }
        println!("{name}, {bands} bands: {worst:.1e}");
        assert!(worst < 2e-6, "{name}, {bands} bands: off by {worst}");
    }
}

/// MATH.md section 1.4, over pi.
fn exact([point, normal, centre]: [[f64; 3]; 3], radius: f64) -> f64 {
    let to: [f64; 3] = [0, 1, 2].map(|c| centre[c] - point[c]);
    let largest = to.iter().fold(0.0f64, |a, c| a.max(c.abs()));
    let distance = largest * to.iter().map(|c| (c / largest) * (c / largest)).sum::<f64>().sqrt();
    let ct = ((0..3).map(|c| to[c] / distance * normal[c]).sum::<f64>()).clamp(-1.0, 1.0);
    let s = radius / distance;
    if s >= 1.0 {
        return 0.5 + 0.5 * ct;
    }
    if ct >= s {
        return s * s * ct;
    }
    if ct <= -s {
        return 0.0;
    }
    let (c, w) = (((1.0 - s) * (1.0 + s)).sqrt(), ((s - ct) * (s + ct)).sqrt());
    let [sum, k] = [s * s * (ct * libm::atan2(w, -c * ct) + w / c), w / c];
    let less = if k < 0.03 {
        // Six terms of the series: 1e-17 of k^3.
        let q = k * k;
        k * q * (-1.0 / 3.0 + q * (0.2 + q * (-1.0 / 7.0 + q * (1.0 / 9.0 + q * (-1.0 / 11.0 + q / 13.0)))))
    } else {
        libm::atan(k) - k
    };
    (sum + less) / PI
}

#[test]
fn sphere_lights_are_exact_up_to_the_horizon_and_to_the_surface() {
    let Some(gpu) = Gpu::for_tests() else { return };
    let mut state = 11;
    let mut input = Vec::new();
    let sines: [f64; 14] = [1e-6, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.5, 0.85, 0.95, 0.99, 0.9999, 1.0, 1.5, 30.0];
    for (i, s) in (0..4000).zip(sines.into_iter().cycle()) {
        let scale: f64 = [1.0, 1e-15, 1e15][i % 3];
        let direction = unit(&mut state).map(f64::from);
        let normal = unit(&mut state).map(f64::from);
        // The light's middle within a few of its half angles of the horizon, from both sides.
        let aside = random(&mut state) * if i % 2 == 0 { 1.2 * s.min(1.0) } else { 1.0 };
        let along: f64 = (0..3).map(|c| direction[c] * normal[c]).sum();
        let [x, y, z] = [0, 1, 2].map(|c| direction[c] - along * normal[c] + aside * normal[c]);
        let to = Direction::new(x, y, z).unwrap().components();
        let distance = scale * (1.5 + random(&mut state));
        let point =
            [0, 1, 2].map(|_| if i % 4 == 0 { 0.0 } else { (0.1 * scale * random(&mut state)) as f32 });
        let centre = [0, 1, 2].map(|c| (f64::from(point[c]) + distance * to[c]) as f32);
        for (vector, w) in [(point, 0.0), (normal.map(|c| c as f32), 0.0), (centre, (s * distance) as f32)] {
            input.push([vector[0], vector[1], vector[2], w]);
        }
    }
    let source = text("constant", 3, Language::Wgsl, true);
    let call = "vec3f(relight_sphere_reflectance(input[at].xyz, input[at + 1u].xyz, input[at + 2u].xyz, input[at + 2u].w))";
    let got = computed(&gpu, &source, &input, 0, 3, call);
    let mut worst = [0.0f64; 2];
    for (got, at) in got.iter().zip(input.chunks_exact(3)) {
        let wide = |v: [f32; 4]| [0, 1, 2].map(|c| f64::from(v[c]));
        let radius = f64::from(at[2][3]);
        let vectors = [wide(at[0]), wide(at[1]), wide(at[2])];
        let expected = exact(vectors, radius);
        let distance = (0..3)
            .map(|c| (vectors[2][c] - vectors[0][c]) * (vectors[2][c] - vectors[0][c]))
            .sum::<f64>()
            .sqrt();
        let s = (radius / distance).min(1.0);
        // Relative to a facing light; near the surface the slope over s has a root in it.
        let error = (f64::from(got[0]) - expected).abs() / (s * s);
        let near = usize::from(s > 0.98);
        worst[near] = worst[near].max(error * if near == 1 { (1.0 - s).max(1e-7).sqrt() } else { 1.0 });
        assert!(error.is_finite(), "{at:?}: {got:?} {expected}");
    }
    println!(
        "sphere lights: {:.1e} of a facing light, {:.1e} / sqrt(1 - r / d) near the surface",
        worst[0], worst[1]
    );
    assert!(worst[0] < 1e-6 && worst[1] < 5e-7, "{worst:?}");
}

fn coefficients(language: Language) -> &'static str {
    match language {
        Language::Wgsl => {
            "@group(0) @binding(0) var<storage, read> numbers: array<vec4f>;
            fn relight_coefficient(index: i32) -> vec3f { return numbers[index].xyz; }"
        }
        Language::Glsl => {
            "uniform vec4 numbers[200];\nvec3 relight_coefficient(int index) { return numbers[index].xyz; }"
        }
        Language::Hlsl => {
            "StructuredBuffer<float4> numbers : register(t0);
            float3 relight_coefficient(int index) { return numbers[index].xyz; }"
        }
    }
}

#[test]
fn compilers_accept_every_model() {
    for (name, bands) in MODELS.into_iter().zip(1..) {
        for sphere in [false, true] {
            let source = text(name, bands, Language::Wgsl, sphere);
            assert_eq!(source.contains("sphere"), sphere, "nothing that was not asked for");
            validated(&format!("{source}\n{}", coefficients(Language::Wgsl)));
        }
    }
    if !glslang_is_there() {
        return;
    }
    let sources = |language: Language, main: &str| -> Vec<String> {
        let whole = |(name, bands)| {
            format!("{}\n{}\n{main}", coefficients(language), text(name, bands, language, true))
        };
        MODELS.into_iter().zip(1..).map(whole).collect()
    };
    for version in ["300 es", "330", "450"] {
        let main = "in vec3 at;\nout vec4 target;
            void main() {
                float sphere = relight_sphere_reflectance(at, at, at.yzx, at.x);
                target = vec4(relight_reflectance(at, normalize(at)) + sphere, 1.0);
            }";
        let of_version = |source: String| format!("#version {version}\nprecision highp float;\n{source}");
        let all: Vec<_> = sources(Language::Glsl, main).into_iter().map(of_version).collect();
        glslang(&[], "frag", &all, 20);
    }
    let main = "float4 main(float4 at : SV_Position) : SV_Target {
            float sphere = relight_sphere_reflectance(at.xyz, at.xyz, at.yzx, at.x);
            return float4(relight_reflectance(at.xyz, normalize(at.xyz)) + sphere, 1.0);
        }";
    glslang(&["-D", "-V", "-e", "main", "-S", "frag"], "hlsl", &sources(Language::Hlsl, main), 1);
}

#[test]
fn text_is_what_it_was() {
    for language in Language::all() {
        let text = text("mixed:3,gradient,constant", 3, language, true);
        crate::golden::check_text(&format!("rig_mixed.{}", language.name()), &text);
    }
}
