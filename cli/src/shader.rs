//! `relight shader`: the source of an include that lights an asset, or a mesh by its rig, in an engine's own shaders.

use crate::failure::Failure;
use crate::options::check_apart;
use crate::say;
use clap::{Args, ValueEnum};
use relight_core::Basis;
use relight_formats::{is_rig, machine_memory, read_rig, summarize_asset, write_function_table, write_whole};
use relight_rig::{Rig, RigPart};
use relight_shader::{Language, RigShaderOptions, ShaderOptions, rig_shader, shader};
use std::path::{Path, PathBuf};

/// What to write.
#[derive(Args, Debug)]
#[group(id = "shader")]
pub(crate) struct ShaderArguments {
    /// The asset: .ktx2 or .dds, or the .json beside textures. Or a .rig
    asset: PathBuf,
    /// Shading language: wgsl, glsl or hlsl
    #[arg(long, value_name = "LANGUAGE", default_value = "wgsl", value_parser = language_of)]
    lang: Language,
    /// The file to write; standard output by default, or -
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write the table of an asset's learned functions, as a .ktx2 or .dds array texture
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Add functions that sum so many maps a pass, for engines that bind few textures at once
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    maps_per_pass: Option<u16>,
    /// Which part of a rig of several
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Of a rig: add the exact function of lights that don't go through it
    #[arg(long, value_name = "KIND", value_enum)]
    lights: Option<LightKind>,
}

/// Lights that a function of their own can evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LightKind {
    Sphere,
}

fn language_of(text: &str) -> Result<Language, String> {
    Language::by_name(text).ok_or_else(|| {
        let names: Vec<_> = Language::all().map(Language::name).collect();
        format!("'{text}' is not one of {}", names.join(", "))
    })
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &ShaderArguments) -> Result<(), Failure> {
    check_apart(arguments.output.iter().chain(&arguments.table), [&arguments.asset])?;
    let of_rig = is_rig(&arguments.asset);
    let text = if of_rig { text_of_rig(arguments)? } else { text_of_asset(arguments)? };
    match &arguments.output {
        Some(path) if !say::is_dash(path) => Ok(write_whole(path, text.as_bytes())?),
        _ => {
            say::product(format!("{}\n", text.trim_end()).as_bytes());
            Ok(())
        }
    }
}

/// Fails where an option was given that what was given does not have.
fn refuse(arguments: &ShaderArguments, is: &str, options: &[(&str, bool)]) -> Result<(), Failure> {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => {
            Err(Failure::usage(format!("{} is {is}, which has no {option}", arguments.asset.display())))
        }
        None => Ok(()),
    }
}

fn text_of_asset(arguments: &ShaderArguments) -> Result<String, Failure> {
    let given = [("--part", arguments.part.is_some()), ("--lights", arguments.lights.is_some())];
    refuse(arguments, "no rig", &given)?;
    let header = summarize_asset(&arguments.asset)?.header;
    if let Some(path) = &arguments.table {
        let Basis::Learned(learned) = &header.model.basis else {
            let family = header.model.basis.family().name;
            return Err(Failure::usage(format!("--table is for learned functions; {family} has formulas")));
        };
        write_function_table(path, learned).map_err(Failure::of_output)?;
    }
    let options =
        ShaderOptions { language: arguments.lang, maps_per_pass: arguments.maps_per_pass.map(usize::from) };
    Ok(shader(&header.model, &header.packing, header.width, header.height, &options))
}

fn text_of_rig(arguments: &ShaderArguments) -> Result<String, Failure> {
    let given =
        [("--table", arguments.table.is_some()), ("--maps-per-pass", arguments.maps_per_pass.is_some())];
    refuse(arguments, "a rig", &given)?;
    let rig = read_rig(&arguments.asset, machine_memory() / 2)?.rig;
    let part = part_of(&rig, arguments.part.as_deref(), &arguments.asset)?;
    let options = RigShaderOptions {
        language: arguments.lang,
        sphere_lights: arguments.lights == Some(LightKind::Sphere),
    };
    Ok(rig_shader(&part.model, &part.frame, rig.bands, &options))
}

/// The part of that name, or the only one.
pub(crate) fn part_of<'a>(rig: &'a Rig, name: Option<&str>, path: &Path) -> Result<&'a RigPart, Failure> {
    let found = match (name, &rig.parts[..]) {
        (None, [only]) => Some(only),
        (None, _) => None,
        (Some(name), parts) => parts.iter().find(|part| part.name == name),
    };
    found.ok_or_else(|| {
        let names: Vec<_> = rig.parts.iter().map(|part| format!("'{}'", part.name)).collect();
        Failure::usage(format!("--part names one of those of {}: {}", path.display(), names.join(", ")))
    })
}
