//! `info.json` of a web folder: what it says, read and written.
//!
//! Source: FORMATS.md of this project.

use super::open_measured;
use crate::FormatError;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The file that tells what the others of the folder are.
pub(super) const INFO: &str = "info.json";

/// More is no description: 128 planes over 50 x 50 directions take half of it.
const LARGEST: u64 = 8 << 20;

/// Numbers take up to so many times the bytes of their text: two characters are a float, in a list that may
/// have grown to twice its length.
const MEMORY_FACTOR: u64 = 6;

/// The keys of `info.json`; others are ignored.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct WebInfo {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Of the planes' files.
    pub(super) format: String,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) colorspace: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) nplanes: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) quality: Option<f64>,
    /// x, y, z of one light after another.
    #[serde(default)]
    pub(super) lights: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) resolution: Option<usize>,
    /// Mean, then planes; of each all directions, of each R, G, B.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) basis: Vec<f32>,
    /// One: what there might be more of is not read.
    pub(super) materials: Vec<WebMaterial>,
    #[serde(rename = "pixelSizeInMM", skip_serializing_if = "Option::is_none")]
    pub(super) pixel_size_in_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) colorprofile: Option<String>,
}

/// Value = (byte / 255 - bias) x scale in 0..1 units, plane by plane.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct WebMaterial {
    /// Codes of a plane's weights for a weight of 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) range: Vec<f64>,
    pub(super) scale: Vec<f64>,
    pub(super) bias: Vec<f64>,
}

/// Where the description is: `path` itself, or in the folder `path`.
pub(super) fn info_path(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(INFO) } else { path.to_owned() }
}

/// Whether `path` is a web folder or its description: a folder that has one, or a file that names materials.
pub(super) fn is_web(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(INFO).is_file();
    }
    let names_materials = || -> Option<bool> {
        let mut file = open_measured(path).ok()?.0;
        let mut text = vec![0];
        file.read_exact(&mut text).ok()?;
        if text.starts_with(b"{") {
            file.take(LARGEST).read_to_end(&mut text).ok()?;
        }
        let key = b"\"materials\"";
        Some(text.windows(key.len()).any(|window| window == key))
    };
    names_materials() == Some(true)
}

/// Reads the description at `path`.
///
/// # Errors
/// [`FormatError::Io`], [`FormatError::Invalid`], and [`FormatError::TooLarge`] where reading it would exceed
/// `memory_limit`.
pub(super) fn read_info(path: &Path, memory_limit: u64) -> Result<WebInfo, FormatError> {
    let (file, bytes) = open_measured(path)?;
    if bytes > LARGEST {
        let problem =
            format!("has {bytes} bytes where {LARGEST} are the most; write it anew with fewer directions");
        return Err(FormatError::invalid(path, problem));
    }
    let needed = MEMORY_FACTOR * bytes;
    if needed > memory_limit {
        return Err(FormatError::too_large(path, needed, memory_limit));
    }
    let mut text = Vec::with_capacity(bytes as usize);
    file.take(LARGEST).read_to_end(&mut text).map_err(|e| FormatError::io(path, "read", e))?;
    serde_json::from_slice(&text).map_err(|error| {
        let problem =
            format!("does not describe a web folder: {error}; write it anew with the program that made it");
        FormatError::invalid(path, problem)
    })
}
