//! The same lighting all over: the harmonics at the middle, or their mean over the surface.

use super::{AxisFunction, ModelFamily, Products};

pub(super) const FAMILY: ModelFamily = ModelFamily { name: "constant", form: "constant", parse };

fn parse(rest: &str) -> Option<Products> {
    rest.is_empty().then(|| Products::These(vec![[AxisFunction::One; 3]]))
}
