//! Pictures of floats in a window.

use crate::picture::GpuPicture;
use crate::program::{Input, Program, numbers};
use crate::{Backend, Gpu, GpuError};
use relight_core::Space;
use std::fmt::Debug;
use std::sync::Arc;
use wgpu::rwh::{HasDisplayHandle, HasWindowHandle};
use wgpu::{
    Buffer, CommandEncoderDescriptor, CurrentSurfaceTexture, PresentMode, Surface, SurfaceConfiguration,
    TextureViewDescriptor,
};

/// A window's surface and what draws pictures into it.
#[derive(Debug)]
pub struct GpuWindow {
    /// The adapter that the window belongs to.
    pub gpu: Gpu,
    surface: Surface<'static>,
    configuration: SurfaceConfiguration,
    program: Program,
    numbers: Buffer,
}

/// How a picture is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Showing {
    /// The values' space; linear ones are encoded on their way.
    pub space: Space,
    /// 1 for a grey picture, else 3.
    pub channels: usize,
    /// Whether pixels blend into each other where the window is larger, rather than being squares.
    pub smooth: bool,
}

const SOURCE: &str = "
struct Numbers { window: vec2<f32>, picture: vec2<f32>, linear: u32, grey: u32, smooth_: u32, target_linear: u32 }
@group(0) @binding(0) var<uniform> numbers: Numbers;
@group(0) @binding(1) var picture: texture_2d<u32>;

fn load(x: i32, y: i32) -> vec3<f32> {
    let last = vec2<i32>(numbers.picture) - 1;
    return bitcast<vec4<f32>>(textureLoad(picture, clamp(vec2<i32>(x, y), vec2<i32>(0), last), 0)).rgb;
}

fn encoded(c: vec3<f32>) -> vec3<f32> {
    let v = clamp(c, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(v, vec3<f32>(1.0 / 2.4)) - 0.055, v * 12.92, v <= vec3<f32>(0.0031308));
}

fn decoded(c: vec3<f32>) -> vec3<f32> {
    let v = clamp(c, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(pow((v + 0.055) / 1.055, vec3<f32>(2.4)), v / 12.92, v <= vec3<f32>(0.04045));
}

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    // As large as fits, in the middle.
    let pixels_per_point = max(numbers.picture.x / numbers.window.x, numbers.picture.y / numbers.window.y);
    let place = (at.xy - 0.5 * numbers.window) * pixels_per_point + 0.5 * numbers.picture;
    if (any(place < vec2<f32>(0.0)) || any(place >= numbers.picture)) {
        return vec4<f32>(0.0, 0.0, 0.0, 1.0);
    }
    var color: vec3<f32>;
    if (numbers.smooth_ == 1u) {
        let corner = floor(place - 0.5);
        let part = place - 0.5 - corner;
        let x = i32(corner.x);
        let y = i32(corner.y);
        color = mix(mix(load(x, y), load(x + 1, y), part.x), mix(load(x, y + 1), load(x + 1, y + 1), part.x), part.y);
    } else {
        color = load(i32(place.x), i32(place.y));
    }
    if (numbers.grey == 1u) { color = color.rrr; }
    if (numbers.linear == 1u) { color = encoded(color); }
    color = clamp(color, vec3<f32>(0.0), vec3<f32>(1.0));
    if (numbers.target_linear == 1u) { color = decoded(color); }
    return vec4<f32>(color, 1.0);
}
";

impl GpuWindow {
    /// Opens the fastest adapter that draws into `window`, which is `width` x `height` physical
    /// pixels.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`], [`GpuError::Window`] and what else the driver says.
    pub fn open<W>(backend: Backend, window: &Arc<W>, (width, height): (u32, u32)) -> Result<Self, GpuError>
    where
        W: HasWindowHandle + HasDisplayHandle + Debug + Send + Sync + 'static,
    {
        let (gpu, surface) = Gpu::open_for_window(backend, window)?;
        let nothing = || GpuError::Window { reason: "its surface has no formats".to_owned() };
        let mut configuration =
            surface.get_default_config(&gpu.adapter, width.max(1), height.max(1)).ok_or_else(nothing)?;
        // Values are encoded by the shader; a format that encodes once more is the second choice.
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        if let Some(plain) = formats.into_iter().find(|format| !format.is_srgb()) {
            configuration.format = plain;
        }
        configuration.present_mode = PresentMode::AutoVsync;
        surface.configure(&gpu.device, &configuration);
        gpu.check()?;
        let program = Program::new(&gpu, SOURCE, &[Input::Numbers, Input::Picture], configuration.format)?;
        let numbers = numbers(&gpu, 32);
        Ok(Self { gpu, surface, configuration, program, numbers })
    }

    /// Takes note of the window's new size in physical pixels.
    ///
    /// # Errors
    /// What the driver says.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<(), GpuError> {
        self.configuration.width = width.max(1);
        self.configuration.height = height.max(1);
        self.surface.configure(&self.gpu.device, &self.configuration);
        self.gpu.check()
    }

    /// Shows `picture` as large as fits. A window that is hidden at the moment shows nothing.
    ///
    /// # Errors
    /// What the driver says.
    pub fn show(&mut self, picture: &GpuPicture, showing: Showing) -> Result<(), GpuError> {
        let frame = match self.surface.get_current_texture() {
            CurrentSurfaceTexture::Success(frame) | CurrentSurfaceTexture::Suboptimal(frame) => frame,
            CurrentSurfaceTexture::Outdated | CurrentSurfaceTexture::Lost => {
                // The window changed: the next frame fits again.
                self.surface.configure(&self.gpu.device, &self.configuration);
                return self.gpu.check();
            }
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => return Ok(()),
            CurrentSurfaceTexture::Validation => return self.gpu.check(),
        };
        let sizes = [
            self.configuration.width,
            self.configuration.height,
            picture.width as u32,
            picture.height as u32,
        ];
        let mut numbers: Vec<u8> = bytemuck::cast_slice(&sizes.map(|size| size as f32)).to_vec();
        let flags = [
            showing.space == Space::Linear,
            showing.channels == 1,
            showing.smooth,
            self.configuration.format.is_srgb(),
        ];
        numbers.extend_from_slice(bytemuck::cast_slice(&flags.map(u32::from)));
        let view = frame.texture.create_view(&TextureViewDescriptor::default());
        self.gpu.queue.write_buffer(&self.numbers, 0, &numbers);
        let inputs = self.program.bind(&self.gpu, [&self.numbers], [&picture.view]);
        let mut commands = self.gpu.device.create_command_encoder(&CommandEncoderDescriptor::default());
        self.program.run(&mut commands, &inputs, &view);
        self.gpu.queue.submit([commands.finish()]);
        self.gpu.queue.present(frame);
        self.gpu.check()
    }
}
