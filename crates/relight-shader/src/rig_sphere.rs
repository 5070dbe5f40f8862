//! A sphere light's irradiance, cut by the horizon, in closed form.
//!
//! Source: MATH.md section 1.4: s = sine of the light's half angle, ct = cosine to its middle, c = sqrt(1 - s^2), w = sqrt(s^2 - ct^2),
//! E = s^2 ct atan2(w, -c ct) - c w + atan2(w, c). WGSL lets atan2 be 4096 ULP off, and the last two terms cancel, so that both
//! angles come from one polynomial of (atan k - k) / k^3.

use crate::language::Type;
use crate::literal::literal;
use crate::source::{Parameter, Source};
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4, PI};

/// tan(pi / 8): beyond it angles are turned by pi / 4.
const TURN: f32 = 0.414_213_57;

/// (atan k - k) / k^3 as a polynomial of k^2 for k up to [`TURN`], off by at most 1.6e-8: least squares at Chebyshev nodes.
const LESS: [f32; 5] = [-0.333_333_3, 0.199_995_5, -0.142_642_32, 0.107_462_99, -0.064_593_76];

/// Up to this s the two terms that cancel are one difference; beyond it w / c grows.
const NEAR: &str = "0.9";

/// `relight_sphere_reflectance`, and what it calls.
pub(crate) fn write(source: &mut Source) {
    source.comment("atan(k) - k, for k from -0.4142 to 0.4142.");
    source.function(Type::Float, "relight_atan_less", &[Parameter::value("k", Type::Float)], |source| {
        source.value(Type::Float, "q", "k * k");
        let [a, b, c, d, e] = LESS.map(literal);
        let series = format!("{a} + q * ({b} + q * ({c} + q * ({d} + q * {e})))");
        source.line(&format!("return k * q * ({series});"));
    });
    source.comment(
        "The angle of (x, y) for y >= 0, 0 to pi: atan2(y, x) without the freedom that languages give it.",
    );
    let parameters = [Parameter::value("y", Type::Float), Parameter::value("x", Type::Float)];
    source.function(Type::Float, "relight_angle", &parameters, |source| {
        source.variable(Type::Float, "k", "min(y, abs(x)) / max(max(y, abs(x)), 1.0e-37)");
        source.variable(Type::Float, "turned", "0.0");
        source.block(&format!("if (k > {})", literal(TURN)), |source| {
            source.line(&format!("turned = {};", literal(FRAC_PI_4 as f32)));
            source.line("k = (k - 1.0) / (k + 1.0);");
        });
        source.variable(Type::Float, "angle", "turned + (k + relight_atan_less(k))");
        source.block("if (y > abs(x))", |source| {
            source.line(&format!("angle = {} - angle;", literal(FRAC_PI_2 as f32)));
        });
        source.block("if (x < 0.0)", |source| {
            source.line(&format!("angle = {} - angle;", literal(PI as f32)));
        });
        source.line("return angle;");
    });
    source.comment(
        "Reflected radiance of a white diffuser under a sphere light of radiance 1, which the horizon of the normal may cut.\n\
         A place inside sees what one on the sphere sees; in the middle itself, the light is towards +z.",
    );
    let parameters = [
        Parameter::value("position", Type::Float3),
        Parameter::value("normal", Type::Float3),
        Parameter::value("centre", Type::Float3),
        Parameter::value("radius", Type::Float),
    ];
    source.function(Type::Float, "relight_sphere_reflectance", &parameters, body);
}

fn body(source: &mut Source) {
    source.value(Type::Float3, "to_centre", "centre - position");
    source.value(Type::Float3, "size", "abs(to_centre)");
    source.value(Type::Float, "largest", "max(size.x, max(size.y, size.z))");
    source.block("if (largest < 1.0e-37)", |source| source.line("return 0.5 + 0.5 * normal.z;"));
    source.comment("Divided by the largest component first: squares neither overflow nor vanish.");
    source.value(Type::Float3, "shorter", "to_centre / largest");
    source.value(Type::Float, "distance", "sqrt(dot(shorter, shorter))");
    source.value(Type::Float, "ct", "clamp(dot(normal, shorter) / distance, -1.0, 1.0)");
    source.value(Type::Float, "s", "radius / largest / distance");
    source.block("if (s >= 1.0)", |source| source.line("return 0.5 + 0.5 * ct;"));
    source.block("if (ct >= s)", |source| source.line("return s * s * ct;"));
    source.block("if (ct <= -s)", |source| source.line("return 0.0;"));
    source.value(Type::Float, "c", "sqrt((1.0 - s) * (1.0 + s))");
    source.value(Type::Float, "w", "sqrt((s - ct) * (s + ct))");
    source.value(Type::Float, "k", "w / c");
    source.value(Type::Float, "lit", "s * s * ct * relight_angle(w, -c * ct)");
    let over_pi = literal(FRAC_1_PI as f32);
    source.block(&format!("if (s > {NEAR})"), |source| {
        source.line(&format!("return {over_pi} * (lit - c * w + relight_angle(w, c));"));
    });
    source
        .comment("The same with s^2 k - (k - atan k) for the last two terms, which cancel for small lights.");
    source.variable(Type::Float, "less", "relight_angle(w, c) - k");
    source.block(&format!("if (k <= {})", literal(TURN)), |source| {
        source.line("less = relight_atan_less(k);");
    });
    source.line(&format!("return {over_pi} * (lit + s * s * k + less);"));
}
