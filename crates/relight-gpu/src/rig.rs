//! Rigs on the GPU: the source that `relight-shader` writes, at any points.

use crate::picture::{FORMAT, GpuPicture, band_rows};
use crate::program::{Input, Program, numbers};
use crate::{Gpu, GpuError};
use relight_core::relighter::Picture;
use relight_rig::{Frame, Model};
use relight_shader::{Language, RigShaderOptions, rig_shader};
use wgpu::CommandEncoderDescriptor;

/// Points in a row of the pictures that they travel in.
const WIDTH: usize = 256;

/// A rig's model under some lights.
#[derive(Clone, Copy, Debug)]
pub struct RigUnderLights<'a> {
    /// How its vectors are blended.
    pub model: &'a Model,
    /// The box in whose coordinates they are.
    pub frame: &'a Frame,
    /// Bands of harmonics, 1 to 6.
    pub bands: usize,
    /// R, G, B of radiance: vectors x bands^2, row-major.
    pub coefficients: &'a [[f32; 3]],
}

/// A surface point and a sphere light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereSight {
    /// Where the surface is.
    pub position: [f32; 3],
    /// Its unit normal.
    pub normal: [f32; 3],
    /// The light's middle.
    pub centre: [f32; 3],
    /// Its radius, above 0.
    pub radius: f32,
}

impl RigUnderLights<'_> {
    /// R, G, B of reflected radiance of a white diffuser at points of the mesh (position, unit normal).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] beyond 256 x the adapter's largest texture, and what else the driver says.
    ///
    /// # Panics
    /// As [`rig_shader`], and when there are not vectors x bands^2 coefficients.
    pub fn reflectance(&self, gpu: &Gpu, points: &[([f32; 3], [f32; 3])]) -> Result<Vec<[f32; 3]>, GpuError> {
        let count = self.model.parameters().len() * self.bands * self.bands;
        assert_eq!(self.coefficients.len(), count, "a coefficient for every function of every vector");
        let [positions, normals] = [0, 1].map(|which| {
            points.iter().map(move |point| if which == 0 { point.0 } else { point.1 }).map(opaque).collect()
        });
        let coefficients = self.coefficients.iter().copied().map(opaque).collect();
        let call = "relight_reflectance(read(first, texel).xyz, read(second, texel).xyz)";
        self.drawn(gpu, [positions, normals, coefficients], points.len(), call, false)
    }

    /// Reflected radiance of a white diffuser under sphere lights of radiance 1.
    ///
    /// # Errors
    /// As [`Self::reflectance`].
    pub fn sphere_reflectance(&self, gpu: &Gpu, sights: &[SphereSight]) -> Result<Vec<f32>, GpuError> {
        let positions = sights.iter().map(|sight| opaque(sight.position)).collect();
        let normals = sights.iter().map(|sight| opaque(sight.normal)).collect();
        let lights =
            sights.iter().map(|&SphereSight { centre: [x, y, z], radius, .. }| [x, y, z, radius]).collect();
        let light = "read(third, texel)";
        let call = format!(
            "vec3<f32>(relight_sphere_reflectance(read(first, texel).xyz, read(second, texel).xyz, {light}.xyz, {light}.w))"
        );
        let drawn = self.drawn(gpu, [positions, normals, lights], sights.len(), &call, true)?;
        Ok(drawn.into_iter().map(|[value, ..]| value).collect())
    }

    /// `call` for the texel of each point.
    fn drawn(
        &self,
        gpu: &Gpu,
        inputs: [Vec<[f32; 4]>; 3],
        count: usize,
        call: &str,
        sphere_lights: bool,
    ) -> Result<Vec<[f32; 3]>, GpuError> {
        let options = RigShaderOptions { language: Language::Wgsl, sphere_lights };
        let text = rig_shader(self.model, self.frame, self.bands, &options);
        let source = format!(
            "{text}
struct Numbers {{ first_row: i32, unused_1: i32, unused_2: i32, unused_3: i32 }}
@group(0) @binding(0) var<uniform> numbers: Numbers;
@group(0) @binding(1) var first: texture_2d<u32>;
@group(0) @binding(2) var second: texture_2d<u32>;
@group(0) @binding(3) var third: texture_2d<u32>;

fn read(picture: texture_2d<u32>, texel: vec2<i32>) -> vec4<f32> {{
    return bitcast<vec4<f32>>(textureLoad(picture, texel, 0));
}}

fn relight_coefficient(index: i32) -> vec3<f32> {{
    return read(third, vec2<i32>(index % {WIDTH}, index / {WIDTH})).xyz;
}}

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {{
    let texel = vec2<i32>(at.xy) + vec2<i32>(0, numbers.first_row);
    return bitcast<vec4<u32>>(vec4<f32>({call}, 1.0));
}}
"
        );
        let program = Program::new(
            gpu,
            &source,
            &[Input::Numbers, Input::Picture, Input::Picture, Input::Picture],
            FORMAT,
        )?;
        let buffer = numbers(gpu, 16);
        let mut pictures = Vec::new();
        for input in inputs {
            pictures.push(GpuPicture::from_picture(gpu, &rows_of(input))?);
        }
        let height = count.div_ceil(WIDTH).max(1);
        let rows = band_rows(WIDTH, height);
        let mut target = GpuPicture::new(gpu, WIDTH, rows)?;
        let bound = program.bind(gpu, [&buffer], pictures.iter().map(|picture| &picture.view));
        let mut samples = Vec::with_capacity(3 * WIDTH * height);
        for first_row in (0..height).step_by(rows) {
            let mut commands = gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
            gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&[first_row as i32, 0, 0, 0]));
            program.run(&mut commands, &bound, &target.view);
            target.read_after(gpu, commands, rows.min(height - first_row), 3, &mut samples)?;
        }
        Ok(samples.chunks_exact(3).take(count).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect())
    }
}

fn opaque([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 1.0]
}

/// Texels in rows of [`WIDTH`], the last of them filled up.
fn rows_of(mut texels: Vec<[f32; 4]>) -> Picture {
    let height = texels.len().div_ceil(WIDTH).max(1);
    texels.resize(WIDTH * height, [0.0, 0.0, 1.0, 1.0]);
    Picture { width: WIDTH, height, channels: 4, samples: texels.into_flattened() }
}
