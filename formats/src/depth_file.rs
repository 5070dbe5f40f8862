//! Depth maps: a channel of an OpenEXR file, or a grey picture and the unit of its codes.

use crate::FormatError;
use crate::exr_channels::{self, choose, float_of, guarded, read_blocks};
use crate::picture::{Samples, decode};
use relight_core::{CpuLevel, DepthMap};
use std::io::Read;
use std::path::Path;

/// Bytes of a depth.
const DEPTH: u64 = 4;

/// Reads depths: of an OpenEXR file the channel of that name or the only one that can be meant, of every
/// other kind of picture its grey samples, integers as they are stored. They are multiplied by `scale`,
/// the world's units in one of the file's.
///
/// # Errors
/// [`FormatError::Unsupported`] for files without such a channel, [`FormatError::Invalid`] for damaged
/// ones, [`FormatError::TooLarge`] when depths and working space exceed `memory_limit` bytes,
/// [`FormatError::Io`].
pub fn read_depth_file(
    path: &Path,
    channel: Option<&str>,
    scale: f64,
    memory_limit: u64,
) -> Result<DepthMap, FormatError> {
    let mut start = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| FormatError::io(path, "open", e))?;
    file.take(4).read_to_end(&mut start).map_err(|e| FormatError::io(path, "read", e))?;
    let mut map = match (start == exr_channels::MAGIC, channel) {
        (true, _) => guarded(path, || from_exr(path, channel, memory_limit))?,
        (false, None) => from_picture(path, memory_limit)?,
        (false, Some(channel)) => {
            let problem = format!("is no OpenEXR and has no channel '{channel}'; leave the channel away");
            return Err(FormatError::unsupported(path, problem));
        }
    };
    if scale != 1.0 {
        map.depths.iter_mut().for_each(|depth| *depth = (f64::from(*depth) * scale) as f32);
    }
    Ok(map)
}

fn from_exr(path: &Path, channel: Option<&str>, memory_limit: u64) -> Result<DepthMap, FormatError> {
    let reader = exr_channels::open(path)?;
    let wanted = |names: &[String]| match channel {
        Some(channel) => names.iter().position(|name| name == channel).map(|at| vec![at]),
        None => depth_channel(names).map(|at| vec![at]),
    };
    let chosen = choose(reader.headers(), path, wanted, |found| match channel {
        Some(channel) => format!("has no channel '{channel}'; it has: {found}"),
        None => format!("has not one channel that is plainly depth; name one of: {found}"),
    })?;
    chosen.check_memory(path, DEPTH, memory_limit)?;
    let (width, height) = (chosen.width, chosen.height);
    let mut depths = vec![0.0; width * height];
    read_blocks(reader, &chosen, path, |at, channel, bytes| depths[at] = float_of(channel, bytes))?;
    Ok(DepthMap { width, height, depths })
}

/// The channel that can only be depth: the only one, or the only one called Z or depth.
fn depth_channel(names: &[String]) -> Option<usize> {
    if names.len() == 1 {
        return Some(0);
    }
    let is_depth = |name: &str| {
        let (prefix, word) = name.rsplit_once('.').map_or(("", name), |(prefix, word)| (prefix, word));
        let sibling = if prefix.is_empty() { "X".to_owned() } else { format!("{prefix}.X") };
        let last = prefix.rsplit('.').next().unwrap_or_default();
        let position = names.contains(&sibling);
        (word.eq_ignore_ascii_case("z") && !position)
            || [word, last].iter().any(|w| w.eq_ignore_ascii_case("depth"))
    };
    let mut found = (0..names.len()).filter(|&at| is_depth(&names[at]));
    found.next().filter(|_| found.next().is_none())
}

fn from_picture(path: &Path, memory_limit: u64) -> Result<DepthMap, FormatError> {
    // Samples and depths are in memory at once.
    let picture = decode(path, CpuLevel::detect(), memory_limit / 3)?;
    let (width, height) = (picture.info.width, picture.info.height);
    if picture.info.channels != 1 {
        let problem = "is a picture of colours; depths are one channel, save them as grey";
        return Err(FormatError::unsupported(path, problem));
    }
    let depths = match picture.samples {
        Samples::U8(codes) => codes.into_iter().map(f32::from).collect(),
        Samples::U16(codes) => codes.into_iter().map(f32::from).collect(),
        Samples::F16(halves) => halves.into_iter().map(half::f16::to_f32).collect(),
        Samples::F32(floats) => floats,
    };
    Ok(DepthMap { width, height, depths })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_told_from_other_channels() {
        let chosen = |names: &str| {
            let names: Vec<String> = names.split(' ').map(str::to_owned).collect();
            depth_channel(&names).map(|at| names[at].clone())
        };
        for (names, expected) in [
            ("Y", "Y"),
            ("whatever", "whatever"),
            ("A B G R Z", "Z"),
            ("B G R depth", "depth"),
            ("L.Combined.R L.Depth.Z L.Normal.X L.Normal.Y L.Normal.Z", "L.Depth.Z"),
            ("X Y Z depth.V", "depth.V"),
        ] {
            assert_eq!(chosen(names).as_deref(), Some(expected), "{names}");
        }
        for names in ["R G B", "X Y Z", "a.Z b.Z", "depth.R depth.G"] {
            assert_eq!(chosen(names), None, "{names}");
        }
    }
}
