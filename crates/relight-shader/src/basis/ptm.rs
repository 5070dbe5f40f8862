//! Polynomials in the light's x and y.

use crate::language::Type;
use crate::source::Source;
use relight_core::Basis;

/// Monomials spelt as the basis spells them: `uuv` is u * u * v.
pub(super) fn body(source: &mut Source, basis: &Basis) {
    source.value(Type::Float, "u", "l.x");
    source.value(Type::Float, "v", "l.y");
    for function in 0..basis.count() {
        let label = basis.label(function);
        let factors: Vec<String> = label.chars().map(String::from).collect();
        let product = if label == "1" { "1.0".to_owned() } else { factors.join(" * ") };
        source.line(&format!("basis[{function}] = {product};"));
    }
}
