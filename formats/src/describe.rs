//! What is in a file, as names and values.

use crate::FormatError;
use crate::asset::{describe_asset, is_asset};
use crate::light_file::read_light_file;
use crate::picture::probe;
use crate::position_file;
use crate::rig_file::{is_rig, read_rig};
use std::io::Read;
use std::path::Path;

/// Memory that describing a rig may take.
const MOST_OF_RIG: u64 = 4 << 30;

/// Facts about an asset, a picture, a position map, a rig or a light file, recognised by its content (light files by
/// their extension).
///
/// # Errors
/// [`FormatError`] when the file can't be read or is none of these.
pub fn describe(path: &Path) -> Result<Vec<(String, String)>, FormatError> {
    let fact = |name: &str, value: String| (name.to_owned(), value);
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("lp")) {
        let file = read_light_file(path)?;
        let mut facts =
            vec![fact("kind", "light file (.lp)".to_owned()), fact("lights", file.entries.len().to_string())];
        facts.extend(file.notes.into_iter().map(|note| fact("note", note)));
        return Ok(facts);
    }
    if path.is_dir() {
        return describe_asset(path);
    }
    if is_rig(path) {
        return describe_rig(path);
    }
    let mut magic = Vec::new();
    let file = std::fs::File::open(path).map_err(|source| FormatError::io(path, "open", source))?;
    file.take(16).read_to_end(&mut magic).map_err(|source| FormatError::io(path, "read", source))?;
    let as_asset = if is_asset(&magic) { Some(describe_asset(path)) } else { None };
    match as_asset {
        Some(Ok(facts)) => return Ok(facts),
        // An OpenEXR file without our attribute is a picture or a position map; every other damaged asset is that.
        Some(Err(error)) => {
            let picture = |_| probe(path).map(|info| facts_of(&info));
            return position_file::describe(path).or_else(picture).map_err(|_| error);
        }
        None => {}
    }
    Ok(facts_of(&probe(path)?))
}

fn describe_rig(path: &Path) -> Result<Vec<(String, String)>, FormatError> {
    let file = read_rig(path, MOST_OF_RIG)?;
    let mut facts = vec![
        ("kind".to_owned(), "irradiance rig (.rig)".to_owned()),
        ("mesh".to_owned(), format!("{}, {} triangles", file.mesh.name, file.mesh.triangles)),
        ("bands".to_owned(), file.rig.bands.to_string()),
    ];
    for part in &file.rig.parts {
        let name = if part.name.is_empty() { "part".to_owned() } else { format!("part {}", part.name) };
        let vectors = part.model.parameters().len();
        let (samples, radius) = (part.samples.len(), part.frame.radius);
        facts.push((
            name,
            format!("{}: vectors {vectors}, samples {samples}, radius {radius:.4}", part.model.text()),
        ));
    }
    Ok(facts)
}

fn facts_of(info: &crate::PictureInfo) -> Vec<(String, String)> {
    let fact = |name: &str, value: String| (name.to_owned(), value);
    let mut facts = vec![
        fact("kind", "picture".to_owned()),
        fact("size", format!("{} x {}", info.width, info.height)),
        fact("channels", if info.channels == 1 { "grey" } else { "RGB" }.to_owned()),
        fact("samples", format!("{:?}", info.sample_type).to_lowercase()),
    ];
    if info.alpha {
        facts.push(fact("alpha", "present, ignored".to_owned()));
    }
    if let Some(profile) = &info.color_profile {
        facts.push(fact("colour profile", profile.clone()));
    }
    if let Some(orientation) = info.orientation {
        facts.push(fact("EXIF orientation", orientation.to_string()));
    }
    facts
}
