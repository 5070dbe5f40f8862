//! Gaussians of the angle to centres.

use crate::language::Type;
use crate::literal::literal;
use crate::source::{Parameter, Source};
use relight_core::basis::{Kernel, Srbf};

/// Angle over chord as a polynomial in the chord's square, chords of 0 to sqrt(2): relative error
/// below 3e-8 with these coefficients in f32.
///
/// Source: 2 asin(chord / 2), fitted by Remez exchange for the least largest relative error.
const ANGLE_OVER_CHORD: [f32; 8] = [
    1.0,
    0.041_667_55,
    0.004_678_733,
    0.000_730_338_1,
    5.946_419_3e-5,
    7.813_503e-5,
    -2.359_504_3e-5,
    6.924_434_7e-6,
];

/// Centres, the factor in the exponent and, for the geodesic kernel, the angle between directions.
pub(super) fn constants(source: &mut Source, srbf: &Srbf) {
    let centres: Vec<String> = srbf
        .centres()
        .iter()
        .map(|centre| centre.components().map(|component| literal(component as f32)).join(", "))
        .collect();
    source.comment("Centres of the Gaussians, and 1 / (2 spread^2).");
    source.table(Type::Float3, "RELIGHT_CENTRE", &centres);
    let sharpness = 1.0 / (2.0 * srbf.spread() * srbf.spread());
    source.constant(Type::Float, "RELIGHT_SHARPNESS", &literal(sharpness as f32));
    if srbf.kernel() == Kernel::Geodesic {
        angle(source);
    }
    gaussian(source, srbf.kernel());
}

/// Drivers may be off by 1e-3 in `acos`; the chord and a polynomial are not.
fn angle(source: &mut Source) {
    source.comment(
        "The angle between unit vectors from the chord to b, or from the chord to -b where that is shorter.",
    );
    let vectors = [Parameter::value("a", Type::Float3), Parameter::value("b", Type::Float3)];
    source.function(Type::Float, "relight_angle", &vectors, |source| {
        source.value(Type::Float, "to_b", "dot(a - b, a - b)");
        source.value(Type::Float, "to_opposite", "dot(a + b, a + b)");
        source.value(Type::Float, "s", "min(to_b, to_opposite)");
        let [lower @ .., highest] = ANGLE_OVER_CHORD.map(literal);
        source.variable(Type::Float, "over_chord", &highest);
        for coefficient in lower.iter().rev() {
            source.line(&format!("over_chord = over_chord * s + {coefficient};"));
        }
        source.value(Type::Float, "angle", "sqrt(s) * over_chord");
        let pi = literal(std::f32::consts::PI);
        let nearer = source.choice("to_b <= to_opposite", "angle", &format!("{pi} - angle"));
        source.line(&format!("return {nearer};"));
    });
}

/// The Gaussian around a centre.
fn gaussian(source: &mut Source, kernel: Kernel) {
    let vectors = [Parameter::value("l", Type::Float3), Parameter::value("centre", Type::Float3)];
    source.comment("The Gaussian around a centre.");
    source.function(Type::Float, "relight_gaussian", &vectors, |source| match kernel {
        Kernel::Geodesic => {
            source.value(Type::Float, "angle", "relight_angle(l, centre)");
            source.line("return exp(-RELIGHT_SHARPNESS * angle * angle);");
        }
        Kernel::Spherical => {
            source.comment("cosine - 1 is minus half the chord's square, which keeps its digits.");
            source.value(Type::Float3, "chord", "l - centre");
            source.line("return exp(-RELIGHT_SHARPNESS * dot(chord, chord));");
        }
    });
}

pub(super) fn body(source: &mut Source, count: usize) {
    source.each_of("i", 0..count, |source, i| {
        vec![format!("basis[{i}] = relight_gaussian(l, {});", source.element("RELIGHT_CENTRE", i))]
    });
}
