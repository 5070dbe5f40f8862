//! What an asset was made of: contents and choices, never names, places, times or threads.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Everything that decides an asset's bytes. Two bakes of the same provenance give the same asset.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The number of the program's arithmetic and formats: it rises when the same inputs give other bytes.
    pub abi: u32,
    /// What decides the coefficients beside the pictures, by name; values as resolved, contents of files as hashes.
    pub fit: BTreeMap<String, String>,
    /// What decides how coefficients are stored, by name.
    pub storing: BTreeMap<String, String>,
    /// The fitted pictures, in the order of their lights' directions.
    pub pictures: Vec<PictureRecord>,
    /// The pictures that were left out, in that order, where exposures or a white balance were found in them too; nobody else is asked
    /// about them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub judges: Vec<PictureRecord>,
}

/// A picture and its light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureRecord {
    /// Hash of the file's bytes: 32 hexadecimal digits of BLAKE3.
    pub content: String,
    /// Unit direction towards the light.
    pub light: [f64; 3],
    /// How bright its lamp was, where a file says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity: Option<[f64; 3]>,
    /// Where its lamp was, where lamps are near.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamp: Option<[f64; 3]>,
}
