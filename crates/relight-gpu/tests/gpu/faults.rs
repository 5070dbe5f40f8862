//! What is wrong on one side shows: the verifier must be able to fail.

use crate::assets::{asset, gpu, lights, model};
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Layout};
use relight_gpu::{Backend, DecodingBound, Difference, Gpu, GpuMaps, TextureMode, maps_of_level};
use relight_texture::{BlockFormat, PackedMaps, Precision, TexelFormat};

/// The largest difference at two lights, over what is allowed there.
fn excess(gpu: &Gpu, drawn: &PackedMaps, judged: &PackedMaps, mode: TextureMode) -> f64 {
    let reference = maps_of_level(judged, 0);
    let bound = DecodingBound::new(&reference, &judged.packing);
    let mut drawn = GpuMaps::upload(gpu, drawn, mode, None).unwrap();
    let of_light = |light| {
        let difference = Difference::between(
            &drawn.draw(light, 0).unwrap(),
            &relight(&reference, light, CpuLevel::BASELINE),
        );
        let decoding = if mode == TextureMode::Native { bound.at(light) } else { 0.0 };
        difference.max / (decoding + 1e-5 * difference.full_range)
    };
    lights(2).into_iter().map(of_light).fold(0.0, f64::max)
}

/// Every fault that has to show, made in texels of one byte or one block a unit.
fn faults(maps: &PackedMaps) -> Vec<(&'static str, PackedMaps)> {
    let change = |name, change: &dyn Fn(&mut PackedMaps)| {
        let mut changed = maps.clone();
        change(&mut changed);
        (name, changed)
    };
    let format = maps.packing.arrays[0].format;
    let unit = format.unit_bytes();
    let row = format.row_bytes(maps.width) as usize;
    let layer = format.layer_bytes(maps.width, maps.height) as usize;
    let columns = row / unit;
    vec![
        change("a scale 10 % too large", &|maps| {
            maps.packing.arrays[0].layers[1].quantizers.iter_mut().for_each(|q| q.scale *= 1.1);
        }),
        change("a bias of 0.05 too much", &|maps| {
            maps.packing.arrays[0].layers[2].quantizers.iter_mut().for_each(|q| q.bias += 0.05);
        }),
        change("swapped layers", &|maps| {
            let (a, b) = maps.texels[0][0].split_at_mut(layer);
            a.swap_with_slice(&mut b[..layer]);
        }),
        change("rows from the bottom", &|maps| {
            for layer in maps.texels[0][0].chunks_exact_mut(layer) {
                let rows: Vec<Vec<u8>> = layer.chunks_exact(row).rev().map(<[u8]>::to_vec).collect();
                layer.copy_from_slice(&rows.concat());
            }
        }),
        change("transposed", &|maps| {
            for layer in maps.texels[0][0].chunks_exact_mut(layer) {
                let units: Vec<Vec<u8>> = layer.chunks_exact(unit).map(<[u8]>::to_vec).collect();
                for (i, target) in layer.chunks_exact_mut(unit).enumerate() {
                    target.copy_from_slice(&units[i % columns * columns + i / columns]);
                }
            }
        }),
        change("one texel or block of another", &|maps| {
            let (a, b) = maps.texels[0][0].split_at_mut(unit * (columns + 1));
            a[..unit].copy_from_slice(&b[..unit]);
        }),
    ]
}

#[test]
fn every_fault_exceeds_the_bound_in_both_modes() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    for format in [
        TexelFormat::Plain { precision: Precision::U8, channels: 4 },
        TexelFormat::Block(BlockFormat::Bc1),
        TexelFormat::Block(BlockFormat::Bc4Signed),
        TexelFormat::Block(BlockFormat::Bc7),
    ] {
        // As many columns as rows, or transposing would be another picture's shape.
        let maps = asset(model("ptm", 6, Layout::Rgb), format, (64, 64), 1);
        for mode in [TextureMode::Native, TextureMode::Decoded] {
            let right = excess(&gpu, &maps, &maps, mode);
            assert!(right <= 1.0, "{} {mode:?}: {right}", format.name());
            for (fault, changed) in faults(&maps) {
                let excess = excess(&gpu, &changed, &maps, mode);
                assert!(
                    excess > 1.0,
                    "{} {mode:?}, {fault}: only {excess} of what is allowed",
                    format.name()
                );
            }
        }
    }
}

#[test]
fn one_percent_of_a_scale_shows_where_decoding_is_exact() {
    let Some(gpu) = gpu(Backend::Any) else { return };
    let formats =
        [TexelFormat::Plain { precision: Precision::U8, channels: 4 }, TexelFormat::Block(BlockFormat::Bc7)];
    for format in formats {
        let maps = asset(model("ptm", 6, Layout::Rgb), format, (37, 23), 1);
        let mut changed = maps.clone();
        changed.packing.arrays[0].layers[3].quantizers[1].scale *= 1.01;
        assert!(excess(&gpu, &changed, &maps, TextureMode::Native) > 10.0);
    }
    // Blocks that the GPU decodes roughly hide it there, not where we decode them.
    let maps = asset(model("ptm", 6, Layout::Rgb), TexelFormat::Block(BlockFormat::Bc1), (37, 23), 1);
    let mut changed = maps.clone();
    changed.packing.arrays[0].layers[3].quantizers[1].scale *= 1.01;
    assert!(excess(&gpu, &changed, &maps, TextureMode::Decoded) > 10.0);
}
