//! Speed and quality of every block format, quality and encoder on a photograph and on two
//! coefficient maps, as a Markdown table: MPix/s of CPU time on one thread, PSNR after decoding.
//!
//! `cargo bench -p relight-texture --bench blocks [--features ispc] [-- NAME]`. It wants
//! `../shared/data/relief1024` and says so where that is missing. `photo` is its first picture;
//! `lu` and `lu2` are the planes of u and u^2 of a PTM (6) fitted to all of them, in 8 bits with
//! scale and bias. Every 8th row of blocks is measured, over and over until a tenth of a second has
//! gone. The last column is the `dds` crate called on a whole picture of those rows, for comparison.

use relight_texture::{
    BlockCoding, BlockFormat, Encoder, Quality, TexelDomain, decode_blocks, encode_blocks,
};
use std::path::Path;

/// A picture of three planes, q 0..1 in steps of 1/255, interleaved.
struct Input {
    name: &'static str,
    width: usize,
    q: Vec<f32>,
    /// For signed formats: q * scale + bias has its zero where the coefficient has, and its largest
    /// magnitude is 1. One pair a channel; none for a photograph.
    signed: Option<[(f32, f32); 3]>,
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/relief1024");
    let wanted: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    if !folder.exists() {
        println!("skipped: {} is missing", folder.display());
        return;
    }
    let inputs = inputs(&folder);
    println!(
        "| format | quality | encoder | MPix/s | PSNR {} |",
        inputs.each_ref().map(|i| i.name).join(" / ")
    );
    println!("|---|---|---|---|---|---|");
    for format in BlockFormat::all() {
        if !wanted.is_empty() && !wanted.iter().any(|name| name == format.name()) {
            continue;
        }
        for encoder in Encoder::all().filter(|encoder| encoder.available()) {
            if encoder == Encoder::Ispc && !matches!(format, BlockFormat::Bc6h | BlockFormat::Bc7) {
                continue;
            }
            for quality in Quality::all() {
                row(format, BlockCoding { quality, encoder }, &inputs);
            }
        }
    }
}

fn row(format: BlockFormat, coding: BlockCoding, inputs: &[Input; 3]) {
    let (mut seconds, mut direct, mut megapixels, mut figures) = (0.0, 0.0, 0.0, Vec::new());
    for input in inputs {
        let Some((texels, real)) = texels(format, input) else {
            figures.push("-".to_owned());
            continue;
        };
        let channels = format.channels();
        let strip = 4 * input.width * channels;
        let some: Vec<f32> = texels.chunks_exact(strip).step_by(8).flatten().copied().collect();
        let mut blocks = vec![0; some.len() / channels / 16 * format.bytes()];
        seconds += seconds_of(|| {
            let strips = blocks.chunks_exact_mut(input.width / 4 * format.bytes());
            for (texels, blocks) in some.chunks_exact(strip).zip(strips) {
                encode_blocks(format, coding, texels, input.width, blocks);
            }
        });
        direct += by_dds(format, coding, &some, input.width).unwrap_or(f64::INFINITY);
        megapixels += (some.len() / channels) as f64 / 1e6;
        let mut decoded = vec![0.0; some.len()];
        decode_blocks(format, &blocks, input.width, &mut decoded);
        let square = |(i, (a, b)): (usize, (&f32, &f32))| (f64::from(a - b) * real[i % channels]).powi(2);
        let squares: f64 = some.iter().zip(&decoded).enumerate().map(square).sum();
        figures.push(format!("{:.2}", 10.0 * libm::log10(some.len() as f64 / squares)));
    }
    println!(
        "| {} | {} | {} | {:.3} | {} | {} |",
        format.name(),
        coding.quality.name(),
        coding.encoder.name(),
        megapixels / seconds,
        figures.join(" / "),
        if direct.is_finite() { format!("{:.3}", megapixels / direct) } else { "-".to_owned() }
    );
}

/// CPU seconds of one round.
fn seconds_of(mut round: impl FnMut()) -> f64 {
    let (start, mut rounds) = (cpu_seconds(), 0);
    loop {
        round();
        rounds += 1;
        let gone = cpu_seconds() - start;
        if gone >= 0.1 {
            return gone / f64::from(rounds);
        }
    }
}

/// CPU seconds of `dds` on RGB or RGBA floats, where it has the format.
fn by_dds(format: BlockFormat, coding: BlockCoding, texels: &[f32], width: usize) -> Option<f64> {
    use dds::{ColorFormat, CompressionQuality, EncodeOptions, Format, ImageView, Size};
    let (dds, color) = match format {
        _ if coding.encoder != Encoder::Portable => return None,
        BlockFormat::Bc1 => (Format::BC1_UNORM, ColorFormat::RGB_F32),
        BlockFormat::Bc3 => (Format::BC3_UNORM, ColorFormat::RGBA_F32),
        BlockFormat::Bc4 => (Format::BC4_UNORM, ColorFormat::GRAYSCALE_F32),
        BlockFormat::Bc7 => (Format::BC7_UNORM, ColorFormat::RGB_F32),
        _ => return None,
    };
    let mut options = EncodeOptions::default();
    options.parallel = false;
    options.quality = match coding.quality {
        Quality::Fast => CompressionQuality::Fast,
        Quality::Normal => CompressionQuality::Normal,
        Quality::High => CompressionQuality::High,
        // Unreasonable by its own account, and the same code.
        Quality::Best => return None,
    };
    let size = Size::new(width as u32, (texels.len() / width / format.channels()) as u32);
    let view = ImageView::new(bytemuck::cast_slice(texels), size, color)?;
    Some(seconds_of(|| {
        dds::encode(&mut Vec::new(), view, dds, None, &options).expect("a format that it encodes");
    }))
}

/// The input in the channels and the domain of a format, and for each channel how much of the
/// plane's range a step of 1 is. The fourth channel is the second once more, upside down.
fn texels(format: BlockFormat, input: &Input) -> Option<(Vec<f32>, [f64; 4])> {
    let channels = format.channels();
    let mut real = [1.0; 4];
    let mut map = [(1.0, 0.0); 3];
    if format.domain() == TexelDomain::Signed {
        map = input.signed?;
        (0..3).for_each(|c| real[c] = 1.0 / f64::from(map[c].0));
    }
    let pick = |texel: &[f32]| {
        let value = |c: usize| texel[c] * map[c].0 + map[c].1;
        match channels {
            1 => vec![value(1)],
            4 => vec![value(0), value(1), value(2), texel[1]],
            _ => (0..channels).map(value).collect(),
        }
    };
    if channels == 1 {
        real[0] = real[1];
    }
    Some((input.q.chunks_exact(3).flat_map(pick).collect(), real))
}

fn inputs(folder: &Path) -> [Input; 3] {
    let text = std::fs::read_to_string(folder.join("lights.lp")).expect("lights.lp");
    let lights: Vec<(String, [f64; 3])> = text
        .lines()
        .skip(1)
        .map(|line| {
            let mut words = line.split_whitespace();
            let name = words.next().expect("a name").to_owned();
            (name, std::array::from_fn(|_| words.next().and_then(|word| word.parse().ok()).expect("x y z")))
        })
        .collect();
    let terms = |[u, v, _]: [f64; 3]| [u * u, v * v, u * v, u, v, 1.0];
    let rows: Vec<[f64; 6]> = lights.iter().map(|light| terms(light.1)).collect();
    let weights = pseudo_inverse(&rows);

    let (mut width, mut photo, mut planes) = (0, Vec::new(), [Vec::new(), Vec::new()]);
    for (i, (name, _)) in lights.iter().enumerate() {
        let bytes = std::fs::read(folder.join(name)).expect("a picture");
        let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(bytes));
        let picture = decoder.decode().expect("a JPEG");
        if i == 0 {
            width = decoder.dimensions().expect("a size").0;
            photo = picture.iter().map(|code| f32::from(*code) / 255.0).collect();
        }
        for (plane, term) in planes.iter_mut().zip([3, 0]) {
            plane.resize(picture.len(), 0.0);
            let weight = weights[term][i] as f32;
            plane.iter_mut().zip(&picture).for_each(|(sum, code)| *sum += weight * f32::from(*code));
        }
    }
    let [u, u2] = planes;
    let map = |name, plane: &[f32]| {
        let channel = |c: usize| plane.iter().skip(c).step_by(3).copied();
        let ends: [(f32, f32); 3] = std::array::from_fn(|c| {
            (channel(c).fold(f32::INFINITY, f32::min), channel(c).fold(f32::NEG_INFINITY, f32::max))
        });
        let code = |(i, value): (usize, &f32)| {
            let (low, high) = ends[i % 3];
            ((value - low) / (high - low) * 255.0).round() / 255.0
        };
        let q = plane.iter().enumerate().map(code).collect();
        let largest = |(low, high): (f32, f32)| high.max(-low);
        let signed =
            ends.map(|(low, high)| ((high - low) / largest((low, high)), low / largest((low, high))));
        Input { name, width, q, signed: Some(signed) }
    };
    let photo = Input { name: "photo", width, q: photo, signed: None };
    [photo, map("lu", &u), map("lu2", &u2)]
}

/// (A^T A)^-1 A^T by Gauss-Jordan; six well-conditioned unknowns.
fn pseudo_inverse(rows: &[[f64; 6]]) -> [Vec<f64>; 6] {
    let product = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
    let mut normal: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| product(i, j)));
    let mut right: [Vec<f64>; 6] = std::array::from_fn(|i| rows.iter().map(|row| row[i]).collect());
    for pivot in 0..6 {
        let divisor = normal[pivot][pivot];
        normal[pivot].iter_mut().chain(right[pivot].iter_mut()).for_each(|value| *value /= divisor);
        let (line, tail) = (normal[pivot], right[pivot].clone());
        for other in (0..6).filter(|other| *other != pivot) {
            let factor = normal[other][pivot];
            normal[other].iter_mut().zip(line).for_each(|(value, from)| *value -= factor * from);
            right[other].iter_mut().zip(&tail).for_each(|(value, from)| *value -= factor * from);
        }
    }
    right
}

/// CPU seconds of this process so far.
#[cfg(unix)]
fn cpu_seconds() -> f64 {
    use nix::sys::resource::{UsageWho, getrusage};
    let time = getrusage(UsageWho::RUSAGE_SELF).expect("rusage").user_time();
    time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6
}

/// Seconds so far: elsewhere the machine had better be idle.
#[cfg(not(unix))]
fn cpu_seconds() -> f64 {
    use std::sync::OnceLock;
    static START: OnceLock<std::time::Instant> = OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}
