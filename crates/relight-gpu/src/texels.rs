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

/// Texels of `from` channels as bytes of floats of `to` channels; what is added is 0, the fourth 1.
fn floats_of_channels(texels: &[f32], from: usize, to: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(texels.len() / from * to * 4);
    for texel in texels.chunks_exact(from) {
        for channel in 0..to {
            let beyond = if channel == 3 { 1.0 } else { 0.0 };
            bytes.extend(texel.get(channel).unwrap_or(&beyond).to_le_bytes());
        }
    }
    bytes
}

fn halves(bytes: &[u8]) -> impl Iterator<Item = f16> + '_ {
    bytes.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]))
}

fn floats(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}
