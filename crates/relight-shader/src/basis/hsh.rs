//! Hemispherical harmonics.
//!
//! Source: `relight_core::basis`; the polynomials in c = cos(theta) are written in t = 2 c - 1,
//! where 20 c^3 - 30 c^2 + 12 c - 1 = (5 t^3 - 3 t) / 2 loses no digits in f32.

use crate::language::Type;
use crate::literal::literal;
use crate::source::Source;
use std::f64::consts::PI;

/// A function's factor squared and times pi, its sign, and what it multiplies.
const FUNCTIONS: [(f64, f64, &str); 16] = [
    (0.5, 1.0, "1.0"),
    (6.0, 1.0, "x"),
    (1.5, 1.0, "t"),
    (6.0, 1.0, "y"),
    (30.0, -1.0, "x2"),
    (30.0, 1.0, "t * x"),
    (2.5, 1.0, "(1.5 * t * t - 0.5)"),
    (30.0, 1.0, "t * y"),
    (30.0, -1.0, "y2"),
    (140.0, 1.0, "x3"),
    (210.0, -1.0, "t * x2"),
    (84.0, 1.0, "(1.25 * t * t - 0.25) * x"),
    (3.5, 1.0, "(2.5 * t * t - 1.5) * t"),
    (84.0, 1.0, "(1.25 * t * t - 0.25) * y"),
    (210.0, -1.0, "t * y2"),
    (140.0, 1.0, "y3"),
];

pub(super) fn body(source: &mut Source, count: usize) {
    if count > 1 {
        source.comment("Lights below the horizon count as on it.");
        source.value(Type::Float, "c", "max(l.z, 0.0)");
        source.value(Type::Float, "t", "2.0 * c - 1.0");
        source.value(Type::Float, "r", "sqrt(c / (1.0 + c))");
        source.value(Type::Float, "x", "l.x * r");
        source.value(Type::Float, "y", "l.y * r");
    }
    if count > 4 {
        source.value(Type::Float, "x2", "x * x - y * y");
        source.value(Type::Float, "y2", "2.0 * x * y");
    }
    if count > 9 {
        source.value(Type::Float, "x3", "x * x2 - y * y2");
        source.value(Type::Float, "y3", "x * y2 + y * x2");
    }
    for (function, (square, sign, product)) in FUNCTIONS.iter().enumerate().take(count) {
        let factor = literal((sign * (square / PI).sqrt()) as f32);
        let product = if *product == "1.0" { factor } else { format!("{factor} * {product}") };
        source.line(&format!("basis[{function}] = {product};"));
    }
}
