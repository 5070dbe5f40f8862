//! Blocks against two decoders that share nothing with the encoders, at awkward sizes and values.

use relight_core::Texels;
use relight_texture::{
    BlockCoding, BlockFormat, Encoder, Precision, Quality, TexelDomain, TexelFormat, decode_blocks,
    decode_channel, encode_blocks,
};

/// The encoders of this build that differ for the format.
fn encoders(format: BlockFormat) -> impl Iterator<Item = Encoder> {
    let foreign = matches!(format, BlockFormat::Bc6h | BlockFormat::Bc7);
    Encoder::all().filter(move |encoder| encoder.available() && (foreign || *encoder == Encoder::Portable))
}

fn codings(format: BlockFormat) -> impl Iterator<Item = BlockCoding> {
    encoders(format).flat_map(|encoder| Quality::all().map(move |quality| BlockCoding { quality, encoder }))
}

/// The least value of the format's domain.
fn low(format: BlockFormat) -> f32 {
    if format.domain() == TexelDomain::Signed { -1.0 } else { 0.0 }
}

/// A smooth map in which every texel and channel has a value of its own, in the format's domain.
/// Only sums, products and quotients: the same floats on every machine.
fn lopsided(format: BlockFormat, width: usize, height: usize) -> Vec<f32> {
    let (low, count) = (low(format), format.channels());
    let mut texels = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (u, v) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            let bump = 0.08 / (0.1 + (u - 0.3) * (u - 0.3) * 9.0 + (v - 0.6) * (v - 0.6) * 4.0);
            let channels =
                [0.9 * u * u + 0.05 * v, 0.8 - 0.7 * v * u, 0.1 + bump, 0.3 + 0.6 * v * v - 0.25 * u];
            texels.extend(channels[..count].iter().map(|q| low + (1.0 - low) * q.clamp(0.0, 1.0)));
        }
    }
    texels
}

fn layer_bytes(format: BlockFormat, width: usize, height: usize) -> usize {
    TexelFormat::Block(format).layer_bytes(width, height) as usize
}

fn encoded(format: BlockFormat, coding: BlockCoding, texels: &[f32], width: usize) -> Vec<u8> {
    let height = texels.len() / width / format.channels();
    let mut blocks = vec![0xaa; layer_bytes(format, width, height)];
    encode_blocks(format, coding, texels, width, &mut blocks);
    blocks
}

fn decoded(format: BlockFormat, blocks: &[u8], width: usize, height: usize) -> Vec<f32> {
    let mut texels = vec![f32::NAN; width * height * format.channels()];
    decode_blocks(format, blocks, width, &mut texels);
    texels
}

/// By the decoder of the `dds` crate, at its full precision; channels as ours.
fn decoded_by_dds(format: BlockFormat, blocks: &[u8], width: usize, height: usize) -> Vec<f32> {
    use dds::{ColorFormat, Format, ImageViewMut, Size};
    let (dds, color) = match format {
        BlockFormat::Bc1 => (Format::BC1_UNORM, ColorFormat::RGB_F32),
        BlockFormat::Bc3 => (Format::BC3_UNORM, ColorFormat::RGBA_F32),
        BlockFormat::Bc4 => (Format::BC4_UNORM, ColorFormat::GRAYSCALE_F32),
        BlockFormat::Bc4Signed => (Format::BC4_SNORM, ColorFormat::GRAYSCALE_F32),
        BlockFormat::Bc5 => (Format::BC5_UNORM, ColorFormat::RGB_F32),
        BlockFormat::Bc5Signed => (Format::BC5_SNORM, ColorFormat::RGB_F32),
        BlockFormat::Bc6h => (Format::BC6H_UF16, ColorFormat::RGB_F32),
        BlockFormat::Bc6hSigned => (Format::BC6H_SF16, ColorFormat::RGB_F32),
        BlockFormat::Bc7 => (Format::BC7_UNORM, ColorFormat::RGB_F32),
    };
    let channels = usize::from(color.channels.count());
    let mut texels = vec![0.0f32; width * height * channels];
    let size = Size::new(width as u32, height as u32);
    let view = ImageViewMut::new(bytemuck::cast_slice_mut(&mut texels), size, color).expect("whole rows");
    dds::decode(&mut &blocks[..], view, dds, &dds::DecodeOptions::default()).expect("blocks");
    // It moves signed channels of BC4 and BC5 to 0..1.
    let moved = matches!(format, BlockFormat::Bc4Signed | BlockFormat::Bc5Signed);
    let own = texels.chunks_exact(channels).flat_map(|texel| &texel[..format.channels()]);
    own.map(|q| if moved { 2.0 * q - 1.0 } else { *q }).collect()
}

/// By `texture2ddecoder`, codes of 8 bits. None for signed forms: it lacks those of BC4 and BC5, and
/// that of BC6H (0.1.2) takes negative ends, which are two's complements, for sign and magnitude.
fn codes_by_texture2ddecoder(
    format: BlockFormat,
    blocks: &[u8],
    width: usize,
    height: usize,
) -> Option<Vec<u8>> {
    use texture2ddecoder as t2d;
    let decode = match format {
        BlockFormat::Bc1 => t2d::decode_bc1,
        BlockFormat::Bc3 => t2d::decode_bc3,
        BlockFormat::Bc4 => t2d::decode_bc4,
        BlockFormat::Bc5 => t2d::decode_bc5,
        BlockFormat::Bc6h => t2d::decode_bc6_unsigned,
        BlockFormat::Bc7 => t2d::decode_bc7,
        BlockFormat::Bc4Signed | BlockFormat::Bc5Signed | BlockFormat::Bc6hSigned => return None,
    };
    let mut texels = vec![0; width * height];
    decode(blocks, width, height, &mut texels).expect("blocks");
    // Its words are BGRA.
    let order = &[2, 1, 0, 3][..format.channels()];
    Some(texels.iter().flat_map(|word| order.iter().map(|c| word.to_le_bytes()[*c])).collect())
}

/// How far `dds` and `texture2ddecoder` may be from our decoder, in q. BC1 (and BC3's colours):
/// ours rounds to codes, `dds` does not, the other truncates. Interpolated values of BC4 and BC5
/// are exact with us and `dds`, codes rounded down with the other. BC6H: the other rounds to codes.
fn tolerances(format: BlockFormat) -> (f32, f32) {
    let code = 1.0 / 255.0;
    match format {
        BlockFormat::Bc1 | BlockFormat::Bc3 => (0.51 * code, 1.01 * code),
        BlockFormat::Bc4 | BlockFormat::Bc5 => (1e-6, 1.01 * code),
        BlockFormat::Bc4Signed | BlockFormat::Bc5Signed => (1e-6, f32::NAN),
        BlockFormat::Bc6h => (0.0, 1.01 * code),
        BlockFormat::Bc6hSigned => (0.0, f32::NAN),
        BlockFormat::Bc7 => (0.0, 0.0),
    }
}

#[test]
fn three_decoders_agree_on_every_block_we_write() {
    let (width, height) = (64, 48);
    for format in BlockFormat::all() {
        let texels = lopsided(format, width, height);
        let (by_dds, by_other) = tolerances(format);
        for coding in codings(format) {
            let blocks = encoded(format, coding, &texels, width);
            let ours = decoded(format, &blocks, width, height);
            let dds = decoded_by_dds(format, &blocks, width, height);
            let other = codes_by_texture2ddecoder(format, &blocks, width, height);
            for (i, (a, b)) in ours.iter().zip(&dds).enumerate() {
                assert!((a - b).abs() <= by_dds, "{format:?} {coding:?} value {i}: {a}, dds {b}");
                if let Some(code) = other.as_ref().map(|codes| f32::from(codes[i]) / 255.0) {
                    assert!(
                        (a - code).abs() <= by_other,
                        "{format:?} {coding:?} value {i}: {a}, other {code}"
                    );
                }
            }
        }
    }
}

fn psnr(a: &[f32], b: &[f32], peak: f64) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    10.0 * libm::log10(peak * peak * a.len() as f64 / squares)
}

/// Half a decibel below what the portable encoder reached when this was written, fast to best. A
/// swap of channels or rows falls below 20 dB.
fn floors(format: BlockFormat) -> [f64; 4] {
    match format {
        BlockFormat::Bc1 => [41.3, 41.3, 41.4, 41.4],
        BlockFormat::Bc3 => [42.5, 42.5, 42.6, 42.6],
        BlockFormat::Bc4 => [54.3, 56.1, 59.2, 60.1],
        BlockFormat::Bc4Signed => [54.3, 56.3, 59.3, 60.1],
        BlockFormat::Bc5 => [55.3, 56.8, 58.6, 58.9],
        BlockFormat::Bc5Signed => [55.3, 56.9, 58.6, 58.9],
        BlockFormat::Bc6h => [46.1, 49.8, 49.9, 49.9],
        BlockFormat::Bc6hSigned => [44.7, 46.4, 46.5, 46.5],
        BlockFormat::Bc7 => [47.9, 49.9, 50.2, 50.3],
    }
}

#[test]
fn a_smooth_map_is_coded_as_well_as_it_was_and_more_time_is_never_worse() {
    let (width, height) = (64, 64);
    for format in BlockFormat::all() {
        let texels = lopsided(format, width, height);
        let peak = f64::from(1.0 - low(format));
        for encoder in encoders(format) {
            let mut former = 0.0;
            for (quality, floor) in Quality::all().zip(floors(format)) {
                let blocks = encoded(format, BlockCoding { quality, encoder }, &texels, width);
                let reached = psnr(&decoded(format, &blocks, width, height), &texels, peak);
                let what = format!("{format:?} {quality:?} {encoder:?}");
                println!("{what}: {reached:.2} dB");
                // Intel's BC6H looks at the bits of halves, not at q.
                let (floor, slack) =
                    if encoder == Encoder::Ispc { (floor - 3.0, 0.2) } else { (floor, 0.05) };
                assert!(reached >= floor, "{what}: {reached:.2} dB");
                assert!(reached >= former - slack, "{what}: {reached:.2} dB after {former:.2}");
                former = reached;
            }
        }
    }
}

#[test]
fn incomplete_blocks_repeat_the_last_column_and_row() {
    for format in BlockFormat::all() {
        let channels = format.channels();
        for (width, height) in [(1, 1), (3, 5), (5, 3), (4097, 1)] {
            let texels = lopsided(format, width, height);
            let (whole_width, whole_height) = (width.next_multiple_of(4), height.next_multiple_of(4));
            let source = |i: usize| {
                let (x, y) = ((i % whole_width).min(width - 1), (i / whole_width).min(height - 1));
                texels[(y * width + x) * channels..][..channels].to_vec()
            };
            let padded: Vec<f32> = (0..whole_width * whole_height).flat_map(source).collect();
            for coding in codings(format).filter(|coding| coding.quality <= Quality::Normal) {
                let blocks = encoded(format, coding, &texels, width);
                let expected = encoded(format, coding, &padded, whole_width);
                assert_eq!(blocks, expected, "{format:?} {coding:?} {width} x {height}");

                // Dropping the padding gives the texels of the whole blocks.
                let whole = decoded(format, &blocks, whole_width, whole_height);
                let inside = decoded(format, &blocks, width, height);
                for y in 0..height {
                    let row = &inside[y * width * channels..][..width * channels];
                    assert_eq!(row, &whole[y * whole_width * channels..][..width * channels]);
                }
                let reached = psnr(&whole, &padded, f64::from(1.0 - low(format)));
                assert!(reached > 20.0, "{format:?} {coding:?} {width} x {height}: {reached:.1} dB");
            }
        }
    }
}

#[test]
fn constant_maps_are_exact_or_within_half_a_step() {
    for format in BlockFormat::all() {
        let half_step = match format {
            // Ends of 5 bits; blocks of one colour find finer ones in between.
            BlockFormat::Bc1 | BlockFormat::Bc3 => 0.5 / 62.0,
            BlockFormat::Bc4Signed | BlockFormat::Bc5Signed => 0.5 / 127.0,
            BlockFormat::Bc6h | BlockFormat::Bc6hSigned => 1.0 / 4096.0,
            _ => 0.5 / 255.0,
        };
        for q in [0.0, 1e-9, 0.1, 0.2, 1.0 / 3.0, 127.0 / 255.0, 0.5, 128.0 / 255.0, 0.7, 0.999, 1.0] {
            for q in [q, -q].into_iter().filter(|q| *q >= low(format)) {
                for coding in codings(format) {
                    let blocks = encoded(format, coding, &vec![q; 16 * format.channels()], 4);
                    for texel in decoded(format, &blocks, 4, 4) {
                        let exact = q == 0.0 || q.abs() == 1.0;
                        // Intel's encoder cuts fractions off, twice.
                        let steps = if coding.encoder == Encoder::Ispc { 3.0 } else { 1.0001 };
                        let allowed = if exact { 0.0 } else { half_step * steps };
                        assert!((texel - q).abs() <= allowed, "{format:?} {coding:?}: {q} became {texel}");
                    }
                }
            }
        }
    }
}

#[test]
fn both_ends_of_the_domain_in_one_block_stay_there() {
    for format in BlockFormat::all() {
        let channels = format.channels();
        let ends: Vec<f32> =
            (0..16 * channels).map(|i| if i / channels % 4 < 2 { low(format) } else { 1.0 }).collect();
        for coding in codings(format) {
            let texels = decoded(format, &encoded(format, coding, &ends, 4), 4, 4);
            for (q, end) in texels.iter().zip(&ends) {
                let allowed = match format {
                    // `fast` draws ends towards the mean.
                    BlockFormat::Bc1 | BlockFormat::Bc3 => 0.05,
                    // Codes of 10 bits are 1/66 apart below 1.
                    BlockFormat::Bc6h | BlockFormat::Bc6hSigned => 1.0 / 66.0,
                    _ => 0.0,
                };
                assert!((q - end).abs() <= allowed, "{format:?} {coding:?}: {end} became {q}");
            }
        }
    }
}

#[test]
fn values_outside_of_the_domain_are_clamped_and_nan_is_zero() {
    for format in BlockFormat::all() {
        let low = low(format);
        let mut texels = lopsided(format, 8, 8);
        let mut clean = texels.clone();
        let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -7.0];
        for (i, (wild, tame)) in wild.into_iter().zip([0.0, 1.0, low, 1.0, low]).enumerate() {
            (texels[3 + 7 * i], clean[3 + 7 * i]) = (wild, tame);
        }
        for coding in codings(format) {
            assert_eq!(encoded(format, coding, &texels, 8), encoded(format, coding, &clean, 8), "{format:?}");
        }
    }
}

#[test]
fn strips_and_repeated_calls_give_the_same_bytes() {
    for format in BlockFormat::all() {
        let (width, height) = (37, 19);
        let texels = lopsided(format, width, height);
        for coding in codings(format).filter(|coding| coding.quality <= Quality::High) {
            let whole = encoded(format, coding, &texels, width);
            assert_eq!(whole, encoded(format, coding, &texels, width));
            for rows in [4, 8] {
                let strips = texels.chunks(rows * width * format.channels());
                let joined: Vec<u8> =
                    strips.flat_map(|strip| encoded(format, coding, strip, width)).collect();
                assert_eq!(whole, joined, "{format:?} {coding:?} in strips of {rows}");
            }
        }
    }
}

/// Numbers without any order, 0 to 1.
fn noise() -> impl FnMut() -> f32 {
    let mut state = 1u32;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    }
}

#[test]
fn colours_of_bc1_and_bc3_are_opaque_in_every_decoder() {
    for format in [BlockFormat::Bc1, BlockFormat::Bc3] {
        let mut noise = noise();
        // Dark texels too, for which three colours and black would pay off.
        for range in [1.0, 0.3, 0.02] {
            let texels: Vec<f32> = (0..64 * 16 * format.channels()).map(|_| range * noise()).collect();
            for coding in codings(format) {
                for block in encoded(format, coding, &texels, 4).chunks_exact(format.bytes()) {
                    let color = &block[block.len() - 8..];
                    let end = |i: usize| u16::from_le_bytes([color[i], color[i + 1]]);
                    let three = end(0) <= end(2);
                    let fourth = color[4..].iter().any(|byte| (0..4).any(|i| byte >> (2 * i) & 3 == 3));
                    let fine = !three || format == BlockFormat::Bc1 && !fourth;
                    assert!(fine, "{format:?} {coding:?} {color:?}");
                }
            }
        }
    }
}

#[test]
fn ends_of_signed_blocks_are_never_minus_128() {
    // Decoders differ in whether -128 is below -127 when they choose between the two palettes.
    for format in [BlockFormat::Bc4Signed, BlockFormat::Bc5Signed] {
        let mut texels = lopsided(format, 64, 64);
        texels.iter_mut().step_by(3).for_each(|q| *q = (*q * 3.0).clamp(-1.0, 1.0));
        for coding in codings(format) {
            for block in encoded(format, coding, &texels, 64).chunks_exact(8) {
                assert!(block[0] != 0x80 && block[1] != 0x80, "{format:?} {coding:?} {block:?}");
            }
        }
    }
}

#[test]
fn any_bytes_decode_and_channels_are_those_of_all_texels() {
    let (width, height) = (4 * 61 + 3, 6);
    for format in BlockFormat::all() {
        let mut noise = noise();
        let blocks: Vec<u8> =
            (0..layer_bytes(format, width, height)).map(|_| (noise() * 256.0) as u8).collect();
        let texels = decoded(format, &blocks, width, height);
        for channel in 0..format.channels() {
            let (precision, values): (_, Vec<f32>) =
                match decode_channel(format, &blocks, width, height, channel) {
                    Texels::U8(codes) => {
                        (Precision::U8, codes.iter().map(|code| f32::from(*code) / 255.0).collect())
                    }
                    Texels::F16(halves) => {
                        (Precision::F16, halves.iter().map(|half| half.to_f32()).collect())
                    }
                    Texels::F32(values) => (Precision::F32, values),
                };
            assert_eq!(precision, format.decoded_precision());
            assert_eq!(values.len(), width * height);
            for (i, value) in values.iter().enumerate() {
                let expected = texels[i * format.channels() + channel];
                assert_eq!(value.to_bits(), expected.to_bits(), "{format:?} texel {i} channel {channel}");
            }
        }
    }
}

#[test]
fn names_find_what_they_name() {
    for quality in Quality::all() {
        assert_eq!(Quality::by_name(quality.name()), Some(quality));
    }
    for encoder in Encoder::all() {
        assert_eq!(Encoder::by_name(encoder.name()), Some(encoder));
    }
    assert_eq!((Quality::by_name("Fast"), Encoder::by_name("")), (None, None));
}

/// FNV-1a of the blocks of a map, fast, normal and high.
fn bytes_of(format: BlockFormat) -> [u64; 3] {
    let texels = lopsided(format, 44, 23);
    [Quality::Fast, Quality::Normal, Quality::High].map(|quality| {
        let blocks = encoded(format, BlockCoding { quality, encoder: Encoder::Portable }, &texels, 44);
        let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        blocks.iter().fold(0xcbf2_9ce4_8422_2325, step)
    })
}

#[test]
fn portable_bytes_are_the_same_on_every_machine() {
    let found: Vec<_> = BlockFormat::all().map(|format| (format.name(), bytes_of(format))).collect();
    let golden = [
        ("bc1", [0xac2e_c1f7_da3d_419a, 0x9212_ec42_e120_cc20, 0x1fbd_88f7_9e92_d963]),
        ("bc3", [0xa219_f498_3f3a_0356, 0x2dd4_1513_ce27_0a7f, 0x4930_7d28_154f_7ecc]),
        ("bc4", [0xc4a1_16c8_5850_a93e, 0x922f_8250_79c2_7bf4, 0xb19b_ea04_db55_c25b]),
        ("bc4s", [0x0b35_5861_f358_cda3, 0xbf20_f8b1_49b7_d52e, 0xd020_57c4_2bdc_8e98]),
        ("bc5", [0xf7fa_fd3e_6b6d_709f, 0x0f31_2b5e_4d30_8a27, 0x9218_7907_ee36_2170]),
        ("bc5s", [0x31e9_e49f_235d_14ed, 0x24b8_483c_e6bc_5a47, 0x5462_afb9_b0c0_005b]),
        ("bc6h", [0x6c66_e567_f495_648b, 0xffd3_4e94_2ef9_8c2f, 0xdcaf_8313_c119_aec7]),
        ("bc6hs", [0x90e1_0ff5_fb2f_1d04, 0x4a94_6a09_a4cf_4dac, 0x9301_cb6d_b469_0c8d]),
        ("bc7", [0x2de4_7043_8e48_916d, 0x7515_b56d_7a81_df1d, 0xfb93_5001_45bb_17b3]),
    ];
    assert_eq!(found, golden, "an encoder changed, or depends on the machine: {found:#x?}");
}
