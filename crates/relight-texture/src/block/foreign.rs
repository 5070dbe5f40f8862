//! Prebuilt ISPC kernels: bc7e for BC7, Intel's for unsigned BC6H. Compiled with fast math for
//! several instruction sets, of which they choose one at run time: never the default.

pub(super) use kernels::{BC6H, BC7};

#[cfg(all(
    feature = "ispc",
    any(target_arch = "x86_64", target_arch = "aarch64"),
    any(
        all(target_os = "linux", target_env = "gnu"),
        target_os = "macos",
        all(target_os = "windows", target_env = "msvc")
    )
))]
mod kernels {
    use crate::block::encode::{BlockRow, EncodeRow};
    use crate::block::{BlockCoding, Quality};
    use half::f16;

    pub(in crate::block) const BC6H: Option<EncodeRow> = Some(bc6h);
    pub(in crate::block) const BC7: Option<EncodeRow> = Some(bc7);

    // Intel's archive holds a C++ file (for ASTC) that wants the run time of its exceptions.
    #[cfg_attr(target_os = "linux", link(name = "stdc++"))]
    #[cfg_attr(target_os = "macos", link(name = "c++"))]
    unsafe extern "C" {}

    fn bc6h(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
        use intel_tex_2::bc6h;
        let settings = match coding.quality {
            Quality::Fast => bc6h::fast_settings(),
            Quality::Normal => bc6h::basic_settings(),
            Quality::High => bc6h::slow_settings(),
            Quality::Best => bc6h::very_slow_settings(),
        };
        let halves: Vec<[f16; 4]> = row
            .texels
            .chunks_exact(3)
            .map(|texel| [texel[0], texel[1], texel[2], 1.0].map(f16::from_f32))
            .collect();
        let width = row.width as u32;
        let data = bytemuck::cast_slice(&halves);
        let surface = intel_tex_2::RgbaSurface { data, width, height: 4, stride: width * 8 };
        bc6h::compress_blocks_into(&settings, &surface, out);
    }

    fn bc7(row: BlockRow<'_>, coding: BlockCoding, out: &mut [u8]) {
        use ctt_bc7enc_rdo as bc7e;
        // Coefficients are no colours to be looked at: no perceptual metric.
        let parameters = match coding.quality {
            Quality::Fast => bc7e::params_init_fast(false),
            Quality::Normal => bc7e::params_init_basic(false),
            Quality::High => bc7e::params_init_slow(false),
            Quality::Best => bc7e::params_init_veryslow(false),
        };
        let code = |value: f32| (value * 255.0 + 0.5) as u8;
        let texels: Vec<u32> = row
            .blocks::<48>()
            .flat_map(|block| {
                let texel = |i: usize| [code(block[i]), code(block[i + 1]), code(block[i + 2]), 255];
                std::array::from_fn::<u32, 16, _>(|i| u32::from_ne_bytes(texel(3 * i)))
            })
            .collect();
        let mut blocks = vec![0u64; out.len() / 8];
        bc7e::compress_blocks(&mut blocks, &texels, &parameters);
        out.copy_from_slice(bytemuck::cast_slice(&blocks));
    }
}

#[cfg(not(all(
    feature = "ispc",
    any(target_arch = "x86_64", target_arch = "aarch64"),
    any(
        all(target_os = "linux", target_env = "gnu"),
        target_os = "macos",
        all(target_os = "windows", target_env = "msvc")
    )
)))]
mod kernels {
    use crate::block::encode::EncodeRow;

    pub(in crate::block) const BC6H: Option<EncodeRow> = None;
    pub(in crate::block) const BC7: Option<EncodeRow> = None;
}
