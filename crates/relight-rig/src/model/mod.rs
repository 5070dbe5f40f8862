//! Rig models: how a few vectors of harmonics make those of every point.
//!
//! Every parameter of a model weighs by a product of three functions, one of each coordinate. Coordinates run from -1 to 1
//! over the box of the mesh. A new model is a file with its list of products and a row of [`MODELS`].

mod constant;
mod gradient;
mod lattice;
mod mixed;

use crate::RigError;

/// Most parameters of a model.
pub const MOST_PARAMETERS: usize = 512;

/// A function of one coordinate, -1 to 1 over the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisFunction {
    /// 1.
    One,
    /// The coordinate itself.
    Coordinate,
    /// 1 at one of `nodes` evenly spaced places from -1 to 1, falling to 0 at its neighbours, held beyond the outer ones.
    Hat {
        /// Which place, from 0.
        node: usize,
        /// How many there are, 2 or more.
        nodes: usize,
    },
}

impl AxisFunction {
    /// Its value at a coordinate.
    pub fn value(self, coordinate: f64) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Coordinate => coordinate,
            Self::Hat { node, nodes } => {
                let place = 0.5 * (coordinate.clamp(-1.0, 1.0) + 1.0) * (nodes - 1) as f64;
                (1.0 - (place - node as f64).abs()).max(0.0)
            }
        }
    }
}

/// A model: the lighting at a point is the sum of its parameters (vectors of harmonics), each by its weight there.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    text: String,
    parameters: Vec<[AxisFunction; 3]>,
}

/// A kind of models.
pub struct ModelFamily {
    /// What its models' texts begin with.
    pub name: &'static str,
    /// What they look like.
    pub form: &'static str,
    /// The products of what follows the name and a colon; `None` where it makes no sense.
    pub parse: fn(&str) -> Option<Products>,
}

/// Products of functions of the three coordinates, one a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Products {
    /// These.
    These(Vec<[AxisFunction; 3]>),
    /// Every product of a function of x, one of y and one of z; x changes fastest.
    All([Vec<AxisFunction>; 3]),
}

impl Products {
    /// How many there are.
    pub fn count(&self) -> usize {
        match self {
            Self::These(products) => products.len(),
            Self::All(axes) => axes.iter().map(Vec::len).product(),
        }
    }

    /// All of them.
    pub fn list(self) -> Vec<[AxisFunction; 3]> {
        match self {
            Self::These(products) => products,
            Self::All([x, y, z]) => {
                let rows = z.iter().flat_map(|&z| y.iter().map(move |&y| (y, z)));
                rows.flat_map(|(y, z)| x.iter().map(move |&x| [x, y, z])).collect()
            }
        }
    }
}

/// All kinds, the cheapest first.
pub const MODELS: [ModelFamily; 4] = [constant::FAMILY, gradient::FAMILY, lattice::FAMILY, mixed::FAMILY];

impl Model {
    /// The model that a text names: `constant`, `gradient`, `lattice:2x2x3`, `mixed:3,gradient,constant`.
    ///
    /// # Errors
    /// [`RigError::Model`] and [`RigError::TooManyParameters`] beyond [`MOST_PARAMETERS`].
    pub fn parse(text: &str) -> Result<Self, RigError> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let family = MODELS.iter().find(|family| family.name == name);
        let forms = || MODELS.map(|family| family.form).join(", ");
        let products = family.and_then(|family| (family.parse)(rest));
        let products = products.ok_or_else(|| RigError::Model { text: text.to_owned(), forms: forms() })?;
        if products.count() > MOST_PARAMETERS {
            return Err(RigError::TooManyParameters { parameters: products.count(), most: MOST_PARAMETERS });
        }
        Ok(Self { text: text.to_owned(), parameters: products.list() })
    }

    /// What [`Self::parse`] understands.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The product of each parameter, in the order of the rig's vectors.
    pub fn parameters(&self) -> &[[AxisFunction; 3]] {
        &self.parameters
    }

    /// Writes the weight of each parameter at a point in coordinates of the mesh's box.
    ///
    /// # Panics
    /// When `out` is not as long as [`Self::parameters`].
    pub fn weights(&self, point: [f64; 3], out: &mut [f64]) {
        assert_eq!(out.len(), self.parameters.len(), "a weight a parameter");
        for (weight, product) in out.iter_mut().zip(&self.parameters) {
            *weight = (0..3).fold(1.0, |weight, axis| weight * product[axis].value(point[axis]));
        }
    }
}
