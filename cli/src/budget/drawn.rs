//! How far pictures that a GPU draws are from the CPU's.

use super::GpuDifference;
use crate::failure::Failure;
use crate::options::Machine;
use relight_core::{Direction, RelightingMaps};
use std::path::Path;

/// Lights that are drawn, evenly from all.
#[cfg(feature = "gpu")]
const LIGHTS: usize = 8;

/// The difference at a few of `lights` of `asset`, which the CPU has as `maps`; a sentence where there is no GPU or it fails.
///
/// # Errors
/// Ctrl-C.
#[cfg(feature = "gpu")]
pub(super) fn difference(
    asset: &Path,
    maps: &RelightingMaps,
    lights: &[Direction],
    machine: &Machine,
) -> Result<Result<GpuDifference, String>, Failure> {
    let found = draw(asset, maps, &crate::verify::evenly(lights, LIGHTS), machine);
    crate::interrupt::check()?;
    Ok(found.map_err(|failure| failure.words().to_owned()))
}

#[cfg(feature = "gpu")]
fn draw(
    asset: &Path,
    maps: &RelightingMaps,
    lights: &[Direction],
    machine: &Machine,
) -> Result<GpuDifference, Failure> {
    use relight_gpu::{Backend, Gpu, GpuMaps, TextureMode};
    let gpu = Gpu::open(Backend::Any)?;
    let left = machine.memory.saturating_sub(maps.texel_bytes());
    let packed = relight_formats::read_packed(asset, left)?;
    let mut drawn = GpuMaps::upload(&gpu, &packed, TextureMode::Native, None)?;
    let bar = crate::progress::bar("drawing", lights.len());
    let differences = crate::verify::differences(&mut drawn, maps, lights, machine, &bar)?;
    bar.finish_and_clear();
    let squares: f64 = differences.iter().map(|difference| difference.rms * difference.rms).sum();
    Ok(GpuDifference {
        adapter: gpu.name(),
        max: differences.iter().fold(0.0, |max, difference| max.max(difference.max)),
        rms: (squares / differences.len().max(1) as f64).sqrt(),
        lights: differences.len(),
    })
}

/// As with the cargo feature `gpu`: a sentence.
#[cfg(not(feature = "gpu"))]
#[expect(clippy::unnecessary_wraps, reason = "a program with a GPU can be interrupted here")]
pub(super) fn difference(
    _: &Path,
    _: &RelightingMaps,
    _: &[Direction],
    _: &Machine,
) -> Result<Result<GpuDifference, String>, Failure> {
    Ok(Err("this program was built without the cargo feature gpu".to_owned()))
}
