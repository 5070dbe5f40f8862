//! Position maps in OpenEXR files: channels X, Y and Z of floats.

use crate::exr_channels::{self, choose, float_of, guarded, lettered, prefixes, read_blocks};
use crate::{FormatError, OutputFile};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes, Text,
    WritableImage,
};
use relight_core::{NO_SURFACE, PointKind, PositionMap};
use std::io::{BufWriter, Write};
use std::path::Path;

/// The attribute of files in which a point may lie at the origin: there, a missing one is NaN.
const MARK: &str = "relight.positions";

/// The attribute of EXR assets, whose positions are like those of marked files.
const ASSET: &str = "relight";

/// Bytes of a point.
const POINT: u64 = 12;

/// Writes a map as OpenEXR: float channels X, Y, Z in the axes of the world, NaN where there is no
/// surface, ZIP compression, and the attribute `relight.positions`.
///
/// Takes as much memory as the map beside it.
/// # Errors
/// [`FormatError::Io`] when the file can't be written, [`FormatError::Invalid`] for a map without pixels;
/// nothing is left behind then.
pub fn write_position_file(path: &Path, map: &PositionMap) -> Result<(), FormatError> {
    let PositionMap { width, height, points } = map;
    if *width == 0 || *height == 0 || (*width).max(*height) > i32::MAX as usize {
        let problem = format!("{width} x {height} positions are outside 1..2147483647 of OpenEXR");
        return Err(FormatError::invalid(path, problem));
    }
    let channel = |(axis, name): (usize, &str)| {
        AnyChannel::new(name, FlatSamples::F32(points.iter().map(|point| point[axis]).collect()))
    };
    let channels = ["X", "Y", "Z"].into_iter().enumerate().map(channel).collect();
    let ascii = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    let mut attributes = LayerAttributes {
        software_name: Some(ascii(concat!("relight ", env!("CARGO_PKG_VERSION")))),
        ..LayerAttributes::default()
    };
    let words = AttributeValue::Text(ascii("world axes; NaN where there is no surface"));
    attributes.other.insert(ascii(MARK), words);
    let layer =
        Layer::new((*width, *height), attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels));
    let file = OutputFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.file());
    let written = Image::from_layer(layer).write().to_buffered(&mut out);
    written.map_err(|error| FormatError::io(path, "write", std::io::Error::other(error)))?;
    out.flush().map_err(|e| FormatError::io(path, "write", e))?;
    drop(out);
    file.finish()
}

/// Reads a map from OpenEXR, ours or another program's: channels X, Y, Z or else R, G, B, without prefix
/// or with one such as `position.`, half or float, in the axes of the world.
///
/// A point with a component that is not finite is missing; in files that relight did not write, (0, 0, 0)
/// is too, which is what renderers write where they hit nothing.
/// # Errors
/// [`FormatError::Unsupported`] for files without such channels, [`FormatError::Invalid`] for damaged
/// ones, [`FormatError::TooLarge`] when points and working space exceed `memory_limit` bytes,
/// [`FormatError::Io`].
pub fn read_position_file(path: &Path, memory_limit: u64) -> Result<PositionMap, FormatError> {
    guarded(path, || {
        let reader = exr_channels::open(path)?;
        let chosen = choose(reader.headers(), path, position_channels, |found| {
            format!(
                "has no channels X, Y, Z or R, G, B that are plainly positions (found: {found}); name them position.X, position.Y, position.Z"
            )
        })?;
        let (width, height) = (chosen.width, chosen.height);
        chosen.check_memory(path, POINT, memory_limit)?;
        let attributes = &reader.headers()[chosen.layer].own_attributes.other;
        let ours = [MARK, ASSET].iter().any(|&name| attributes.contains_key(&Text::from(name)));
        let mut points = vec![[0.0; 3]; width * height];
        read_blocks(reader, &chosen, path, |at, channel, bytes| {
            points[at / 3][at % 3] = float_of(channel, bytes);
        })?;
        for point in &mut points {
            if PointKind::of(*point) == PointKind::Missing || (!ours && *point == [0.0; 3]) {
                *point = NO_SURFACE;
            }
        }
        Ok(PositionMap { width, height, points })
    })
}

/// What [`crate::describe`] says of a file that holds positions and no colours.
pub(crate) fn describe(path: &Path) -> Result<Vec<(String, String)>, FormatError> {
    guarded(path, || {
        let reader = exr_channels::open(path)?;
        let colored = |names: &[String]| lettered(names, "", &["R", "G", "B"]).is_some();
        let wanted = |names: &[String]| lettered(names, "", &["X", "Y", "Z"]).filter(|_| !colored(names));
        let chosen = choose(reader.headers(), path, wanted, |found| format!("has no positions but {found}"))?;
        let fact = |name: &str, value: String| (name.to_owned(), value);
        Ok(vec![
            fact("kind", "position map".to_owned()),
            fact("size", format!("{} x {}", chosen.width, chosen.height)),
            fact("channels", "X, Y, Z".to_owned()),
            fact("samples", if chosen.half { "f16" } else { "f32" }.to_owned()),
        ])
    })
}

/// The indices of x, y and z among a layer's channels; `None` where several could be meant.
fn position_channels(names: &[String]) -> Option<Vec<usize>> {
    [["X", "Y", "Z"], ["R", "G", "B"]].iter().find_map(|letters| {
        let all = prefixes(names)
            .into_iter()
            .filter_map(|prefix| Some((lettered(names, &prefix, letters)?, prefix)));
        let named = |prefix: &str, words: &[&str]| {
            let word = prefix.trim_end_matches('.').rsplit('.').next().unwrap_or_default();
            words.iter().any(|known| word.eq_ignore_ascii_case(known))
        };
        let mut all: Vec<_> = all.filter(|(_, prefix)| !named(prefix, &["n", "normal", "normals"])).collect();
        if all.len() > 1 {
            all.retain(|(_, prefix)| named(prefix, &["", "p", "pos", "position"]));
        }
        match all.len() {
            1 => all.pop().map(|(found, _)| found),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_told_from_colours_and_normals() {
        let chosen = |names: &str| {
            let names: Vec<String> = names.split(' ').map(str::to_owned).collect();
            position_channels(&names)
                .map(|found| found.into_iter().map(|at| names[at].clone()).collect::<Vec<_>>().join(" "))
        };
        for (names, expected) in [
            ("X Y Z", "X Y Z"),
            ("B G R", "R G B"),
            ("A B G R position.X position.Y position.Z", "position.X position.Y position.Z"),
            (
                "L.Normal.X L.Normal.Y L.Normal.Z L.Position.X L.Position.Y L.Position.Z",
                "L.Position.X L.Position.Y L.Position.Z",
            ),
            ("N.X N.Y N.Z R G B", "R G B"),
            ("P.B P.G P.R beauty.B beauty.G beauty.R", "P.R P.G P.B"),
        ] {
            assert_eq!(chosen(names).as_deref(), Some(expected), "{names}");
        }
        for names in ["X Y", "Y", "N.X N.Y N.Z", "a.R a.G a.B b.R b.G b.B", "P.X P.Y P.Z X Y Z"] {
            assert_eq!(chosen(names), None, "{names}");
        }
    }
}
