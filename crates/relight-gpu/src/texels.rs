//! Texels as floats: what the CPU takes them for, whatever their format.

use half::f16;
use rayon::prelude::*;
use relight_core::{RelightingMap, RelightingMaps, Texels};
use relight_texture::{
    ArrayPlan, PackedMaps, Packing, Precision, TexelFormat, decode_blocks, decode_channel, level_size,
};

/// Where a layer lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LayerPlace {
    pub(crate) array: usize,
    pub(crate) layer: usize,
    pub(crate) level: usize,
}

/// Bytes of a layer as it lies in a file.
pub(crate) fn layer_bytes(maps: &PackedMaps, place: LayerPlace) -> &[u8] {
    let (width, height) = (level_size(maps.width, place.level), level_size(maps.height, place.level));
    let bytes = maps.packing.arrays[place.array].format.layer_bytes(width, height) as usize;
    &maps.texels[place.array][place.level][place.layer * bytes..][..bytes]
}

/// Texels of a layer in the format's domain, its channels interleaved, by our own decoders.
pub(crate) fn layer_texels(maps: &PackedMaps, place: LayerPlace) -> Vec<f32> {
    let format = maps.packing.arrays[place.array].format;
    let bytes = layer_bytes(maps, place);
    match format {
        TexelFormat::Block(block) => {
            let (width, height) = (level_size(maps.width, place.level), level_size(maps.height, place.level));
            let mut texels = vec![0.0; width * height * format.channels()];
            decode_blocks(block, bytes, width, &mut texels);
            texels
        }
        TexelFormat::Plain { precision: Precision::U8, .. } => {
            bytes.iter().map(|code| f32::from(*code) / 255.0).collect()
        }
        TexelFormat::Plain { precision: Precision::F16, .. } => halves(bytes).map(f16::to_f32).collect(),
        TexelFormat::Plain { precision: Precision::F32, .. } => floats(bytes).collect(),
    }
}

/// The asset of mip level `level` as the reference relighter takes it, blocks decoded by our own
/// decoders.
///
/// # Panics
/// When there is no such level.
pub fn maps_of_level(maps: &PackedMaps, level: usize) -> RelightingMaps {
    let (width, height) = (level_size(maps.width, level), level_size(maps.height, level));
    let mut places = vec![None; maps.model.plane_count()];
    for (array, plan) in maps.packing.arrays.iter().enumerate() {
        for (layer, plan) in plan.layers.iter().enumerate() {
            for (channel, (plane, quantizer)) in plan.planes.iter().zip(&plan.quantizers).enumerate() {
                places[*plane] = Some((LayerPlace { array, layer, level }, channel, *quantizer));
            }
        }
    }
    let planes = places.into_par_iter().flatten().map(|(place, channel, quantizer)| RelightingMap {
        scale: quantizer.scale,
        bias: quantizer.bias,
        texels: channel_texels(maps, place, channel),
    });
    RelightingMaps { width, height, model: maps.model.clone(), planes: planes.collect() }
}

/// Texels of one channel of a layer, in a precision that holds them exactly.
fn channel_texels(maps: &PackedMaps, place: LayerPlace, channel: usize) -> Texels {
    let format = maps.packing.arrays[place.array].format;
    let bytes = layer_bytes(maps, place);
    let every = format.channels();
    match format {
        TexelFormat::Block(block) => {
            let (width, height) = (level_size(maps.width, place.level), level_size(maps.height, place.level));
            decode_channel(block, bytes, width, height, channel)
        }
        TexelFormat::Plain { precision: Precision::U8, .. } => {
            Texels::U8(bytes.iter().skip(channel).step_by(every).copied().collect())
        }
        TexelFormat::Plain { precision: Precision::F16, .. } => {
            Texels::F16(halves(bytes).skip(channel).step_by(every).collect())
        }
        TexelFormat::Plain { precision: Precision::F32, .. } => {
            Texels::F32(floats(bytes).skip(channel).step_by(every).collect())
        }
    }
}

/// The same asset with those arrays as textures of floats whose format `as_floats` picks.
pub(crate) fn with_floats(maps: &PackedMaps, as_floats: impl Fn(TexelFormat) -> bool) -> PackedMaps {
    let mut packing = Packing { arrays: Vec::new(), ..maps.packing.clone() };
    let mut texels = Vec::new();
    for (array, plan) in maps.packing.arrays.iter().enumerate() {
        if !as_floats(plan.format) {
            packing.arrays.push(plan.clone());
            texels.push(maps.texels[array].clone());
            continue;
        }
        let channels = if plan.format.channels() == 1 { 1 } else { 4 };
        let format = TexelFormat::Plain { precision: Precision::F32, channels };
        packing.arrays.push(ArrayPlan { format, layers: plan.layers.clone() });
        let level_bytes = |level: usize| -> Vec<u8> {
            let layers = (0..plan.layers.len()).into_par_iter().map(|layer| {
                let texels = layer_texels(maps, LayerPlace { array, layer, level });
                floats_of_channels(&texels, plan.format.channels(), channels)
            });
            layers.collect::<Vec<_>>().concat()
        };
        texels.push((0..maps.packing.levels).map(level_bytes).collect());
    }
    PackedMaps { width: maps.width, height: maps.height, model: maps.model.clone(), packing, texels }
}

/// The same asset with arrays of `most` layers at most.
pub(crate) fn with_layers_at_most(maps: PackedMaps, most: usize) -> PackedMaps {
    if maps.packing.arrays.iter().all(|plan| plan.layers.len() <= most) {
        return maps;
    }
    let mut packing = Packing { arrays: Vec::new(), ..maps.packing.clone() };
    let mut texels = Vec::new();
    for (plan, levels) in maps.packing.arrays.iter().zip(&maps.texels) {
        let count = plan.layers.len();
        for (part, layers) in plan.layers.chunks(most).enumerate() {
            packing.arrays.push(ArrayPlan { format: plan.format, layers: layers.to_vec() });
            let part_of = |level: &Vec<u8>| {
                let layer = level.len() / count;
                level[part * most * layer..][..layers.len() * layer].to_vec()
            };
            texels.push(levels.iter().map(part_of).collect());
        }
    }
    PackedMaps { packing, texels, ..maps }
}

/// Texels of `from` channels as bytes of floats of `to` channels, those that are added 0.
fn floats_of_channels(texels: &[f32], from: usize, to: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(texels.len() / from * to * 4);
    for texel in texels.chunks_exact(from) {
        let added = std::iter::repeat_n(&0.0, to - from);
        bytes.extend(texel.iter().chain(added).flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

fn halves(bytes: &[u8]) -> impl Iterator<Item = f16> + '_ {
    bytes.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]))
}

fn floats(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::{Design, Family, Layout, LightSet, Model, Space};
    use relight_texture::{LayerPlan, Quantizer, Wrap};

    /// Five planes of codes in layers of one channel, out of order, with two levels.
    fn maps() -> PackedMaps {
        let basis = Family::by_name("srbf").unwrap().build(&Design::new(5, &LightSet::default())).unwrap();
        let model = Model {
            basis,
            layout: Layout::Grey,
            space: Space::Linear,
            lights: vec![],
            figures: None,
            provenance: None,
        };
        let layer = |plane: usize| LayerPlan {
            planes: vec![plane],
            quantizers: vec![Quantizer { scale: 1.0 + plane as f32, bias: -0.5 * plane as f32 }],
        };
        let format = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
        let array = ArrayPlan { format, layers: [3, 0, 4, 1, 2].map(layer).to_vec() };
        let codes = |texels: u8, first: u8| (0..5 * texels).map(|i| first + 7 * i).collect::<Vec<_>>();
        let texels = vec![vec![codes(6, 1), codes(1, 200)]];
        let packing = Packing { arrays: vec![array], levels: 2, wrap: Wrap::Clamp };
        PackedMaps { width: 3, height: 2, model, packing, texels }
    }

    #[test]
    fn arrays_in_parts_and_arrays_of_floats_hold_the_same_coefficients() {
        let whole = maps();
        let parts = with_layers_at_most(maps(), 2);
        assert_eq!(parts.packing.arrays.iter().map(|a| a.layers.len()).collect::<Vec<_>>(), [2, 2, 1]);
        let floats = with_floats(&parts, |_| true);
        for level in [0, 1] {
            let expected = maps_of_level(&whole, level).coefficient_map();
            assert_eq!(maps_of_level(&parts, level).coefficient_map(), expected);
            assert_eq!(maps_of_level(&floats, level).coefficient_map(), expected);
        }
        // Plane 3 lies in the first layer: 4 x code / 255 - 1.5.
        let map = maps_of_level(&whole, 0).coefficient_map();
        assert_eq!(map.planes[3][2], 4.0 * (15.0 / 255.0) - 1.5);
    }
}
