//! How far the GPU's own decoding of textures is from ours.

use crate::picture::{FORMAT, GpuPicture, band_rows};
use crate::program::{Input, Program, numbers};
use crate::texels::{LayerPlace, layer_texels};
use crate::upload::upload_array;
use crate::{Gpu, GpuError};
use relight_texture::{PackedMaps, TexelFormat, level_size};
use wgpu::CommandEncoderDescriptor;

/// What the GPU samples from a layer, beside what our decoder makes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodingDifference {
    /// Index of the array.
    pub array: usize,
    /// Index of the layer in it.
    pub layer: usize,
    /// The array's format.
    pub format: TexelFormat,
    /// The largest difference of a channel that holds a plane, in units of the format's domain.
    pub max: f64,
    /// The mean difference.
    pub mean: f64,
}

const SOURCE: &str = "
struct Numbers { layer: i32, level: i32, first_row: i32, unused: i32 }
@group(0) @binding(0) var<uniform> numbers: Numbers;
@group(0) @binding(1) var texels: texture_2d_array<f32>;

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let texel = vec2<i32>(at.xy) + vec2<i32>(0, numbers.first_row);
    return bitcast<vec4<u32>>(textureLoad(texels, texel, numbers.layer, numbers.level));
}
";

/// The differences of every layer whose format the adapter samples, array by array.
///
/// # Errors
/// [`GpuError`] when the textures don't fit or the driver fails.
///
/// # Panics
/// When there is no such level.
pub fn decoding_differences(
    gpu: &Gpu,
    maps: &PackedMaps,
    level: usize,
) -> Result<Vec<DecodingDifference>, GpuError> {
    let (width, height) = (level_size(maps.width, level), level_size(maps.height, level));
    let program = Program::new(gpu, SOURCE, &[Input::Numbers, Input::Array], FORMAT)?;
    let buffer = numbers(gpu, 16);
    let rows = band_rows(width, height);
    let mut target = GpuPicture::new(gpu, width, rows)?;
    let mut differences = Vec::new();
    for (array, plan) in maps.packing.arrays.iter().enumerate() {
        if !gpu.samples(plan.format) {
            continue;
        }
        // A layer at a time: any number of them fits.
        for (layer, of_layer) in plan.layers.iter().enumerate() {
            let texture = upload_array(gpu, maps, array, layer..layer + 1)?;
            let inputs = program.bind(gpu, [&buffer], [&texture]);
            let mut sampled = Vec::with_capacity(width * height * 4);
            for first_row in (0..height).step_by(rows) {
                let mut commands = gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
                let numbers = [0, level as i32, first_row as i32, 0];
                gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&numbers));
                program.run(&mut commands, &inputs, &target.view);
                target.read_after(gpu, commands, rows.min(height - first_row), 4, &mut sampled)?;
            }
            let ours = layer_texels(maps, LayerPlace { array, layer, level });
            let (mut max, mut sum) = (0.0f64, 0.0);
            for (gpus, ours) in sampled.chunks_exact(4).zip(ours.chunks_exact(plan.format.channels())) {
                for channel in 0..of_layer.planes.len() {
                    let difference = (f64::from(gpus[channel]) - f64::from(ours[channel])).abs();
                    // NaN, which no decoder should make, is as wrong as can be.
                    max = if difference.is_nan() { f64::INFINITY } else { max.max(difference) };
                    sum += difference;
                }
            }
            let count = (width * height * of_layer.planes.len()) as f64;
            differences.push(DecodingDifference {
                array,
                layer,
                format: plan.format,
                max,
                mean: sum / count,
            });
        }
    }
    Ok(differences)
}
