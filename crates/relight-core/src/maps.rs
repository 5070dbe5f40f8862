//! Maps: planes of coefficients in f32, and the same quantised.

use crate::Model;
use half::f16;
use serde::{Deserialize, Serialize};

/// Planes of f32 coefficients, in the order of [`Model::roles`].
#[derive(Clone, Debug, PartialEq)]
pub struct CoefficientMap {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: Model,
    /// One per role, width x height each, row-major.
    pub planes: Vec<Vec<f32>>,
}

/// Coefficients of a run of pixels, as the fitter makes them and the writers of files take them.
///
/// A run is `pixels` pixels in row order starting at pixel `first` (x + y * width).
#[derive(Clone, Copy, Debug)]
pub struct CoefficientSpan<'a> {
    /// Index of the first pixel.
    pub first: usize,
    /// Number of pixels.
    pub pixels: usize,
    /// One row a map ([`Model::maps`]) of pixels x c samples each, channels interleaved: c = 3 for
    /// [`Layout::Rgb`](crate::Layout), 1 for grey, for shared planes and for the luminance of LRGB.
    pub maps: &'a [f32],
    /// pixels x 3 samples of base colour for [`Layout::Lrgb`](crate::Layout), otherwise empty.
    pub base_color: &'a [f32],
}

/// Least and largest coefficient of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CoefficientRange {
    /// The least; infinite while nothing was seen.
    pub min: f32,
    /// The largest; minus infinite while nothing was seen.
    pub max: f32,
}

impl CoefficientRange {
    /// The range of nothing.
    pub const EMPTY: Self = Self { min: f32::INFINITY, max: f32::NEG_INFINITY };

    /// The range that holds both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }
}

/// Codes of one plane.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// q = code / 255.
    U8(Vec<u8>),
    /// q is the half itself.
    F16(Vec<f16>),
    /// q is the float itself.
    F32(Vec<f32>),
}

/// One quantised plane: coefficient = scale * q + bias.
#[derive(Clone, Debug, PartialEq)]
pub struct RelightingMap {
    /// Per unit of q.
    pub scale: f32,
    /// At q = 0.
    pub bias: f32,
    /// width x height codes, row-major, the first row at the top.
    pub texels: Texels,
}

/// All quantised planes of an asset, in the order of [`Model::roles`].
#[derive(Clone, Debug, PartialEq)]
pub struct RelightingMaps {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: Model,
    /// One per role.
    pub planes: Vec<RelightingMap>,
}

impl Texels {
    /// Number of texels.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(codes) => codes.len(),
            Self::F16(codes) => codes.len(),
            Self::F32(codes) => codes.len(),
        }
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> u64 {
        let texel = match self {
            Self::U8(_) => 1,
            Self::F16(_) => 2,
            Self::F32(_) => 4,
        };
        self.len() as u64 * texel
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl RelightingMap {
    /// Writes the coefficients of texels `first ..` to `out`: scale * q + bias, in f32.
    ///
    /// # Panics
    /// When the texels end before `out` does.
    pub fn coefficients(&self, first: usize, out: &mut [f32]) {
        let (scale, bias) = (self.scale, self.bias);
        let end = first + out.len();
        match &self.texels {
            Texels::U8(codes) => {
                for (value, code) in out.iter_mut().zip(&codes[first..end]) {
                    *value = scale * (f32::from(*code) / 255.0) + bias;
                }
            }
            Texels::F16(codes) => {
                for (value, code) in out.iter_mut().zip(&codes[first..end]) {
                    *value = scale * code.to_f32() + bias;
                }
            }
            Texels::F32(codes) => {
                for (value, code) in out.iter_mut().zip(&codes[first..end]) {
                    *value = scale * code + bias;
                }
            }
        }
    }
}

impl RelightingMaps {
    /// Pixels of a plane.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Bytes of all planes' texels.
    pub fn texel_bytes(&self) -> u64 {
        self.planes.iter().map(|plane| plane.texels.bytes()).sum()
    }

    /// The planes in f32 again.
    pub fn coefficient_map(&self) -> CoefficientMap {
        let planes = self
            .planes
            .iter()
            .map(|plane| {
                let mut coefficients = vec![0.0; self.pixels()];
                plane.coefficients(0, &mut coefficients);
                coefficients
            })
            .collect();
        CoefficientMap { width: self.width, height: self.height, model: self.model.clone(), planes }
    }
}
