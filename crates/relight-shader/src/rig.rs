//! Source that lights a moving mesh by its rig: the model's blend of vectors of harmonics, the cosine lobe folded in.

use crate::Language;
use crate::language::Type;
use crate::literal::literal;
use crate::rig_sphere;
use crate::source::{Parameter, Source};
use relight_rig::{AxisFunction, Frame, Model, cosine_lobe};
use std::f64::consts::PI;

/// What [`rig_shader`] writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RigShaderOptions {
    /// In which language.
    pub language: Language,
    /// Also a function for sphere lights that don't go through the rig.
    pub sphere_lights: bool,
}

/// The largest and the smallest extent that shaders' floats divide by.
const EXTENTS: [f64; 2] = [1e-37, 1e37];

const COORDINATES: [&str; 3] = ["x", "y", "z"];

/// The source that lights a part of a mesh by its rig: `relight_reflectance(position, normal)`, and on demand
/// `relight_sphere_reflectance(position, normal, centre, radius)`. Its head says what it needs and gives.
///
/// Depends on nothing but its arguments. Bands of l = 3 and 5 have no part in irradiance and are not read. Boxes smaller than
/// 1e-37 or larger than 1e37 count as that.
///
/// # Panics
/// When `bands` is not within 1 to 6, and for a model of nodes that leaves out some of their products, of which there is none.
pub fn rig_shader(model: &Model, frame: &Frame, bands: usize, options: &RigShaderOptions) -> String {
    assert!((1..=6).contains(&bands), "{bands} bands; rigs have 1 to 6");
    let mut source = Source::new(options.language);
    head(&mut source, model, bands, options.sphere_lights);
    if source.language == Language::Glsl {
        source.comment("ES has defaults of its own; elsewhere these lines mean nothing.");
        source.line("precision highp float;");
        source.line("precision highp int;");
    }
    source.line("");
    source.constant(Type::Int, "RELIGHT_PARAMETERS", &model.parameters().len().to_string());
    source.constant(Type::Int, "RELIGHT_FUNCTIONS", &(bands * bands).to_string());
    write_frame(&mut source, frame);
    write_parameter(&mut source, bands);
    write_reflectance(&mut source, model);
    if options.sphere_lights {
        rig_sphere::write(&mut source);
    }
    source.into_text()
}

fn head(source: &mut Source, model: &Model, bands: usize, sphere_lights: bool) {
    let [int, float, float3] = [Type::Int, Type::Float, Type::Float3].map(|of| source.word(of));
    let (parameters, functions) = (model.parameters().len(), bands * bands);
    let sphere = if sphere_lights {
        format!(
            "\n\
             \x20   {float} relight_sphere_reflectance(position, normal, centre, radius)\n\
             \x20       the same of one sphere light of radiance 1, exact: times its color, added to the above\n\
             \x20       where the light is not in the rig"
        )
    } else {
        String::new()
    };
    let declared = match source.language {
        Language::Wgsl => {
            format!("Declare beside it    fn relight_coefficient(index: {int}) -> {float3}")
        }
        Language::Glsl | Language::Hlsl => {
            format!("Declare before it    {float3} relight_coefficient({int} index)")
        }
    };
    source.comment(&format!(
        "Lights a part of a moving mesh by its irradiance rig. Written by relight; needs no other source.\n\
         \n\
         Model   {}: {parameters} vectors of {functions} harmonics ({bands} bands)\n\
         \n\
         {declared}\n\
         which reads from a buffer, a texture or what you like, for index = vector * {functions} + l * l + l + m, R, G, B of\n\
         the coefficients of radiance that the lights give the rig now (with Condon-Shortley phase, not multiplied by\n\
         the cosine lobe): {} in all.\n\
         \n\
         \x20   {float3} relight_reflectance(position, normal)\n\
         \x20       reflected radiance of a white diffuser: irradiance / pi. Times albedo it is the color{sphere}\n\
         \n\
         The position of relight_reflectance is in the axes of the mesh, all else in those of the scene; normals are unit vectors.\n\
         Source: Yuan, Nowrouzezahrai, Sloan, Irradiance Rigs.",
        model.text(),
        parameters * functions,
    ));
}

fn vector(source: &Source, of: [f32; 3]) -> String {
    format!("{}({})", source.word(Type::Float3), of.map(literal).join(", "))
}

fn write_frame(source: &mut Source, frame: &Frame) {
    let bounded = |value: f64| value.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32;
    let centre = frame.centre.map(bounded);
    let rest = [0, 1, 2].map(|i| (frame.centre[i] - f64::from(centre[i])) as f32);
    let half = frame.half_extent.map(|half| if half > 0.0 { half } else { 1.0 });
    let scale = half.map(|half| (1.0 / half.clamp(EXTENTS[0], EXTENTS[1])) as f32);
    source.comment(
        "The box of the mesh: its middle, what a float can't hold of that, and 1 / half of its edges.",
    );
    for (name, value) in
        [("RELIGHT_CENTRE", centre), ("RELIGHT_CENTRE_REST", rest), ("RELIGHT_PER_HALF_EXTENT", scale)]
    {
        let value = vector(source, value);
        source.constant(Type::Float3, name, &value);
    }
}

/// Irradiance / pi of a harmonic of radiance, bare polynomials of the normal `n` beside their factor; `None` where it is 0.
fn harmonic(i: usize) -> Option<(f64, &'static str)> {
    let l = i.isqrt();
    // Squares of the factors, times 4 pi, with the sign of the phase; the polynomials of l = 4 follow those of l = 2.
    let (squared, polynomial) = match l {
        0 => (1.0, ""),
        1 => [(-3.0, "n.y"), (3.0, "n.z"), (-3.0, "n.x")][i - 1],
        2 => [
            (15.0, "n.x * n.y"),
            (-15.0, "n.y * n.z"),
            (1.25, "(3.0 * n.z * n.z - 1.0)"),
            (-15.0, "n.x * n.z"),
            (3.75, "(n.x * n.x - n.y * n.y)"),
        ][i - 4],
        4 => [
            (78.75, "n.x * n.y * (n.x * n.x - n.y * n.y)"),
            (-39.375, "n.y * n.z * (3.0 * n.x * n.x - n.y * n.y)"),
            (11.25, "n.x * n.y * (7.0 * n.z * n.z - 1.0)"),
            (-5.625, "n.y * n.z * (7.0 * n.z * n.z - 3.0)"),
            (0.140625, "((35.0 * n.z * n.z - 30.0) * n.z * n.z + 3.0)"),
            (-5.625, "n.x * n.z * (7.0 * n.z * n.z - 3.0)"),
            (2.8125, "(n.x * n.x - n.y * n.y) * (7.0 * n.z * n.z - 1.0)"),
            (-39.375, "n.x * n.z * (n.x * n.x - 3.0 * n.y * n.y)"),
            (
                4.921875,
                "(n.x * n.x * (n.x * n.x - 3.0 * n.y * n.y) - n.y * n.y * (3.0 * n.x * n.x - n.y * n.y))",
            ),
        ][i - 16],
        _ => return None,
    };
    let factor: f64 = squared;
    Some((cosine_lobe(l) / PI * factor.signum() * (factor.abs() / (4.0 * PI)).sqrt(), polynomial))
}

fn write_parameter(source: &mut Source, bands: usize) {
    source.comment("Irradiance / pi of one vector of harmonics.");
    let parameters = [Parameter::value("which", Type::Int), Parameter::value("n", Type::Float3)];
    source.function(Type::Float3, "relight_of_vector", &parameters, |source| {
        source.value(Type::Int, "at", "which * RELIGHT_FUNCTIONS");
        for (i, (factor, polynomial)) in
            (0..bands * bands).filter_map(|i| harmonic(i).map(|harmonic| (i, harmonic)))
        {
            let factor = literal(factor as f32);
            if i == 0 {
                source.variable(Type::Float3, "sum", &format!("{factor} * relight_coefficient(at)"));
            } else {
                source.line(&format!("sum = sum + {factor} * {polynomial} * relight_coefficient(at + {i});"));
            }
        }
        source.line("return sum;");
    });
}

/// What of an axis has a weight somewhere: the weight and the place in the axis's list, both as expressions.
struct Term {
    weight: Option<String>,
    place: String,
}

/// The distinct functions of an axis, in the order in which the model has them.
fn functions_of(model: &Model, axis: usize) -> Vec<AxisFunction> {
    let mut functions = Vec::new();
    for product in model.parameters() {
        if !functions.contains(&product[axis]) {
            functions.push(product[axis]);
        }
    }
    functions
}

/// The terms of an axis; of nodes, the two around the point, which `source` is told how to find.
fn terms_of(source: &mut Source, axis: usize, functions: &[AxisFunction]) -> Vec<Term> {
    let name = COORDINATES[axis];
    if let [AxisFunction::Hat { nodes, .. }, ..] = functions {
        let (int, float) = (source.word(Type::Int), source.word(Type::Float));
        let last = nodes - 1;
        let place = format!("0.5 * (clamp(at.{name}, -1.0, 1.0) + 1.0) * {last}.0");
        source.value(Type::Float, &format!("{name}_place"), &place);
        let node = format!("min({int}({name}_place), {})", last - 1);
        source.value(Type::Int, &format!("{name}_node"), &node);
        source.value(Type::Float, &format!("{name}_far"), &format!("{name}_place - {float}({name}_node)"));
        return vec![
            Term { weight: Some(format!("(1.0 - {name}_far)")), place: format!("{name}_node") },
            Term { weight: Some(format!("{name}_far")), place: format!("({name}_node + 1)") },
        ];
    }
    let term = |(place, function): (usize, &AxisFunction)| Term {
        weight: (*function == AxisFunction::Coordinate).then(|| format!("at.{name}")),
        place: place.to_string(),
    };
    functions.iter().enumerate().map(term).collect()
}

fn write_reflectance(source: &mut Source, model: &Model) {
    let functions = [0, 1, 2].map(|axis| functions_of(model, axis));
    let products = model.parameters();
    let [nx, ny, nz] = [0, 1, 2].map(|axis: usize| functions[axis].len());
    let place = |i: usize| [i % nx, i / nx % ny, i / nx / ny];
    let whole = products.len() == nx * ny * nz
        && products.iter().enumerate().all(|(i, product)| {
            let place = place(i);
            (0..3).all(|axis| product[axis] == functions[axis][place[axis]])
        });
    source.comment("Reflected radiance of a white diffuser by the rig.");
    let parameters = [Parameter::value("position", Type::Float3), Parameter::value("normal", Type::Float3)];
    source.function(Type::Float3, "relight_reflectance", &parameters, |source| {
        let at = "((position - RELIGHT_CENTRE) - RELIGHT_CENTRE_REST) * RELIGHT_PER_HALF_EXTENT";
        source.value(Type::Float3, "at", at);
        let terms = [0, 1, 2].map(|axis| terms_of(source, axis, &functions[axis]));
        let black = format!("{0}(0.0, 0.0, 0.0)", source.word(Type::Float3));
        source.variable(Type::Float3, "sum", &black);
        let mut add = |weights: [&Option<String>; 3], vector: &str| {
            let weights: Vec<_> =
                weights.into_iter().flatten().map(|weight| format!("{weight} * ")).collect();
            source.line(&format!("sum = sum + {}relight_of_vector({vector}, normal);", weights.concat()));
        };
        if whole {
            for (z, y) in terms[2].iter().flat_map(|z| terms[1].iter().map(move |y| (z, y))) {
                for x in &terms[0] {
                    add([&x.weight, &y.weight, &z.weight], &vector_at([x, y, z], [nx, ny, nz]));
                }
            }
        } else {
            for (i, product) in products.iter().enumerate() {
                let weights = [0, 1, 2].map(|axis| {
                    let hat = matches!(product[axis], AxisFunction::Hat { .. });
                    assert!(!hat, "a lattice that lacks vectors");
                    let place = functions[axis].iter().position(|function| *function == product[axis]);
                    &terms[axis][place.unwrap_or_default()].weight
                });
                add(weights, &i.to_string());
            }
        }
        source.line("return sum;");
    });
}

/// Which vector has these places in the lists of the axes, x fastest.
fn vector_at([x, y, z]: [&Term; 3], [nx, ny, _]: [usize; 3]) -> String {
    let word = |(term, step): (&Term, usize)| match term.place.parse::<usize>() {
        Ok(0) => None,
        Ok(place) => Some((place * step).to_string()),
        Err(_) if step == 1 => Some(term.place.clone()),
        Err(_) => Some(format!("{step} * {}", term.place)),
    };
    let words: Vec<_> = [(x, 1), (y, nx), (z, nx * ny)].into_iter().filter_map(word).collect();
    if words.is_empty() { "0".to_owned() } else { words.join(" + ") }
}
