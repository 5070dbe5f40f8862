//! Valid files of every kind, made with other libraries or by hand.

use exr::prelude::{self as ex, WritableImage};
use half::f16;
use std::io::Cursor;

/// A value of its own in every pixel and channel, so that a swap shows.
pub(crate) fn value(x: usize, y: usize, channel: usize) -> usize {
    x * 7 + y * 13 + channel * 101 + 5
}

/// Interleaved samples of a lopsided picture.
pub(crate) fn picture<T>(
    width: usize,
    height: usize,
    channels: usize,
    sample: impl Fn(usize) -> T,
) -> Vec<T> {
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            samples.extend((0..channels).map(|channel| sample(value(x, y, channel))));
        }
    }
    samples
}

/// A gentle gradient, which survives JPEG.
pub(crate) fn gradient(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let all = [20 + x * 200 / width, 230 - y * 190 / height, 60 + (x + y) * 100 / (width + height)];
            samples.extend(all[..channels].iter().map(|&v| v as u8));
        }
    }
    samples
}

pub(crate) struct Jpeg {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) color: jpeg_encoder::ColorType,
    pub(crate) sampling: jpeg_encoder::SamplingFactor,
    pub(crate) progressive: bool,
    pub(crate) restart: u16,
    pub(crate) exif_orientation: Option<u8>,
    pub(crate) profile: Option<Vec<u8>>,
}

pub(crate) fn jpeg_of(width: usize, height: usize) -> Jpeg {
    Jpeg {
        width,
        height,
        color: jpeg_encoder::ColorType::Rgb,
        sampling: jpeg_encoder::SamplingFactor::R_4_4_4,
        progressive: false,
        restart: 0,
        exif_orientation: None,
        profile: None,
    }
}

impl Jpeg {
    pub(crate) fn encode(&self, samples: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 98);
        encoder.set_sampling_factor(self.sampling);
        encoder.set_progressive(self.progressive);
        if self.restart > 0 {
            encoder.set_restart_interval(self.restart);
        }
        if let Some(orientation) = self.exif_orientation {
            let mut exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01".to_vec();
            exif.extend([0, orientation, 0, 0, 0, 0, 0, 0]);
            encoder.add_app_segment(1, exif).unwrap();
        }
        if let Some(profile) = &self.profile {
            encoder.add_icc_profile(profile).unwrap();
        }
        encoder.encode(samples, self.width as u16, self.height as u16, self.color).unwrap();
        bytes
    }
}

/// A profile that holds nothing but its description, in the form of version 2 or 4.
pub(crate) fn icc_profile(description: &str, version_4: bool) -> Vec<u8> {
    let mut tag = Vec::new();
    if version_4 {
        let text: Vec<u8> = description.encode_utf16().flat_map(u16::to_be_bytes).collect();
        tag.extend(b"mluc\0\0\0\0\0\0\0\x01\0\0\0\x0cenUS");
        tag.extend((text.len() as u32).to_be_bytes());
        tag.extend(28u32.to_be_bytes());
        tag.extend(text);
    } else {
        tag.extend(b"desc\0\0\0\0");
        tag.extend((description.len() as u32 + 1).to_be_bytes());
        tag.extend(description.as_bytes());
        tag.push(0);
    }
    let mut profile = vec![0; 128];
    profile.extend(1u32.to_be_bytes());
    profile.extend(b"desc");
    profile.extend(144u32.to_be_bytes());
    profile.extend((tag.len() as u32).to_be_bytes());
    profile.extend(tag);
    profile
}

pub(crate) struct Png<'a> {
    pub(crate) size: (usize, usize),
    pub(crate) color: png::ColorType,
    pub(crate) depth: png::BitDepth,
    pub(crate) palette: Option<&'a [u8]>,
    pub(crate) transparency: Option<&'a [u8]>,
    pub(crate) gamma: bool,
}

pub(crate) fn png_of(size: (usize, usize), color: png::ColorType, depth: png::BitDepth) -> Png<'static> {
    Png { size, color, depth, palette: None, transparency: None, gamma: false }
}

impl Png<'_> {
    pub(crate) fn encode(&self, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size.0 as u32, self.size.1 as u32);
        encoder.set_color(self.color);
        encoder.set_depth(self.depth);
        if let Some(palette) = self.palette {
            encoder.set_palette(palette);
        }
        if let Some(transparency) = self.transparency {
            encoder.set_trns(transparency);
        }
        if self.gamma {
            encoder.set_source_gamma(png::ScaledFloat::new(1.0));
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        writer.finish().unwrap();
        bytes
    }
}

/// An uncompressed TIFF of one strip with the given tags of 16-bit values besides the usual ones.
pub(crate) struct Tiff<'a> {
    pub(crate) big_endian: bool,
    pub(crate) size: (usize, usize),
    /// One per sample of a pixel.
    pub(crate) bits: &'a [u16],
    pub(crate) photometric: u16,
    pub(crate) tags: &'a [(u16, u16)],
    /// Samples already in the file's byte order; planes are equal parts of it.
    pub(crate) data: &'a [u8],
}

impl Tiff<'_> {
    pub(crate) fn encode(&self) -> Vec<u8> {
        let u16_bytes = |v: u16| if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
        let u32_bytes = |v: u32| if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
        let planes = if self.tags.contains(&(284, 2)) { self.bits.len() } else { 1 };
        // Tag, type (3 = SHORT, 4 = LONG), values.
        let mut entries: Vec<(u16, u16, Vec<u32>)> = vec![
            (256, 4, vec![self.size.0 as u32]),
            (257, 4, vec![self.size.1 as u32]),
            (258, 3, self.bits.iter().map(|&b| u32::from(b)).collect()),
            (259, 3, vec![1]),
            (262, 3, vec![u32::from(self.photometric)]),
            (277, 3, vec![self.bits.len() as u32]),
            (278, 4, vec![self.size.1 as u32]),
        ];
        for &(tag, value) in self.tags {
            let count = if tag == 339 { self.bits.len() } else { 1 };
            entries.push((tag, 3, vec![u32::from(value); count]));
        }
        let plane = self.data.len() / planes;
        entries.push((273, 4, (0..planes).map(|p| (8 + p * plane) as u32).collect()));
        entries.push((279, 4, vec![plane as u32; planes]));
        entries.sort();
        let mut bytes = if self.big_endian { b"MM\0*".to_vec() } else { b"II*\0".to_vec() };
        bytes.extend(u32_bytes(8 + self.data.len() as u32));
        bytes.extend(self.data);
        let mut extra = 8 + self.data.len() + 2 + entries.len() * 12 + 4;
        let mut overflow = Vec::new();
        bytes.extend(u16_bytes(entries.len() as u16));
        for (tag, kind, values) in entries {
            bytes.extend(u16_bytes(tag));
            bytes.extend(u16_bytes(kind));
            bytes.extend(u32_bytes(values.len() as u32));
            let mut field: Vec<u8> = Vec::new();
            for v in values {
                if kind == 3 {
                    field.extend(u16_bytes(v as u16));
                } else {
                    field.extend(u32_bytes(v));
                }
            }
            if field.len() > 4 {
                bytes.extend(u32_bytes(extra as u32));
                extra += field.len();
                overflow.extend(field);
            } else {
                field.resize(4, 0);
                bytes.extend(field);
            }
        }
        bytes.extend([0; 4]);
        bytes.extend(overflow);
        bytes
    }
}

/// A TIFF written by the `tiff` crate.
pub(crate) fn tiff_compressed<C: tiff::encoder::colortype::ColorType>(
    size: (usize, usize),
    compression: tiff::encoder::Compression,
    samples: &[C::Inner],
) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
    encoder.write_image::<C>(size.0 as u32, size.1 as u32, samples).unwrap();
    bytes.into_inner()
}

/// An EXR of one layer; channels are (name, planar samples).
pub(crate) fn exr(
    size: (usize, usize),
    channels: Vec<(&str, ex::FlatSamples)>,
    encoding: ex::Encoding,
    position: (i32, i32),
) -> Vec<u8> {
    let list = channels.into_iter().map(|(name, samples)| ex::AnyChannel::new(name, samples)).collect();
    let attributes = ex::LayerAttributes::named("main").with_position(ex::Vec2(position.0, position.1));
    let layer = ex::Layer::new(size, attributes, encoding, ex::AnyChannels::sort(list));
    let mut bytes = Cursor::new(Vec::new());
    ex::Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// One channel of [`picture`] as a plane.
pub(crate) fn plane<T>(size: (usize, usize), channel: usize, sample: impl Fn(usize) -> T) -> Vec<T> {
    let mut samples = Vec::new();
    for y in 0..size.1 {
        samples.extend((0..size.0).map(|x| sample(value(x, y, channel))));
    }
    samples
}

/// Half of a value, with a fraction.
pub(crate) fn half_of(v: usize) -> f16 {
    f16::from_f32((v % 2000) as f32 / 8.0)
}

/// Single of a value that no half can hold.
pub(crate) fn float_of(v: usize) -> f32 {
    v as f32 + 0.123_456_7
}

pub(crate) fn exr_half_rgb(size: (usize, usize), encoding: ex::Encoding) -> Vec<u8> {
    let half = |channel| ex::FlatSamples::F16(plane(size, channel, half_of));
    exr(size, vec![("R", half(0)), ("G", half(1)), ("B", half(2))], encoding, (0, 0))
}

/// A Radiance file; `rgbe` is 4 bytes a pixel, written flat or in new-style runs.
pub(crate) fn radiance(size: (usize, usize), signature: &str, rgbe: &[u8], runs: bool) -> Vec<u8> {
    let mut bytes =
        format!("{signature}\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n", size.1, size.0).into_bytes();
    for row in rgbe.chunks(size.0.max(1) * 4) {
        if !runs {
            bytes.extend(row);
            continue;
        }
        bytes.extend([2, 2, (size.0 >> 8) as u8, size.0 as u8]);
        for channel in 0..4 {
            for part in row.chunks(4 * 100) {
                bytes.push((part.len() / 4) as u8);
                bytes.extend(part.iter().skip(channel).step_by(4));
            }
        }
    }
    bytes
}
