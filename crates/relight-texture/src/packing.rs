//! How the planes of an asset lie in textures: arrays of layers, a format each, and how their
//! texels become coefficients again.

use crate::{BlockFormat, Precision, Quantizer};
use relight_core::{Layout, Model, Wrap};

/// How texels lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TexelFormat {
    /// Texels of one or four channels, one after the other.
    Plain {
        /// How a channel is stored.
        precision: Precision,
        /// 1 or 4.
        channels: usize,
    },
    /// Blocks of 4 x 4 texels.
    Block(BlockFormat),
}

/// Values that the channels of a format hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TexelDomain {
    /// 0 to 1.
    Unit,
    /// -1 to 1.
    Signed,
    /// Halves.
    Half,
    /// Floats.
    Float,
}

/// What the channels of a layer hold: channel c is plane `planes[c]` in the order of
/// [`Model::roles`], coefficient = scale x texel + bias by `quantizers[c]`.
///
/// Channels of the format beyond the planes are 0, the fourth 1.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerPlan {
    /// Index of the plane in each channel.
    pub planes: Vec<usize>,
    /// One a plane.
    pub quantizers: Vec<Quantizer>,
}

/// An array texture: layers of one format.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayPlan {
    /// How texels lie in memory.
    pub format: TexelFormat,
    /// At least one.
    pub layers: Vec<LayerPlan>,
}

/// Where every plane of an asset lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Packing {
    /// Every plane is in one layer of one of them.
    pub arrays: Vec<ArrayPlan>,
    /// Mip levels, 1 for none but the picture itself.
    pub levels: usize,
    /// What a sampler shall do beyond the edge.
    pub wrap: Wrap,
}

/// An asset as a GPU takes it.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedMaps {
    /// Pixels in a row of level 0.
    pub width: usize,
    /// Rows of level 0.
    pub height: usize,
    /// How planes and light become pixels.
    pub model: Model,
    /// Where every plane lies.
    pub packing: Packing,
    /// Bytes by array, then level: the layers one after another, each [`TexelFormat::layer_bytes`]
    /// of the level's size, rows (or rows of blocks) from the top.
    pub texels: Vec<Vec<Vec<u8>>>,
}

/// Width or height of mip level `level` of `size` texels: halved and rounded down each time, at
/// least 1.
pub fn level_size(size: usize, level: usize) -> usize {
    (size >> level).max(1)
}

/// Levels down to 1 x 1.
pub fn full_levels(width: usize, height: usize) -> usize {
    width.max(height).max(1).ilog2() as usize + 1
}

impl TexelFormat {
    /// Channels of a texel that can hold planes.
    pub fn channels(self) -> usize {
        match self {
            Self::Plain { channels, .. } => channels,
            Self::Block(format) => format.channels(),
        }
    }

    /// Values that a channel holds.
    pub fn domain(self) -> TexelDomain {
        match self {
            Self::Plain { precision: Precision::U8, .. } => TexelDomain::Unit,
            Self::Plain { precision: Precision::F16, .. } => TexelDomain::Half,
            Self::Plain { precision: Precision::F32, .. } => TexelDomain::Float,
            Self::Block(format) => format.domain(),
        }
    }

    /// Texels in a row and a column of its unit: 4 for blocks, 1 for plain texels.
    pub fn unit_size(self) -> usize {
        match self {
            Self::Plain { .. } => 1,
            Self::Block(_) => 4,
        }
    }

    /// Bytes of a unit.
    pub fn unit_bytes(self) -> usize {
        match self {
            Self::Plain { precision, channels } => precision.bytes() * channels,
            Self::Block(format) => format.bytes(),
        }
    }

    /// Bytes of a row of units over `width` texels.
    pub fn row_bytes(self, width: usize) -> u64 {
        width.div_ceil(self.unit_size()) as u64 * self.unit_bytes() as u64
    }

    /// Bytes of a layer of `width` x `height` texels; sizes are filled up to whole units.
    pub fn layer_bytes(self, width: usize, height: usize) -> u64 {
        self.row_bytes(width).saturating_mul(height.div_ceil(self.unit_size()) as u64)
    }

    /// Bytes of a layer of `width` x `height` texels in its first `levels` mip levels.
    pub fn levels_bytes(self, width: usize, height: usize, levels: usize) -> u64 {
        (0..levels).map(|l| self.layer_bytes(level_size(width, l), level_size(height, l))).sum()
    }

    /// Bits that a texel takes.
    pub fn bits(self) -> f64 {
        (self.unit_bytes() * 8) as f64 / (self.unit_size() * self.unit_size()) as f64
    }

    /// `u8`, `f16`, `f32` or the block format's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain { precision, .. } => precision.name(),
            Self::Block(format) => format.name(),
        }
    }

    /// The precision of [`Texels`](relight_core::Texels) that hold a channel of it exactly.
    pub fn decoded_precision(self) -> Precision {
        match self {
            Self::Plain { precision, .. } => precision,
            Self::Block(format) => format.decoded_precision(),
        }
    }
}

impl Packing {
    /// Formats of all arrays, in order.
    pub fn formats(&self) -> impl Iterator<Item = TexelFormat> + '_ {
        self.arrays.iter().map(|array| array.format)
    }

    /// Names of those formats, neighbours that are alike once.
    pub fn format_names(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.formats().map(TexelFormat::name).collect();
        names.dedup();
        names
    }

    /// Layers of all arrays.
    pub fn layers(&self) -> usize {
        self.arrays.iter().map(|array| array.layers.len()).sum()
    }

    /// Whether writers need whole rows of blocks rather than any run of pixels.
    pub fn needs_rows(&self) -> bool {
        needs_rows(self.formats(), self.levels)
    }

    /// Bytes of the texels of all layers and levels of a picture of `width` x `height` pixels, without padding.
    pub fn texel_bytes(&self, width: usize, height: usize) -> u64 {
        let layers = |array: &ArrayPlan| {
            array.format.levels_bytes(width, height, self.levels) * array.layers.len() as u64
        };
        self.arrays.iter().map(layers).sum()
    }

    /// Bytes of level 0 a pixel, over all layers, without padding.
    pub fn bits_per_pixel(&self) -> f64 {
        self.arrays.iter().map(|array| array.format.bits() * array.layers.len() as f64).sum()
    }
}

/// Whether writers of `formats` and `levels` need whole rows of blocks rather than any run of pixels.
pub fn needs_rows(mut formats: impl Iterator<Item = TexelFormat>, levels: usize) -> bool {
    levels > 1 || formats.any(|format| format.unit_size() > 1)
}

/// The planes in the channels of each layer of `format`.
///
/// RGB: the three planes of a function in a layer where the format has three channels; in BC3,
/// which has four, the planes of further functions fill the fourth; otherwise planes one after
/// another. Grey, shared and luminance planes fill the channels; base colour has layers of its own.
pub fn planes_of_layers(model: &Model, format: TexelFormat) -> Vec<Vec<usize>> {
    let channels = format.channels();
    let planes: Vec<usize> = (0..model.plane_count()).collect();
    let chunks = |planes: &[usize]| planes.chunks(channels).map(<[usize]>::to_vec).collect::<Vec<_>>();
    match model.layout {
        Layout::Rgb if format == TexelFormat::Block(BlockFormat::Bc3) => {
            let layers = planes.len().div_ceil(4);
            let (colors, rest) = planes.split_at(3 * layers.min(planes.len() / 3));
            let mut layers: Vec<Vec<usize>> = colors.chunks(3).map(<[usize]>::to_vec).collect();
            for (layer, plane) in layers.iter_mut().zip(rest) {
                layer.push(*plane);
            }
            layers
        }
        Layout::Rgb if channels >= 3 => planes.chunks(3).map(<[usize]>::to_vec).collect(),
        Layout::Rgb | Layout::Grey | Layout::Shared => chunks(&planes),
        Layout::Lrgb => {
            let (luminance, base) = planes.split_at(model.maps());
            let mut layers = chunks(luminance);
            layers.extend(chunks(base));
            layers
        }
    }
}
