//! Pictures of floats on the GPU, and their way there and back.

use crate::{Gpu, GpuError};
use relight_core::relighter::Picture;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, Extent3d, MapMode, TexelCopyBufferInfo,
    TexelCopyBufferLayout, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
    TextureViewDescriptor,
};

/// Four floats a pixel, as their bits: every adapter draws into integers, but not into floats.
pub(crate) const FORMAT: TextureFormat = TextureFormat::Rgba32Uint;

/// Bytes of a pixel.
const PIXEL_BYTES: usize = 16;

/// Rows of buffers start at multiples of this.
const ROW_ALIGNMENT: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;

/// Bytes that come back at a time, so that a large picture takes little more than itself.
const BAND_BYTES: usize = 64 << 20;

/// A picture on the GPU: R, G, B as floats; grey ones in R.
#[derive(Debug)]
pub struct GpuPicture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    texture: wgpu::Texture,
    pub(crate) view: TextureView,
    /// Where the CPU reads it; made when it first does.
    band: Option<Buffer>,
}

/// Rows that are drawn and come back at a time.
pub(crate) fn band_rows(width: usize, height: usize) -> usize {
    (BAND_BYTES / row_bytes(width)).clamp(1, height)
}

fn row_bytes(width: usize) -> usize {
    (width * PIXEL_BYTES).next_multiple_of(ROW_ALIGNMENT)
}

impl GpuPicture {
    /// A picture to be drawn into.
    pub(crate) fn new(gpu: &Gpu, width: usize, height: usize) -> Result<Self, GpuError> {
        let limit = gpu.device.limits().max_texture_dimension_2d as usize;
        if width.max(height) > limit {
            return Err(GpuError::TooLarge { width, height, limit });
        }
        let texture = gpu.device.create_texture(&TextureDescriptor {
            label: Some("picture"),
            size: extent(width, height),
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: FORMAT,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC
                | TextureUsages::COPY_DST,
            view_formats: &[],
        });
        gpu.check()?;
        let view = texture.create_view(&TextureViewDescriptor::default());
        Ok(Self { width, height, texture, view, band: None })
    }

    /// `picture` on the GPU.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`] and what else the driver says.
    pub fn from_picture(gpu: &Gpu, picture: &Picture) -> Result<Self, GpuError> {
        let made = Self::new(gpu, picture.width, picture.height)?;
        let mut bytes = Vec::with_capacity(picture.width * picture.height * PIXEL_BYTES);
        for pixel in picture.samples.chunks_exact(picture.channels) {
            for channel in 0..4 {
                bytes.extend(pixel.get(channel).unwrap_or(&1.0).to_ne_bytes());
            }
        }
        let layout = TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some((picture.width * PIXEL_BYTES) as u32),
            rows_per_image: None,
        };
        let size = extent(picture.width, picture.height);
        gpu.queue.write_texture(made.texture.as_image_copy(), &bytes, layout, size);
        gpu.check()?;
        Ok(made)
    }

    /// Copies the first row into `buffer`, which is as long.
    pub(crate) fn copy_row(&self, commands: &mut CommandEncoder, buffer: &Buffer) {
        let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: None, rows_per_image: None };
        let to = TexelCopyBufferInfo { buffer, layout };
        commands.copy_texture_to_buffer(self.texture.as_image_copy(), to, extent(self.width, 1));
    }

    /// Runs `commands`, then appends the first `channels` channels of the first `rows` rows to
    /// `samples`.
    pub(crate) fn read_after(
        &mut self,
        gpu: &Gpu,
        mut commands: CommandEncoder,
        rows: usize,
        channels: usize,
        samples: &mut Vec<f32>,
    ) -> Result<(), GpuError> {
        let row_bytes = row_bytes(self.width);
        let buffer = self.band.get_or_insert_with(|| {
            gpu.device.create_buffer(&BufferDescriptor {
                label: Some("picture on its way back"),
                size: (row_bytes * self.height) as u64,
                usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        });
        let layout =
            TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes as u32), rows_per_image: None };
        let to = TexelCopyBufferInfo { buffer, layout };
        commands.copy_texture_to_buffer(self.texture.as_image_copy(), to, extent(self.width, rows));
        let used = 0..(row_bytes * rows) as u64;
        commands.map_buffer_on_submit(buffer, MapMode::Read, used.clone(), |_| {});
        gpu.finish(commands.finish())?;
        {
            let mapped = buffer.slice(used).get_mapped_range();
            let bytes = mapped.map_err(|error| GpuError::Lost { reason: error.to_string() })?;
            for row in bytes.chunks_exact(row_bytes) {
                samples.extend(row[..self.width * PIXEL_BYTES].chunks_exact(PIXEL_BYTES).flat_map(|pixel| {
                    pixel.chunks_exact(4).take(channels).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]))
                }));
            }
        }
        buffer.unmap();
        gpu.check()
    }
}

fn extent(width: usize, height: usize) -> Extent3d {
    Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 }
}
