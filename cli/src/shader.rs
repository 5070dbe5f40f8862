//! `relight shader`: the source of an include that lights an asset in an engine's own shaders.

use crate::failure::Failure;
use crate::options::check_apart;
use crate::say::say;
use clap::Args;
use relight_core::Basis;
use relight_formats::{summarize_asset, write_function_table, write_whole};
use relight_shader::{Language, ShaderOptions, shader};
use std::path::PathBuf;

/// What to write.
#[derive(Args, Debug)]
#[group(id = "shader")]
pub(crate) struct ShaderArguments {
    /// The asset: .ktx2 or .dds, or the .json beside textures
    asset: PathBuf,
    /// Shading language: wgsl, glsl or hlsl
    #[arg(long, value_name = "LANGUAGE", default_value = "wgsl", value_parser = language_of)]
    lang: Language,
    /// The file to write; standard output by default
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write the table of an asset's learned functions, as a .ktx2 or .dds array texture
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Add functions that sum so many maps a pass, for engines that bind few textures at once
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    maps_per_pass: Option<u16>,
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
    let text = shader(&header.model, &header.packing, header.width, header.height, &options);
    match &arguments.output {
        Some(path) => Ok(write_whole(path, text.as_bytes())?),
        None => {
            say!("{}", text.trim_end());
            Ok(())
        }
    }
}
