//! Lopsided assets: a value of its own in every plane and pixel, in any format.

use half::f16;
use relight_core::basis::Learned;
use relight_core::sphere::{Cap, Octahedral, fibonacci_in};
use relight_core::{Basis, Design, Direction, Family, Layout, LightSet, Model, Space};
use relight_gpu::{Backend, Gpu, GpuError};
use relight_texture::{
    ArrayPlan, BlockCoding, LayerPlan, PackedMaps, Packing, Precision, Quantizer, TexelDomain, TexelFormat,
    Wrap, encode_blocks, level_size, planes_of_layers,
};

/// The adapter, or `None` and a line that says so where there is none and none is required.
pub(crate) fn gpu(backend: Backend) -> Option<Gpu> {
    match Gpu::open(backend) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("RELIGHT_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("RELIGHT_REQUIRE_GPU is 1: {error}")
        }
        Err(GpuError::NoAdapter { .. }) => {
            eprintln!("skipped: no adapter of backend {}", backend.name());
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// `count` lights down to 10 degrees above the picture.
pub(crate) fn lights(count: usize) -> Vec<Direction> {
    fibonacci_in(Cap { axis: Direction::OUT, radius: 80f64.to_radians() }, count)
}

pub(crate) fn model(family: &str, count: usize, layout: Layout) -> Model {
    let lights = LightSet::from_directions(lights(40));
    let basis = match layout {
        Layout::Shared => Basis::Learned(learned(count, family != "grey")),
        _ => Family::by_name(family).unwrap().build(&Design::new(count, &lights)).unwrap(),
    };
    Model { basis, layout, space: Space::Encoded, lights: Vec::new(), figures: None, provenance: None }
}

/// Learned functions of `planes` planes with a value of its own in every place of the table.
fn learned(planes: usize, color: bool) -> Learned {
    let square = Octahedral { nodes: 6, hemisphere: color };
    let count = square.count() * if color { 3 } else { 1 } * (planes + 1);
    let table = (0..count).map(|i| ((i * 37) % 101) as f32 / 505.0 - 0.05).collect();
    Learned::new("pca".to_owned(), planes, if color { 3 } else { 1 }, square, table).unwrap()
}

/// Texels of channel `channel` of layer `layer`: waves of their own, so that neither a swap nor a
/// flip nor a transposition keeps them.
fn texel(seed: usize, level: usize, x: usize, y: usize) -> f32 {
    let (x, y, s) = (x as f32, y as f32, seed as f32);
    let wave = 0.5 + 0.3 * libm::sinf(0.31 * x + 0.17 * y * (1.0 + 0.1 * s) + s) + 0.005 * (y - x);
    (wave + 0.05 * level as f32).clamp(0.0, 1.0)
}

/// An asset of `format` in all its layers.
pub(crate) fn asset(
    model: Model,
    format: TexelFormat,
    (width, height): (usize, usize),
    levels: usize,
) -> PackedMaps {
    let layers = planes_of_layers(&model, format).into_iter().map(|planes| {
        let of_plane = |p: &usize| match format.domain() {
            TexelDomain::Signed => Quantizer { scale: 0.4 + 0.03 * *p as f32, bias: 0.02 * *p as f32 },
            _ => Quantizer { scale: 0.7 + 0.05 * *p as f32, bias: -0.3 - 0.01 * *p as f32 },
        };
        LayerPlan { quantizers: planes.iter().map(of_plane).collect(), planes }
    });
    let array = ArrayPlan { format, layers: layers.collect() };
    let count = array.layers.len();
    let texels = (0..levels).map(|level| {
        let (width, height) = (level_size(width, level), level_size(height, level));
        (0..count).flat_map(|layer| layer_bytes(format, layer, level, (width, height))).collect()
    });
    let texels = vec![texels.collect()];
    let packing = Packing { arrays: vec![array], levels, wrap: Wrap::Clamp };
    PackedMaps { width, height, model, packing, texels }
}

fn layer_bytes(format: TexelFormat, layer: usize, level: usize, (width, height): (usize, usize)) -> Vec<u8> {
    let channels = format.channels();
    let value = |i: usize| {
        let (channel, pixel) = (i % channels, i / channels);
        let q = texel(layer * 4 + channel, level, pixel % width, pixel / width);
        if format.domain() == TexelDomain::Signed { 2.0 * q - 1.0 } else { q }
    };
    let values = (0..width * height * channels).map(value);
    match format {
        TexelFormat::Plain { precision: Precision::U8, .. } => values.map(|q| (q * 255.0) as u8).collect(),
        TexelFormat::Plain { precision: Precision::F16, .. } => {
            values.flat_map(|q| f16::from_f32(q).to_le_bytes()).collect()
        }
        TexelFormat::Plain { precision: Precision::F32, .. } => values.flat_map(f32::to_le_bytes).collect(),
        TexelFormat::Block(block) => {
            let mut bytes = vec![0; format.layer_bytes(width, height) as usize];
            let values: Vec<f32> = values.collect();
            encode_blocks(block, BlockCoding::default(), &values, width, &mut bytes);
            bytes
        }
    }
}

/// Every format an asset can have: plain ones of one and four channels, all blocks.
pub(crate) fn formats() -> Vec<TexelFormat> {
    let precisions = [Precision::U8, Precision::F16, Precision::F32];
    let plain = precisions
        .into_iter()
        .flat_map(|precision| [1, 4].map(|channels| TexelFormat::Plain { precision, channels }));
    plain.chain(relight_texture::BlockFormat::all().map(TexelFormat::Block)).collect()
}
