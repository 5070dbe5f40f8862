//! The JSON document that stands in KTX2 files under the key `relight` and in EXR files as the
//! attribute `relight`: everything about an asset but its texels. docs/formats.md has its fields.

use crate::FormatError;
use relight_core::{Basis, Direction, FitFigures, Layout, Model, Space};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The key and the attribute that hold the document.
pub(super) const KEY: &str = "relight";

/// The document's version that this program writes and reads.
const VERSION: u32 = 1;

/// The longest document that is read: a million lights would fit.
pub(super) const LONGEST: u64 = 32 << 20;

/// Which planes the channels of a texture layer hold, and how texels become coefficients:
/// coefficient = scale x texel + bias.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Layer {
    /// Index of the plane in each channel, in the order of `Model::roles`.
    pub(super) planes: Vec<usize>,
    /// One per plane.
    pub(super) scale: Vec<f32>,
    /// One per plane.
    pub(super) bias: Vec<f32>,
}

#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

#[derive(Serialize, Deserialize)]
struct Document {
    version: u32,
    basis: Basis,
    layout: Layout,
    space: Space,
    #[serde(default)]
    lights: Vec<Direction>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    error: Option<ErrorRecord>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layers: Option<Vec<Layer>>,
}

/// JSON has no word for infinity: what is not finite is null, and comes back as NaN.
#[derive(Serialize, Deserialize)]
struct ErrorRecord {
    fit_rmse: Option<f64>,
    leave_one_out_rmse: Option<f64>,
}

/// The document of `model`, in one line of ASCII, the same for the same model.
///
/// # Errors
/// [`FormatError::Invalid`] when a number in it is not finite.
pub(super) fn text_of(path: &Path, model: &Model, layers: Option<Vec<Layer>>) -> Result<String, FormatError> {
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let document = Document {
        version: VERSION,
        basis: model.basis.clone(),
        layout: model.layout,
        space: model.space,
        lights: model.lights.clone(),
        error: model.figures.map(|figures| ErrorRecord {
            fit_rmse: finite(figures.fit_rmse),
            leave_one_out_rmse: finite(figures.leave_one_out_rmse),
        }),
        layers,
    };
    let text = serde_json::to_string(&document)
        .map_err(|e| FormatError::invalid(path, format!("its metadata can't be written: {e}")))?;
    if text.len() as u64 > LONGEST {
        let (bytes, lights) = (text.len(), model.lights.len());
        let problem =
            format!("metadata of {bytes} bytes ({lights} lights) exceed {LONGEST}; use fewer lights");
        return Err(FormatError::invalid(path, problem));
    }
    Ok(text)
}

/// The model of a document, and its layers where it has some.
///
/// # Errors
/// [`FormatError::Unsupported`] for a version that is not ours, [`FormatError::Invalid`] for
/// anything that is not such a document.
pub(super) fn parse(path: &Path, text: &[u8]) -> Result<(Model, Option<Vec<Layer>>), FormatError> {
    let invalid = |e| FormatError::invalid(path, format!("its metadata '{KEY}' are damaged: {e}"));
    let Versioned { version } = serde_json::from_slice(text).map_err(invalid)?;
    if version != VERSION {
        let problem = format!("has metadata of version {version}; this relight reads version {VERSION}");
        return Err(FormatError::unsupported(path, problem));
    }
    let document: Document = serde_json::from_slice(text).map_err(invalid)?;
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let model = Model {
        basis: document.basis,
        layout: document.layout,
        space: document.space,
        lights: document.lights,
        figures: document.error.map(|error| FitFigures {
            fit_rmse: number(error.fit_rmse),
            leave_one_out_rmse: number(error.leave_one_out_rmse),
        }),
    };
    Ok((model, document.layers))
}
