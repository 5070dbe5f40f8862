//! An asset on the GPU, lit by the shader that `relight shader` writes.

use crate::picture::{FORMAT, GpuPicture, band_rows};
use crate::program::{Input, Program, numbers};
use crate::texels::{with_floats, with_layers_at_most};
use crate::upload::{upload, upload_table};
use crate::{Gpu, GpuError};
use relight_core::relighter::Picture;
use relight_core::{Basis, Direction, Layout, PlaneRole};
use relight_shader::{Language, ShaderOptions, shader, weight_count};
use relight_texture::{PackedMaps, TexelFormat, level_size};
use std::fmt::Write as _;
use wgpu::{BindGroup, Buffer, CommandEncoder, CommandEncoderDescriptor, TextureView};

/// Who decodes the texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureMode {
    /// The GPU, from the bytes of the file. Formats that the adapter doesn't sample are decoded.
    Native,
    /// We do; the GPU gets floats.
    Decoded,
}

/// An asset on the GPU.
#[derive(Debug)]
pub struct GpuMaps {
    /// Formats that the adapter doesn't sample: their texels went there as floats.
    pub decoded: Vec<TexelFormat>,
    gpu: Gpu,
    width: usize,
    height: usize,
    channels: usize,
    weights: Weights,
    sum: Sum,
    /// What was drawn into last, for the next draw of that size.
    target: Option<GpuPicture>,
}

/// The weights of the layers under a light, worked out once a light.
#[derive(Debug)]
struct Weights {
    program: Program,
    light: Buffer,
    inputs: BindGroup,
    /// A pixel a weight.
    drawn: GpuPicture,
    /// The same for the sum.
    weights: Buffer,
}

/// The sum over the maps.
#[derive(Debug)]
struct Sum {
    program: Program,
    /// Level, first row, pass.
    numbers: Buffer,
    arrays: Vec<TextureView>,
    passes: Option<Passes>,
}

/// How the sum is made in passes.
#[derive(Debug)]
struct Passes {
    count: usize,
    /// What the sum is multiplied by in the end, where it is.
    finish: Option<Program>,
}

impl GpuMaps {
    /// Uploads `maps` and compiles their shader. With `maps_per_pass`, the shader sums so many
    /// layers at a time: each pass reads the sum so far and writes it anew, as additive blending
    /// would, on adapters too that don't blend floats.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::TooManyTextures`], [`GpuError::OutOfMemory`] and what
    /// else the driver says.
    ///
    /// # Panics
    /// When the texels are not those of the packing, or `maps_per_pass` is 0.
    pub fn upload(
        gpu: &Gpu,
        maps: &PackedMaps,
        mode: TextureMode,
        maps_per_pass: Option<usize>,
    ) -> Result<Self, GpuError> {
        let mut decoded: Vec<TexelFormat> = Vec::new();
        for format in maps.packing.formats().filter(|format| !gpu.samples(*format)) {
            if !decoded.contains(&format) {
                decoded.push(format);
            }
        }
        let as_floats = |format| mode == TextureMode::Decoded || decoded.contains(&format);
        let most_layers = gpu.device.limits().max_texture_array_layers as usize;
        let maps = with_layers_at_most(with_floats(maps, as_floats), most_layers);

        let options = ShaderOptions { language: Language::Wgsl, maps_per_pass };
        let text = shader(&maps.model, &maps.packing, maps.width, maps.height, &options);
        let weights = weight_count(&maps.model, &maps.packing);
        let table = match &maps.model.basis {
            Basis::Learned(learned) => Some(upload_table(gpu, learned)?),
            _ => None,
        };
        Ok(Self {
            decoded,
            gpu: gpu.clone(),
            width: maps.width,
            height: maps.height,
            channels: maps.model.channels(),
            weights: Weights::new(gpu, &text, weights.0, table)?,
            sum: Sum::new(gpu, &text, &maps, weights.1, maps_per_pass)?,
            target: None,
        })
    }

    /// The picture of mip level `level` under a light, in the asset's own space, not clipped.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::Lost`] and what else the driver says.
    pub fn draw(&mut self, light: Direction, level: usize) -> Result<Picture, GpuError> {
        let (width, height) = (level_size(self.width, level), level_size(self.height, level));
        let rows = band_rows(width, height);
        let target = self.target.take().filter(|target| (target.width, target.height) == (width, rows));
        let mut target = match target {
            Some(target) => target,
            None => GpuPicture::new(&self.gpu, width, rows)?,
        };
        self.weights.light(&self.gpu, light);
        let mut samples = Vec::with_capacity(width * height * self.channels);
        for first_row in (0..height).step_by(rows) {
            let commands =
                self.sum.fill(&self.gpu, &self.weights.weights, (level, first_row), &mut target)?;
            let rows = rows.min(height - first_row);
            target.read_after(&self.gpu, commands, rows, self.channels, &mut samples)?;
        }
        self.target = Some(target);
        Ok(Picture { width, height, channels: self.channels, samples })
    }

    /// The same, left on the GPU.
    ///
    /// # Errors
    /// As [`GpuMaps::draw`], and [`GpuError::TooLarge`].
    pub fn draw_on_gpu(&mut self, light: Direction, level: usize) -> Result<GpuPicture, GpuError> {
        let (width, height) = (level_size(self.width, level), level_size(self.height, level));
        let mut target = GpuPicture::new(&self.gpu, width, height)?;
        self.weights.light(&self.gpu, light);
        let commands = self.sum.fill(&self.gpu, &self.weights.weights, (level, 0), &mut target)?;
        self.gpu.finish(commands.finish())?;
        Ok(target)
    }
}

impl Weights {
    fn new(gpu: &Gpu, text: &str, count: usize, table: Option<TextureView>) -> Result<Self, GpuError> {
        let (declared, argument, inputs) = match table {
            Some(_) => (
                "@group(0) @binding(1) var functions: texture_2d_array<f32>;",
                ", functions",
                &[Input::Numbers, Input::Array][..],
            ),
            None => ("", "", &[Input::Numbers][..]),
        };
        let source = format!(
            "{text}
@group(0) @binding(0) var<uniform> light: vec4<f32>;
{declared}

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {{
    var weights = relight_weights(light.xyz{argument});
    return bitcast<vec4<u32>>(weights[i32(at.x)]);
}}
"
        );
        let program = Program::new(gpu, &source, inputs, FORMAT)?;
        let light = numbers(gpu, 16);
        let inputs = program.bind(gpu, [&light], &table);
        let drawn = GpuPicture::new(gpu, count, 1)?;
        Ok(Self { program, light, inputs, drawn, weights: numbers(gpu, count * 16) })
    }

    /// Works the weights of a light out.
    fn light(&self, gpu: &Gpu, light: Direction) {
        let [x, y, z] = light.components().map(|c| c as f32);
        gpu.queue.write_buffer(&self.light, 0, bytemuck::cast_slice(&[x, y, z, 0.0]));
        let mut commands = commands(gpu);
        self.program.run(&mut commands, &self.inputs, &self.drawn.view);
        self.drawn.copy_row(&mut commands, &self.weights);
        gpu.queue.submit([commands.finish()]);
    }
}

impl Sum {
    fn new(
        gpu: &Gpu,
        text: &str,
        maps: &PackedMaps,
        weight_count: &str,
        maps_per_pass: Option<usize>,
    ) -> Result<Self, GpuError> {
        let names =
            |arrays: usize| (0..arrays).fold(String::new(), |names, i| names + &format!("maps_{i}, "));
        let count = maps.packing.arrays.len();
        let head = |first: usize| {
            let mut text = format!(
                "{text}
struct Numbers {{ level: i32, first_row: i32, pass_index: i32, unused: i32 }}
@group(0) @binding(0) var<uniform> numbers: Numbers;
@group(0) @binding(1) var<uniform> weights: array<vec4<f32>, {weight_count}>;
"
            );
            for array in 0..count {
                let binding = first + array;
                let _ =
                    writeln!(text, "@group(0) @binding({binding}) var maps_{array}: texture_2d_array<f32>;");
            }
            text
        };
        let body = |value: &str| {
            format!(
                "
@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {{
    let here = vec2<i32>(at.xy);
    let texel = here + vec2<i32>(0, numbers.first_row);
    return bitcast<vec4<u32>>(vec4<f32>({value}, 1.0));
}}
"
            )
        };
        let so_far = "@group(0) @binding(2) var so_far: texture_2d<u32>;\n";
        let compile = |source: String, inputs: &[Input]| {
            let inputs = [inputs, &vec![Input::Array; count]].concat();
            Program::new(gpu, &source, &inputs, FORMAT)
        };
        let arrays = names(count);
        let (program, passes) = match maps_per_pass {
            None => {
                let value = format!("relight_shade(weights, {arrays}texel, numbers.level)");
                (compile(head(2) + &body(&value), &[Input::Numbers, Input::Numbers])?, None)
            }
            Some(maps_per_pass) => {
                let inputs = [Input::Numbers, Input::Numbers, Input::Picture];
                let terms =
                    format!("relight_shade_pass(numbers.pass_index, weights, {arrays}texel, numbers.level)");
                let sum = "bitcast<vec4<f32>>(textureLoad(so_far, here, 0)).xyz";
                let value = format!("{sum} + {terms}");
                let program = compile(head(3) + so_far + &body(&value), &inputs)?;
                let finish = match maps.model.layout {
                    Layout::Lrgb => {
                        let value = format!("relight_shade_finish({sum}, {arrays}texel, numbers.level)");
                        Some(compile(head(3) + so_far + &body(&value), &inputs)?)
                    }
                    Layout::Grey | Layout::Rgb | Layout::Shared => None,
                };
                (program, Some(Passes { count: lit_layers(maps).div_ceil(maps_per_pass), finish }))
            }
        };
        Ok(Self { program, numbers: numbers(gpu, 16), arrays: upload(gpu, maps)?, passes })
    }

    /// Fills `target` with the rows from `first_row` on; what comes back remains to be submitted.
    fn fill(
        &self,
        gpu: &Gpu,
        weights: &Buffer,
        (level, first_row): (usize, usize),
        target: &mut GpuPicture,
    ) -> Result<CommandEncoder, GpuError> {
        let write = |pass: usize| {
            let numbers = [level as i32, first_row as i32, pass as i32, 0];
            gpu.queue.write_buffer(&self.numbers, 0, bytemuck::cast_slice(&numbers));
        };
        let buffers = [&self.numbers, weights];
        let mut last = commands(gpu);
        let Some(passes) = &self.passes else {
            write(0);
            let inputs = self.program.bind(gpu, buffers, &self.arrays);
            self.program.run(&mut last, &inputs, &target.view);
            return Ok(last);
        };
        // Zeros, as new textures are.
        let mut so_far = GpuPicture::new(gpu, target.width, target.height)?;
        for pass in 0..passes.count {
            write(pass);
            let inputs = self.program.bind(gpu, buffers, [&so_far.view].into_iter().chain(&self.arrays));
            let mut commands = commands(gpu);
            self.program.run(&mut commands, &inputs, &target.view);
            // The numbers of the next pass must not overtake this one.
            gpu.queue.submit([commands.finish()]);
            std::mem::swap(&mut so_far, target);
        }
        match &passes.finish {
            Some(finish) => {
                let inputs = finish.bind(gpu, buffers, [&so_far.view].into_iter().chain(&self.arrays));
                finish.run(&mut last, &inputs, &target.view);
            }
            None => std::mem::swap(&mut so_far, target),
        }
        Ok(last)
    }
}

/// Layers that hold coefficients, rather than what multiplies the sum.
fn lit_layers(maps: &PackedMaps) -> usize {
    let roles = maps.model.roles();
    let layers = maps.packing.arrays.iter().flat_map(|array| &array.layers);
    layers.filter(|layer| matches!(roles[layer.planes[0]], PlaneRole::Coefficient { .. })).count()
}

fn commands(gpu: &Gpu) -> CommandEncoder {
    gpu.device.create_command_encoder(&CommandEncoderDescriptor::default())
}
