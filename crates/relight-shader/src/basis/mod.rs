//! The functions of light in shader source, one file a family.

mod hsh;
mod learned;
mod ptm;
mod sh;
mod srbf;

use crate::language::Type;
use crate::layers::TABLE;
use crate::source::{Parameter, Source, Takes};
use relight_core::Basis;

/// `relight_basis`: the functions of `basis` at a unit direction.
pub(crate) fn write(source: &mut Source, basis: &Basis) {
    match basis {
        Basis::Srbf(srbf) => srbf::constants(source, srbf),
        Basis::Sh(sh) => sh::constants(source, usize::from(sh.order())),
        Basis::Learned(learned) => learned::place(source, learned),
        Basis::Ptm(_) | Basis::Hsh(_) => {}
    }
    source.comment(
        "The functions of light at the unit direction l, which points from the surface to the light\n\
         (x right in the picture, y up, z towards the viewer).",
    );
    let mut parameters = vec![Parameter::new("l", Takes::Value(Type::Float3))];
    if matches!(basis, Basis::Learned(_)) {
        parameters.push(Parameter::new(TABLE, Takes::Texture));
    }
    let made = (Type::Float, "RELIGHT_FUNCTIONS", "basis");
    source.array_function(made, "relight_basis", &parameters, |source| match basis {
        Basis::Ptm(_) => ptm::body(source, basis),
        Basis::Sh(_) => sh::body(source),
        Basis::Hsh(_) => hsh::body(source, basis.count()),
        Basis::Srbf(_) => srbf::body(source, basis.count()),
        Basis::Learned(_) => learned::body(source, basis.count()),
    });
}
