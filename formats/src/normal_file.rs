//! Normal maps: pictures whose colours are directions.

use crate::picture::decode;
use crate::{FormatError, PictureDepth, write_picture};
use relight_core::relighter::Picture;
use relight_core::{CpuLevel, Space};
use std::path::Path;

/// Normals of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalPicture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// x right, y up, z out of the picture, rows from the top; read ones have the length that the file gives them.
    pub normals: Vec<[f32; 3]>,
}

/// Writes normals as R, G and B: (n + 1) / 2 in PNG, where 0 lies between two codes and takes the upper one, and n itself in OpenEXR.
///
/// # Errors
/// [`FormatError::Io`] when the file can't be written; nothing is left behind then.
pub fn write_normal_file(
    path: &Path,
    picture: NormalPicture,
    depth: PictureDepth,
) -> Result<(), FormatError> {
    let NormalPicture { width, height, normals } = picture;
    let mut samples = normals.into_flattened();
    if !depth.is_linear() {
        samples.iter_mut().for_each(|value| *value = 0.5 * (*value + 1.0));
    }
    write_picture(path, &Picture { width, height, channels: 3, samples }, depth)
}

/// Reads normals: 2 v - 1 of the codes of an integer picture, values as they are of a float one.
///
/// # Errors
/// Those of [`decode`], and [`FormatError::Unsupported`] for grey pictures.
pub fn read_normal_file(
    path: &Path,
    level: CpuLevel,
    memory_limit: u64,
) -> Result<NormalPicture, FormatError> {
    // A quarter for the picture and its decoder: three floats a pixel come on top.
    let picture = decode(path, level, memory_limit / 4)?;
    if picture.info.channels != 3 {
        return Err(FormatError::unsupported(path, "is grey; normals need R, G and B"));
    }
    let is_float = picture.info.sample_type.is_float();
    let mut values = vec![0.0f32; picture.samples.len()];
    let as_stored = if is_float { Space::Linear } else { Space::Encoded };
    picture.samples.copy_to(as_stored, level, 0, &mut values);
    if !is_float {
        values.iter_mut().for_each(|value| *value = 2.0 * *value - 1.0);
    }
    let normals = values.as_chunks().0.to_vec();
    Ok(NormalPicture { width: picture.info.width, height: picture.info.height, normals })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_come_back_from_every_depth() {
        let folder = tempfile::tempdir().unwrap();
        let normals = vec![
            [0.6, -0.8, 0.0],
            [0.0, 0.28, 0.96],
            [-0.48, 0.6, 0.64],
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        let picture = NormalPicture { width: 3, height: 2, normals };
        for (name, depth, allowed) in [
            ("a.png", PictureDepth::U8, 1.01 / 255.0),
            ("b.png", PictureDepth::U16, 1.01 / 65535.0),
            ("a.exr", PictureDepth::F16, 0.001),
            ("b.exr", PictureDepth::F32, 0.0),
        ] {
            let path = folder.path().join(name);
            write_normal_file(&path, picture.clone(), depth).unwrap();
            let read = read_normal_file(&path, CpuLevel::BASELINE, 64 << 20).unwrap();
            assert_eq!((read.width, read.height), (3, 2));
            for (found, expected) in read.normals.iter().zip(&picture.normals) {
                for c in 0..3 {
                    assert!((found[c] - expected[c]).abs() <= allowed, "{name}: {found:?} {expected:?}");
                }
            }
        }
        let grey = folder.path().join("grey.png");
        let picture = Picture { width: 2, height: 1, channels: 1, samples: vec![0.25, 0.75] };
        write_picture(&grey, &picture, PictureDepth::U8).unwrap();
        assert!(read_normal_file(&grey, CpuLevel::BASELINE, 64 << 20).is_err());
    }
}
