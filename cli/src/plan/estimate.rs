//! What a bake will take, from what is measured in docs/accuracy.md: seconds are good to a factor of two or so.

use super::file::Cost;
use crate::bake::{Planned, bytes_beside};
use crate::failure::Failure;
use crate::near::surface_bytes;
use crate::options::Machine;
use relight_core::PositionMap;
use relight_fit::NearLamps;
use relight_formats::{DECODER_SHARE, OpenCapture, RESERVE, bytes_on_disk};
use relight_texture::{BlockFormat, TexelFormat};

/// Nanoseconds to decode a pixel of three channels of JPEG ("Time and memory").
const JPEG: f64 = 15.0;

/// The same of a byte of a file that is deflated, such as PNG, TIFF and OpenEXR.
const DEFLATED: f64 = 12.0;

/// Nanoseconds to gather a sample of a picture.
const GATHERED: f64 = 0.25;

/// Nanoseconds of a product and a sum ("Time and memory": 18 to 64 GFLOP/s).
const PRODUCT: f64 = 0.06;

/// Nanoseconds to read back, check and quantise a coefficient.
const STORED: f64 = 4.0;

/// Megapixels a second that blocks of normal quality take ("What block formats cost").
const ENCODED: [(BlockFormat, f64); 5] = [
    (BlockFormat::Bc1, 45.0),
    (BlockFormat::Bc3, 14.0),
    (BlockFormat::Bc4, 17.0),
    (BlockFormat::Bc6h, 0.52),
    (BlockFormat::Bc7, 5.0),
];

/// Of those that the table lacks, which are pairs of BC4.
const OTHERS_ENCODED: f64 = 9.0;

/// What is known of a bake's cost before it.
pub(super) struct Estimate {
    pub(super) input_bytes: u64,
    /// To decode all pictures.
    decode: f64,
    /// Of a pixel's fit.
    fit: f64,
    /// Of everything after the fit.
    store: f64,
    memory: u64,
    merge_memory: u64,
}

impl Estimate {
    pub(super) fn new(
        planned: &Planned<'_>,
        capture: &OpenCapture,
        lamps: Option<&NearLamps>,
        map: Option<&PositionMap>,
        machine: &Machine,
    ) -> Result<Self, Failure> {
        let (width, height) = capture.size();
        let pixels = (width * height) as f64;
        let (lights, channels) = (capture.infos.len(), capture.channels());
        let (mut decode, mut input_bytes, mut stored) = (0.0, 0, 0u64);
        for (path, info) in capture.capture.pictures.iter().zip(&capture.infos) {
            let bytes = bytes_on_disk(path);
            input_bytes += bytes;
            stored += (width * height * channels * info.sample_type.bytes()) as u64;
            let jpeg = path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("jpg") || e.eq_ignore_ascii_case("jpeg"));
            let whole = (info.width * info.height * info.channels) as f64;
            decode += if jpeg { JPEG * whole / 3.0 } else { DEFLATED * bytes as f64 };
        }
        let functions = planned.model.maps() as f64;
        let samples = lights as f64 * channels as f64;
        let planes = planned.model.plane_count() as f64;
        let encode: f64 = planned.formats().first().map_or(0.0, |&format| match format {
            TexelFormat::Block(block) => {
                let speed = ENCODED
                    .iter()
                    .find(|(known, _)| *known == block)
                    .map_or(OTHERS_ENCODED, |(_, speed)| *speed);
                1e3 / speed * planned.layers(format) as f64
            }
            TexelFormat::Plain { .. } => 0.0,
        });
        let surface = map.map_or(0, |map| size_of_val(&map.points[..]) as u64);
        let near = lamps.map_or(0, |_| planned.near_bytes(capture, machine.threads));
        let beside = bytes_beside(&[planned], capture, machine) + surface + surface_bytes(lamps) + near;
        // One picture's decoder a thread, as the stack allows for them.
        let decoders = stored / lights.max(1) as u64 * DECODER_SHARE * machine.threads as u64;
        Ok(Self {
            input_bytes,
            decode: decode * 1e-9,
            fit: (GATHERED * samples + PRODUCT * samples * functions) * 1e-9,
            store: (STORED * planes + encode) * pixels * 1e-9,
            memory: (RESERVE + beside + stored + decoders).min(machine.memory),
            merge_memory: (RESERVE + beside).min(machine.memory),
        })
    }

    /// Peak of a shard: it decodes all pictures and spills what is more than --memory.
    pub(super) fn memory(&self) -> u64 {
        self.memory
    }

    /// One core's seconds for a shard of so many pixels.
    pub(super) fn shard_seconds(&self, pixels: usize) -> f64 {
        if pixels == 0 { 0.0 } else { self.decode + self.fit * pixels as f64 }
    }

    /// Of what follows the shards.
    pub(super) fn merge(&self) -> Cost {
        Cost { memory: self.merge_memory, seconds: self.store }
    }
}
