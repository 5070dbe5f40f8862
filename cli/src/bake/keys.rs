//! Keys: what decides an asset's bytes, without names, places, times and threads.

use super::{BakeArguments, Division};
use crate::failure::Failure;
use rayon::prelude::*;
use relight_core::{PictureRecord, Provenance};
use relight_formats::{AssetFormat, OpenCapture, content_hash, hexadecimal, record_key};
use std::path::Path;

/// The number of the program's arithmetic and formats. It rises with every change after which the same inputs give other
/// bytes, so that nothing is taken up from before.
pub(crate) const ABI: u32 = 1;

/// Bytes of a content hash that a provenance keeps.
const CONTENT_BYTES: usize = 16;

/// The key of everything.
pub(crate) fn key_of(provenance: &Provenance) -> [u8; 32] {
    record_key(provenance)
}

/// The key of what decides the coefficients.
pub(crate) fn fit_key_of(provenance: &Provenance) -> [u8; 32] {
    let Provenance { abi, fit, pictures, judges, storing: _ } = provenance;
    record_key(&(abi, fit, pictures, judges))
}

/// What the asset of `arguments` will be made of, and the key of the pictures that judge it. `all` are its pictures in the order
/// of their lights' directions; `with_positions` says whether it stores positions.
pub(super) fn provenance(
    arguments: &BakeArguments,
    format: &AssetFormat,
    all: &OpenCapture,
    division: &Division,
    with_positions: bool,
) -> Result<(Provenance, [u8; 32]), Failure> {
    let fitted = all.select(&division.kept);
    let owned = |settings: Vec<(&'static str, String)>| {
        settings.into_iter().map(|(name, value)| (name.to_owned(), value))
    };
    let mut fit: std::collections::BTreeMap<_, _> = owned(arguments.fit.named(&fitted)?).collect();
    fit.extend(owned(arguments.photographs.named()));
    let mut storing: std::collections::BTreeMap<_, _> = owned(arguments.textures.named(format)).collect();
    storing.insert("format".to_owned(), format.name.to_owned());
    storing.insert("positions".to_owned(), with_positions.to_string());
    if arguments.fit.budget_bytes().is_some() {
        // How a plane is stored decides how many fit: here it is part of the fit.
        for name in ["format", "precision", "block", "mips"] {
            fit.insert(format!("budget_{name}"), storing[name].clone());
        }
    }
    if arguments.searches()? {
        // What was given is not searched for, even where it is what would be taken without a target.
        fit.insert("search_basis".to_owned(), arguments.fit.asked_basis().unwrap_or("any").to_owned());
        fit.insert("search_storage".to_owned(), (!arguments.textures.asks_for_storage()).to_string());
    }
    let near = arguments.near.is_given();
    if near {
        fit.extend(owned(arguments.near.named()));
    }
    if with_positions {
        storing.insert("positions_precision".to_owned(), arguments.positions.precision_words(format));
    }
    if near || with_positions {
        let places = if near { &mut fit } else { &mut storing };
        places.extend(owned(arguments.positions.named_source()));
        for (index, path) in arguments.positions.sources().enumerate() {
            places.insert(format!("surface_{index}"), content(path)?);
        }
    }
    // Numbers without names are of all pictures.
    let intensities = arguments.photographs.intensities(all)?;
    let records_of = |indices: &[usize]| {
        let factors = intensities.as_ref().map(|of_all| indices.iter().map(|&i| of_all[i]).collect());
        records(arguments, &all.select(indices), factors)
    };
    let pictures = records_of(&division.kept)?;
    let judging = match division.judges_of(all) {
        Some(judges) => records(arguments, &judges.by_direction()?, None)?,
        None => Vec::new(),
    };
    let of_files = arguments.photographs.files().map(|path| content(path)).collect::<Result<Vec<_>, _>>()?;
    let judges_key = record_key(&(&judging, of_files));
    let judges = match arguments.photographs.look_at_judges() {
        // As the capture has them, whatever they are when they judge.
        true => {
            let others: Vec<usize> = (0..all.infos.len()).filter(|i| !division.kept.contains(i)).collect();
            records_of(&others)?
        }
        false => Vec::new(),
    };
    let provenance = Provenance { abi: ABI, fit, storing, pictures, judges };
    Ok((provenance, judges_key))
}

fn content(path: &Path) -> Result<String, Failure> {
    Ok(hexadecimal(&content_hash(path)?[..CONTENT_BYTES]))
}

/// The pictures of `capture`, in its order.
fn records(
    arguments: &BakeArguments,
    capture: &OpenCapture,
    intensities: Option<Vec<[f64; 3]>>,
) -> Result<Vec<PictureRecord>, Failure> {
    let lamps = arguments.near.positions(capture)?;
    let contents: Vec<String> =
        capture.capture.pictures.par_iter().map(|path| content(path)).collect::<Result<_, _>>()?;
    let lights = capture.capture.lights.lights.iter();
    let record = |(i, (content, light)): (usize, (String, &relight_core::Light))| PictureRecord {
        content,
        light: light.direction.components(),
        intensity: intensities.as_ref().map(|factors| factors[i]),
        lamp: lamps.as_ref().map(|positions| positions[i]),
    };
    Ok(contents.into_iter().zip(lights).enumerate().map(record).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Args, Command};

    /// Options that decide nothing of an asset's bytes.
    const NO_PART: [&str; 12] = [
        "input",
        "output",
        "report",
        "heatmaps",
        "cache",
        "cache_size",
        "depfile",
        "depfile_format",
        "dry_run",
        "memory",
        "jobs",
        "cpu",
    ];

    /// Options whose values are in a key by another name: counts of functions, contents of files.
    const BY_OTHER_NAMES: [&str; 9] =
        ["order", "degree", "intensities", "near", "positions", "depth", "camera", "scene", "holdout"];

    #[test]
    fn every_option_is_in_the_key_or_known_not_to_matter() {
        let words = |words: &str| {
            let words = words.split(' ').map(std::ffi::OsString::from);
            crate::job::bake_arguments(words).unwrap()
        };
        let folder = tempfile::tempdir().unwrap();
        let light = std::env::current_dir().unwrap().join("../testdata/icon72");
        let line = format!("{} -o {}/a.ktx2 --basis srbf", light.display(), folder.path().display());
        let arguments = words(&line);
        let job = super::super::Job::open(&arguments, &mut super::super::Stages::default()).unwrap();
        let named: Vec<&String> = job.provenance.fit.keys().chain(job.provenance.storing.keys()).collect();
        let of_surfaces = arguments.near.named().into_iter().chain(arguments.positions.named_source());
        let near: Vec<&str> = of_surfaces.map(|(name, _)| name).collect();
        for arg in BakeArguments::augment_args(Command::new("bake")).get_arguments() {
            let id = arg.get_id().as_str();
            let counts =
                named.iter().any(|name| *name == id) || near.contains(&id) || BY_OTHER_NAMES.contains(&id);
            let positions_only = id == "positions_precision";
            assert!(
                counts || positions_only || NO_PART.contains(&id),
                "--{id} is neither in the key nor among NO_PART"
            );
        }
    }
}
