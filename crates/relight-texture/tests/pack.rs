//! The packer against a slow, obvious one: every plane of every layout in every format, at every mip level,
//! whatever the order of the spans.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use half::f16;
use relight_core::basis::Learned;
use relight_core::sphere::{Cap, Octahedral, fibonacci_in};
use relight_core::{Basis, CoefficientSpan, Design, Direction, Family, Layout, LightSet, Model, Space};
use relight_texture::{
    ArrayPlan, BlockFormat, Coding, LayerPlan, PackReport, Packer, Packing, Precision, Quantizer,
    TexelDomain, TexelFormat, TexelPlace, Wrap, decode_blocks, encode_blocks, full_levels, level_size,
    light_energy, planes_of_layers, span_pixels,
};
use std::convert::Infallible;
use std::f64::consts::PI;
use std::sync::Mutex;

/// A model whose functions hardly overlap over its lights: planes have little to make good.
fn model(layout: Layout, count: usize) -> Model {
    let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 400);
    let basis = match layout {
        Layout::Shared => Basis::Learned(learned(count)),
        _ => Family::by_name("sh").unwrap().build(&Design::new(count, &LightSet::default())).unwrap(),
    };
    Model { basis, layout, space: Space::Encoded, lights, figures: None, provenance: None }
}

/// Functions of `planes` planes that hardly overlap either.
fn learned(planes: usize) -> Learned {
    let square = Octahedral { nodes: 16, hemisphere: false };
    let table = (0..square.count() * 3 * (planes + 1)).map(|i| ((i * 7919) % 1009) as f32 / 504.5 - 1.0);
    Learned::new("pca".to_owned(), planes, 3, square, table.collect()).unwrap()
}

/// A smooth plane of a range of its own.
fn value(plane: usize, x: f64, y: f64) -> f64 {
    let p = plane as f64;
    0.3 * p - 1.0 + (0.5 + 0.1 * p) * (0.05 * x - 0.03 * y * (1.0 + 0.1 * p) + 0.002 * x * y)
}

struct Picture {
    width: usize,
    height: usize,
    model: Model,
    /// f64, one a role.
    planes: Vec<Vec<f64>>,
}

impl Picture {
    fn new((width, height): (usize, usize), model: Model) -> Self {
        // Small pictures change as much as large ones.
        let (dx, dy) = (20.0 / width as f64, 20.0 / height as f64);
        let planes = (0..model.plane_count())
            .map(|plane| {
                (0..width * height)
                    .map(|i| f64::from(value(plane, (i % width) as f64 * dx, (i / width) as f64 * dy) as f32))
                    .collect()
            })
            .collect();
        Self { width, height, model, planes }
    }

    /// The samples of a span as the fitter hands them over.
    fn span(&self, first: usize, end: usize) -> (Vec<f32>, Vec<f32>) {
        let stride = self.model.layout.planes_per_map();
        let interleaved = |planes: &[Vec<f64>]| -> Vec<f32> {
            (first..end).flat_map(|i| planes.iter().map(move |plane| plane[i] as f32)).collect()
        };
        let (functions, base) = self.planes.split_at(self.model.maps() * stride);
        let functions = functions.chunks(stride).flat_map(interleaved).collect();
        (functions, if base.is_empty() { Vec::new() } else { interleaved(base) })
    }

    fn range(&self, plane: usize) -> (f64, f64) {
        let values = self.planes[plane].iter();
        (
            values.clone().copied().fold(f64::INFINITY, f64::min),
            values.copied().fold(f64::NEG_INFINITY, f64::max),
        )
    }

    fn packing(&self, format: TexelFormat, levels: usize) -> Packing {
        let quantizer = |plane: usize| {
            let (min, max) = self.range(plane);
            match format.domain() {
                TexelDomain::Unit => Quantizer { scale: (max - min) as f32, bias: min as f32 },
                TexelDomain::Signed => Quantizer { scale: min.abs().max(max.abs()) as f32, bias: 0.0 },
                TexelDomain::Half | TexelDomain::Float => Quantizer { scale: 1.0, bias: 0.0 },
            }
        };
        let layers = planes_of_layers(&self.model, format)
            .into_iter()
            .map(|planes| LayerPlan { quantizers: planes.iter().map(|&p| quantizer(p)).collect(), planes })
            .collect();
        Packing { arrays: vec![ArrayPlan { format, layers }], levels, wrap: Wrap::Clamp }
    }
}

/// The bytes of a level, and how often each was written.
type LevelBytes = Mutex<(Vec<u8>, Vec<u8>)>;

/// All bytes by array and level.
struct Texture {
    levels: Vec<Vec<LevelBytes>>,
}

impl Texture {
    fn new(width: usize, height: usize, packing: &Packing) -> Self {
        let level = |array: &ArrayPlan, level| {
            let bytes =
                array.format.layer_bytes(level_size(width, level), level_size(height, level)) as usize;
            Mutex::new((vec![0; bytes * array.layers.len()], vec![0; bytes * array.layers.len()]))
        };
        let levels = packing
            .arrays
            .iter()
            .map(|array| (0..packing.levels).map(|l| level(array, l)).collect())
            .collect();
        Self { levels }
    }

    fn put(&self, packing: &Packing, place: TexelPlace, bytes: &[u8]) {
        let mut level = self.levels[place.array][place.level].lock().unwrap();
        let layer_bytes = level.0.len() / packing.arrays[place.array].layers.len();
        let start = place.layer * layer_bytes + place.offset as usize;
        assert!(place.offset as usize + bytes.len() <= layer_bytes, "{place:?} leaves its layer");
        level.0[start..start + bytes.len()].copy_from_slice(bytes);
        level.1[start..start + bytes.len()].iter_mut().for_each(|count| *count += 1);
    }
}

/// Packs with spans of `span` pixels, every third from the back.
fn packed(picture: &Picture, packing: &Packing, coding: Coding, span: usize) -> (Texture, PackReport) {
    let Picture { width, height, model, .. } = picture;
    let texture = Texture::new(*width, *height, packing);
    let packer = Packer::new(*width, *height, model, packing.clone(), coding);
    let put = |place: TexelPlace, bytes: &[u8]| {
        texture.put(packing, place, bytes);
        Ok::<(), Infallible>(())
    };
    let starts: Vec<usize> = (0..width * height).step_by(span).collect();
    for phase in 0..3 {
        for &first in starts.iter().rev().skip(phase).step_by(3) {
            let end = (first + span).min(width * height);
            let (functions, base_color) = picture.span(first, end);
            let span =
                CoefficientSpan { first, pixels: end - first, maps: &functions, base_color: &base_color };
            packer.write(&span, &put).unwrap();
        }
    }
    let report = packer.finish(&put).unwrap();
    for level in texture.levels.iter().flatten() {
        assert!(level.lock().unwrap().1.iter().all(|&count| count == 1), "every byte once");
    }
    (texture, report)
}

/// The planes of a level from its bytes, by a reader of its own.
fn unpacked(
    texture: &Texture,
    packing: &Packing,
    size: (usize, usize),
    level: usize,
    planes: usize,
) -> Vec<Vec<f64>> {
    let (width, height) = (level_size(size.0, level), level_size(size.1, level));
    let mut out = vec![Vec::new(); planes];
    for (array, levels) in packing.arrays.iter().zip(&texture.levels) {
        let bytes = &levels[level].lock().unwrap().0;
        let layer_bytes = bytes.len() / array.layers.len();
        for (layer, bytes) in array.layers.iter().zip(bytes.chunks(layer_bytes)) {
            let channels = array.format.channels();
            let q: Vec<f32> = match array.format {
                TexelFormat::Plain { precision: Precision::U8, .. } => {
                    bytes.iter().map(|&code| f32::from(code) / 255.0).collect()
                }
                TexelFormat::Plain { precision: Precision::F16, .. } => {
                    bytes.chunks(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
                }
                TexelFormat::Plain { precision: Precision::F32, .. } => {
                    bytes.chunks(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
                }
                TexelFormat::Block(format) => {
                    let mut q = vec![0.0; width * height * channels];
                    decode_blocks(format, bytes, width, &mut q);
                    q
                }
            };
            for (channel, (&plane, quantizer)) in layer.planes.iter().zip(&layer.quantizers).enumerate() {
                let q = q[channel..].iter().step_by(channels);
                out[plane] = q
                    .map(|&q| f64::from(quantizer.scale) * f64::from(q) + f64::from(quantizer.bias))
                    .collect();
            }
        }
    }
    out
}

/// Share of the width of texel `j` of the next level that each texel of `size` covers.
fn shares(size: usize, j: usize) -> Vec<(usize, f64)> {
    if size == 1 {
        return vec![(0, 1.0)];
    }
    let next = size / 2;
    let (from, to) = (j as f64 * size as f64 / next as f64, (j + 1) as f64 * size as f64 / next as f64);
    (0..size)
        .map(|i| (i, (to.min(i as f64 + 1.0) - from.max(i as f64)).max(0.0) / (to - from)))
        .filter(|(_, share)| *share > 0.0)
        .collect()
}

/// The next level by areas.
fn halved(plane: &[f64], width: usize, height: usize) -> Vec<f64> {
    let (next_width, next_height) = (level_size(width, 1), level_size(height, 1));
    (0..next_width * next_height)
        .map(|i| {
            let columns = shares(width, i % next_width);
            let rows = shares(height, i / next_width);
            rows.iter()
                .flat_map(|(y, wy)| columns.iter().map(move |(x, wx)| wy * wx * plane[y * width + x]))
                .sum()
        })
        .collect()
}

/// Error of a texel that is no bug, as a part of the plane's range.
fn tolerance(format: TexelFormat) -> f64 {
    match format {
        TexelFormat::Plain { precision: Precision::U8, .. } => 0.5001 / 255.0,
        TexelFormat::Plain { precision: Precision::F16, .. } => 2e-3,
        TexelFormat::Plain { precision: Precision::F32, .. } => 1e-6,
        TexelFormat::Block(BlockFormat::Bc1 | BlockFormat::Bc3 | BlockFormat::Bc6hSigned) => 0.2,
        TexelFormat::Block(_) => 0.07,
    }
}

fn formats() -> Vec<TexelFormat> {
    let plain = [Precision::U8, Precision::F16, Precision::F32];
    let plain = plain
        .into_iter()
        .flat_map(|precision| [1, 4].map(|channels| TexelFormat::Plain { precision, channels }));
    plain.chain(BlockFormat::all().map(TexelFormat::Block)).collect()
}

#[test]
fn every_plane_of_every_format_is_found_again_at_every_level() {
    for layout in [Layout::Rgb, Layout::Lrgb, Layout::Grey, Layout::Shared] {
        for format in formats() {
            for size in [(13, 22), (1, 1), (3, 5), (257, 1)] {
                let picture = Picture::new(size, model(layout, 4));
                let packing = picture.packing(format, full_levels(size.0, size.1));
                let (texture, report) = packed(&picture, &packing, Coding::default(), 4 * size.0);
                let mut expected = picture.planes.clone();
                let (mut width, mut height) = size;
                for level in 0..packing.levels {
                    let found = unpacked(&texture, &packing, size, level, expected.len());
                    for (plane, (found, expected)) in found.iter().zip(&expected).enumerate() {
                        let (min, max) = picture.range(plane);
                        let allowed = tolerance(format) * (max - min).max(min.abs()).max(max.abs());
                        let mut sum = 0.0;
                        for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
                            let error = found - expected;
                            sum += error * error;
                            assert!(
                                error.abs() <= allowed,
                                "{layout:?} {} {size:?} level {level} plane {plane} texel {i}: {found} for {expected}",
                                format.name()
                            );
                        }
                        let of_level = (sum / found.len() as f64).sqrt();
                        if level == 0 && format.domain() != TexelDomain::Float {
                            let told = report.rmse[plane];
                            assert!(
                                (told - of_level).abs() <= 1e-3 * of_level + 1e-7,
                                "{told} for {of_level}"
                            );
                        }
                    }
                    expected = expected.iter().map(|plane| halved(plane, width, height)).collect();
                    (width, height) = (level_size(width, 1), level_size(height, 1));
                }
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_spans_or_their_order() {
    let size = (19, 45);
    for format in formats() {
        for levels in [1, 6] {
            let picture = Picture::new(size, model(Layout::Rgb, 4));
            let packing = picture.packing(format, levels);
            let (whole, _) = packed(&picture, &packing, Coding::default(), size.0 * size.1);
            let spans = if packing.needs_rows() { [4 * size.0, 12 * size.0] } else { [7, 100] };
            for span in spans {
                let (texture, _) = packed(&picture, &packing, Coding::default(), span);
                for (a, b) in texture.levels.iter().flatten().zip(whole.levels.iter().flatten()) {
                    assert_eq!(
                        a.lock().unwrap().0,
                        b.lock().unwrap().0,
                        "{} in spans of {span}",
                        format.name()
                    );
                }
            }
        }
    }
}

#[test]
fn several_arrays_hold_their_own_planes() {
    let size = (9, 7);
    let picture = Picture::new(size, model(Layout::Rgb, 4));
    let floats = TexelFormat::Plain { precision: Precision::F32, channels: 4 };
    let mut arrays: Vec<ArrayPlan> = [TexelFormat::Block(BlockFormat::Bc7), floats]
        .iter()
        .flat_map(|&format| picture.packing(format, 1).arrays)
        .collect();
    // Functions 1 and 2 as blocks, 3 and 0 as floats.
    arrays[0].layers = arrays[0].layers[1..3].to_vec();
    arrays[1].layers = vec![arrays[1].layers[3].clone(), arrays[1].layers[0].clone()];
    let packing = Packing { arrays, levels: 1, wrap: Wrap::Repeat };
    let (texture, report) = packed(&picture, &packing, Coding::default(), 4 * size.0);
    let found = unpacked(&texture, &packing, size, 0, 12);
    for (plane, (found, expected)) in found.iter().zip(&picture.planes).enumerate() {
        let (min, max) = picture.range(plane);
        let blocks = (3..9).contains(&plane);
        let allowed =
            (max - min) * if blocks { 0.07 } else { 1e-6 + 0.002 * f64::from(u8::from(plane >= 9)) };
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= allowed), "plane {plane}");
        // Function 0 is stored before the blocks, 3 after them: what it makes good is on purpose.
        assert_eq!(report.rmse[plane] > 0.0, plane >= 3);
        assert_eq!(report.plane_relit_rmse[plane] > 0.0, blocks, "floats cost nothing, blocks do");
    }
}

/// Functions that overlap make good each other's errors: beside each plane in blocks for itself.
#[test]
fn later_planes_make_good_the_errors_of_earlier_ones() {
    let size = (64, 48);
    let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.3 }, 40);
    let set = LightSet::from_directions(lights.clone());
    let basis = Family::by_name("srbf").unwrap().build(&Design::new(16, &set)).unwrap();
    let mut picture = Picture::new(size, Model { basis, lights, ..model(Layout::Rgb, 4) });
    for (plane, values) in picture.planes.iter_mut().enumerate() {
        for (i, value) in values.iter_mut().enumerate() {
            let (x, y) = ((i % size.0) as f64, (i / size.0) as f64);
            *value += 0.2 * libm::sin(0.5 * x + plane as f64) * libm::cos(0.4 * y);
        }
    }
    let format = BlockFormat::Bc1;
    let packing = picture.packing(TexelFormat::Block(format), 1);
    let (_, report) = packed(&picture, &packing, Coding::default(), 4 * size.0);
    let energy = light_energy(&picture.model);
    let alone: f64 = packing.arrays[0]
        .layers
        .iter()
        .map(|layer| {
            let mut texels = vec![0.0; 3 * size.0 * size.1];
            for (channel, (&plane, q)) in layer.planes.iter().zip(&layer.quantizers).enumerate() {
                for (texel, c) in texels.chunks_exact_mut(3).zip(&picture.planes[plane]) {
                    texel[channel] = ((*c as f32 - q.bias) / q.scale).clamp(0.0, 1.0);
                }
            }
            let mut blocks = vec![0; format.bytes() * size.0 * size.1 / 16];
            encode_blocks(format, Coding::default().blocks, &texels, size.0, &mut blocks);
            let mut decoded = vec![0.0; texels.len()];
            decode_blocks(format, &blocks, size.0, &mut decoded);
            let errors = texels.chunks_exact(3).zip(decoded.chunks_exact(3)).flat_map(|(t, d)| {
                (0..3).map(|c| {
                    let error = f64::from(layer.quantizers[c].scale) * f64::from(d[c] - t[c]);
                    energy[layer.planes[c]] * error * error
                })
            });
            errors.sum::<f64>() / (size.0 * size.1) as f64
        })
        .sum();
    let ratio = report.relit_rmse / alone.sqrt();
    assert!(ratio < 0.85, "{} beside {}", report.relit_rmse, alone.sqrt());
    let parts: f64 = report.plane_relit_rmse.iter().map(|rmse| rmse * rmse).sum();
    assert!(
        (report.relit_rmse / parts.sqrt() - 1.0).abs() < 0.1,
        "{} of parts {}",
        report.relit_rmse,
        parts.sqrt()
    );
}

/// What the report says of relit pictures, beside pictures relit light by light.
#[test]
fn the_relit_error_is_that_of_relit_pictures() {
    let size = (180, 150);
    let lights: Vec<Direction> = [(0.6, 0.0, 0.8), (-0.48, 0.64, 0.6), (0.0, -0.8, 0.6)]
        .map(|(x, y, z)| Direction::new(x, y, z).unwrap())
        .to_vec();
    for (layout, format) in [
        (Layout::Rgb, TexelFormat::Block(BlockFormat::Bc1)),
        (Layout::Rgb, TexelFormat::Plain { precision: Precision::U8, channels: 4 }),
        (Layout::Grey, TexelFormat::Block(BlockFormat::Bc4)),
    ] {
        let mut picture = Picture::new(size, Model { lights: lights.clone(), ..model(layout, 4) });
        // Planes whose errors go together: the same noise in all, but for its size.
        let stride = layout.planes_per_map();
        for (plane, values) in picture.planes.iter_mut().enumerate() {
            for (i, value) in values.iter_mut().enumerate() {
                let noise = (i * 7919 % 1009) as f64 / 1009.0;
                *value += noise * (1.0 + (plane / stride) as f64);
            }
        }
        let packing = picture.packing(format, 1);
        let (texture, report) = packed(&picture, &packing, Coding::default(), 4 * size.0);
        let found = unpacked(&texture, &packing, size, 0, picture.planes.len());
        let mut functions = vec![0.0; 4];
        let mut sum = 0.0;
        for light in &lights {
            picture.model.basis.evaluate(*light, &mut functions);
            for channel in 0..stride {
                sum += (0..size.0 * size.1)
                    .map(|pixel| {
                        let error_of = |f: usize| {
                            let plane = f * stride + channel;
                            functions[f] * (found[plane][pixel] - picture.planes[plane][pixel])
                        };
                        (0..4).map(error_of).sum::<f64>().powi(2)
                    })
                    .sum::<f64>();
            }
        }
        let expected = (sum / (size.0 * size.1 * stride * lights.len()) as f64).sqrt();
        let told = report.relit_rmse;
        assert!((told / expected - 1.0).abs() < 0.1, "{layout:?} {}: {told} for {expected}", format.name());
    }
}

#[test]
fn dithered_codes_differ_by_place_and_mean_the_value() {
    let size = (64, 64);
    let mut picture = Picture::new(size, model(Layout::Grey, 1));
    // A third of a step, and the ends of the range.
    picture.planes[0].fill(100.0 / 255.0 + 1.0 / (3.0 * 255.0));
    (picture.planes[0][0], picture.planes[0][1]) = (0.0, 1.0);
    let packing = picture.packing(TexelFormat::Plain { precision: Precision::U8, channels: 1 }, 1);
    let mean = |dither| {
        let (texture, _) =
            packed(&picture, &packing, Coding { dither, ..Coding::default() }, size.0 * size.1);
        let codes = texture.levels[0][0].lock().unwrap().0[2..].to_vec();
        codes.iter().map(|&code| f64::from(code)).sum::<f64>() / codes.len() as f64
    };
    assert_eq!(mean(false), 100.0);
    assert!((mean(true) - 100.333).abs() < 0.02, "{}", mean(true));
}

#[test]
fn spans_are_whole_rows_of_blocks_where_needed() {
    assert_eq!(span_pixels(1024, false), 8192);
    assert_eq!(span_pixels(1024, true), 8192);
    assert_eq!(span_pixels(6000, true), 4 * 6000);
    assert_eq!(span_pixels(100, true), 80 * 100);
    assert_eq!(span_pixels(1, true), 8192);
}
