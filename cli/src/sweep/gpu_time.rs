//! What a pixel costs on the GPU once it is baked.

use super::outcome::GpuTime;
use crate::options::Machine;
use std::path::Path;

/// The adapter on which pictures are timed, where there is one.
#[derive(Default)]
pub(crate) struct GpuClock {
    #[cfg(feature = "gpu")]
    gpu: Option<relight_gpu::Gpu>,
}

#[cfg(feature = "gpu")]
impl GpuClock {
    /// Pictures of which the fastest counts.
    const PICTURES: usize = 3;

    /// Seconds after which no further picture is drawn: adapters that are programs take long, and alike.
    const ENOUGH: f64 = 0.1;

    /// Of the fastest adapter.
    pub(crate) fn open() -> Self {
        Self { gpu: relight_gpu::Gpu::open(relight_gpu::Backend::Any).ok() }
    }

    /// The time of a pixel of `asset` under a directional light, its texels as they are; nothing where no adapter
    /// draws it.
    pub(crate) fn time(&self, asset: &Path, machine: &Machine) -> Option<GpuTime> {
        use relight_gpu::{GpuMaps, TextureMode};
        let gpu = self.gpu.as_ref()?;
        let packed = relight_formats::read_packed(asset, machine.memory).ok()?;
        let pixels = (packed.width * packed.height) as f64;
        let mut maps = GpuMaps::upload(gpu, &packed, TextureMode::Native, None).ok()?;
        let (mut least, mut spent) = (f64::INFINITY, 0.0);
        // The first picture makes programs and memory.
        maps.draw_on_gpu(relight_core::Direction::OUT, 0).ok()?;
        for _ in 0..Self::PICTURES {
            let start = std::time::Instant::now();
            maps.draw_on_gpu(relight_core::Direction::OUT, 0).ok()?;
            let seconds = start.elapsed().as_secs_f64();
            (least, spent) = (least.min(seconds), spent + seconds);
            if spent > Self::ENOUGH {
                break;
            }
        }
        Some(GpuTime { adapter: gpu.name(), ns: least * 1e9 / pixels })
    }
}

#[cfg(not(feature = "gpu"))]
impl GpuClock {
    /// There is none.
    pub(crate) fn open() -> Self {
        Self {}
    }

    /// Nothing.
    pub(crate) fn time(&self, _: &Path, _: &Machine) -> Option<GpuTime> {
        None
    }
}
