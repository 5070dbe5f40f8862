//! Tables of learned functions as texels.

use half::f16;
use relight_core::basis::{FunctionsOfLight, Learned};

/// The table as RGBA halves, row by row and layer by layer of its square: functions 4 i .. 4 i + 4 in the channels
/// of layer i, zeros beyond the last.
pub fn function_texels(learned: &Learned) -> Vec<[f16; 4]> {
    let count = learned.count();
    let nodes = || learned.table().chunks_exact(count);
    (0..count.div_ceil(4))
        .flat_map(|group| {
            nodes().map(move |node| {
                [0, 1, 2, 3].map(|c| node.get(4 * group + c).map_or(f16::ZERO, |value| f16::from_f32(*value)))
            })
        })
        .collect()
}
