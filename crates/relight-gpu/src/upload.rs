//! Packed maps as textures.

use crate::texels::{LayerPlace, layer_bytes};
use crate::texture_format::texture_format;
use crate::{Gpu, GpuError};
use relight_core::basis::Learned;
use relight_texture::{PackedMaps, TexelFormat, function_texels, level_size};
use std::ops::Range;
use wgpu::{
    Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect,
    TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView, TextureViewDescriptor,
    TextureViewDimension,
};

/// The arrays of `maps` as array textures with all their levels, in order.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`] and what else the driver says.
pub(crate) fn upload(gpu: &Gpu, maps: &PackedMaps) -> Result<Vec<TextureView>, GpuError> {
    let arrays = maps.packing.arrays.iter().enumerate();
    arrays.map(|(array, plan)| upload_array(gpu, maps, array, 0..plan.layers.len())).collect()
}

/// Some layers of an array as an array texture with all their levels.
pub(crate) fn upload_array(
    gpu: &Gpu,
    maps: &PackedMaps,
    array: usize,
    layers: Range<usize>,
) -> Result<TextureView, GpuError> {
    let plan = &maps.packing.arrays[array];
    let limit = gpu.device.limits().max_texture_dimension_2d as usize;
    if maps.width.max(maps.height).next_multiple_of(plan.format.unit_size()) > limit {
        return Err(GpuError::TooLarge { width: maps.width, height: maps.height, limit });
    }
    // Whole blocks, as wgpu wants level 0 to be; the true texels lie in the upper left.
    let size = array_extent(gpu, whole_units(plan.format, maps.width, maps.height), layers.len());
    let texture = array_texture(gpu, "maps", size, maps.packing.levels, texture_format(plan.format))?;
    for level in 0..maps.packing.levels {
        let (width, height) = (level_size(maps.width, level), level_size(maps.height, level));
        for (to_layer, layer) in layers.clone().enumerate() {
            let to = TexelCopyTextureInfo {
                texture: &texture,
                mip_level: level as u32,
                origin: Origin3d { x: 0, y: 0, z: to_layer as u32 },
                aspect: TextureAspect::All,
            };
            let layout = TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(plan.format.row_bytes(width) as u32),
                rows_per_image: None,
            };
            let bytes = layer_bytes(maps, LayerPlace { array, layer, level });
            gpu.queue.write_texture(to, bytes, layout, extent(whole_units(plan.format, width, height), 1));
        }
        // Staged bytes are let go level by level rather than all at the first draw.
        gpu.queue.submit([]);
    }
    gpu.check()?;
    Ok(array_view(&texture))
}

/// A texture of `size.depth_or_array_layers` layers to be filled.
fn array_texture(
    gpu: &Gpu,
    label: &str,
    size: Extent3d,
    levels: usize,
    format: TextureFormat,
) -> Result<Texture, GpuError> {
    let texture = gpu.device.create_texture(&TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: levels as u32,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.check()?;
    Ok(texture)
}

/// All layers and levels, as array samplers read them.
fn array_view(texture: &Texture) -> TextureView {
    texture.create_view(&TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2Array),
        ..TextureViewDescriptor::default()
    })
}

fn whole_units(format: TexelFormat, width: usize, height: usize) -> (usize, usize) {
    let unit = format.unit_size();
    (width.next_multiple_of(unit), height.next_multiple_of(unit))
}

/// The size of an array texture that holds `layers`.
///
/// wgpu's OpenGL makes a plain texture of an array of one layer and cubes of six squares, which array samplers don't read: there
/// it has a layer more.
fn array_extent(gpu: &Gpu, size: (usize, usize), layers: usize) -> Extent3d {
    let is_other = layers == 1 || size.0 == size.1 && layers.is_multiple_of(6);
    let more = is_other && gpu.adapter.get_info().backend == wgpu::Backend::Gl;
    extent(size, layers + usize::from(more))
}

fn extent((width, height): (usize, usize), layers: usize) -> Extent3d {
    Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: layers as u32 }
}

/// The table of learned functions, four in a texel, as an array texture.
///
/// # Errors
/// As of [`upload`].
pub(crate) fn upload_table(gpu: &Gpu, learned: &Learned) -> Result<TextureView, GpuError> {
    let (nodes, texels) = (learned.square().nodes, function_texels(learned));
    let layers = texels.len() / (nodes * nodes);
    let size = array_extent(gpu, (nodes, nodes), layers);
    let texture = array_texture(gpu, "functions", size, 1, TextureFormat::Rgba16Float)?;
    let layout = TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some((nodes * 8) as u32),
        rows_per_image: Some(nodes as u32),
    };
    let written = extent((nodes, nodes), layers);
    gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, written);
    gpu.check()?;
    Ok(array_view(&texture))
}
