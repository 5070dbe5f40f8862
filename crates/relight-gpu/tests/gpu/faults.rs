//! What is wrong shows.

#[test]
fn timing() {
    use crate::assets::*;
    use relight_gpu::*;
    use std::time::Instant;
    let gpu = gpu(Backend::Any).unwrap();
    for (family, count, layout) in
        [("ptm", 6, relight_core::Layout::Rgb), ("srbf", 25, relight_core::Layout::Rgb)]
    {
        for size in [(37, 23), (256, 256), (1024, 1024)] {
            let format = relight_texture::TexelFormat::Plain {
                precision: relight_texture::Precision::U8,
                channels: 4,
            };
            let maps = asset(model(family, count, layout), format, size, 1);
            let t = Instant::now();
            let mut up = GpuMaps::upload(&gpu, &maps, TextureMode::Native, None).unwrap();
            let t_up = t.elapsed();
            let t = Instant::now();
            up.draw(lights(3)[0], 0).unwrap();
            let first = t.elapsed();
            let t = Instant::now();
            for l in lights(5) {
                up.draw(l, 0).unwrap();
            }
            let draws = t.elapsed() / 5;
            let t = Instant::now();
            for l in lights(5) {
                up.draw_on_gpu(l, 0).unwrap();
            }
            eprintln!(
                "{family} {count} {size:?} upload {t_up:?} first {first:?} draw {draws:?} here {:?}",
                t.elapsed() / 5
            );
        }
    }
}
