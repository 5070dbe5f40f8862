//! The same lighting all over: the harmonics at the middle, or their mean over the surface.

use super::{AxisFunction, ModelFamily};

pub(super) const FAMILY: ModelFamily = ModelFamily { name: "constant", form: "constant", parse };

fn parse(rest: &str) -> Option<Vec<[AxisFunction; 3]>> {
    rest.is_empty().then(|| vec![[AxisFunction::One; 3]])
}
