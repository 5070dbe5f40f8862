//! `relight`: bakes pictures taken under known lights into textures that can be lit anew.
//!
//! One module a subcommand; options that several share are in `options`. Exit codes are those of
//! [`failure::Exit`].

mod bake;
mod budget;
mod calibrate;
mod convert;
mod evaluate;
mod failure;
mod function_options;
mod holdout;
mod info;
mod interrupt;
mod job;
mod light_options;
mod lights;
mod near;
mod normals;
mod notes;
mod options;
mod page;
mod photograph_options;
mod positions;
#[cfg(feature = "gpu")]
mod preview;
mod progress;
mod render;
mod rig;
mod say;
mod shader;
mod sweep;
#[cfg(feature = "gpu")]
mod verify;
mod view;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use failure::{Exit, Failure};
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "relight", version, about, after_help = failure::EXIT_CODES, args_override_self = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fit pictures under known lights and write a relightable asset
    Bake(Box<bake::BakeArguments>),
    /// Bake a grid of choices and say what accuracy costs in bytes and time
    Sweep(Box<sweep::SweepArguments>),
    /// Make an asset of another format, basis or precision of an asset, and say what that loses
    Convert(Box<convert::ConvertArguments>),
    /// Light an asset anew and write pictures
    Render(render::RenderArguments),
    /// Look into a relit panorama, or at a mesh with a relit texture
    View(view::ViewArguments),
    /// Light moving meshes to match: irradiance rigs
    Rig(Box<rig::RigArguments>),
    /// Compare an asset with photographs, light by light
    Evaluate(evaluate::EvaluateArguments),
    /// Examine a capture before baking it: coverage, duplicates, exposure, usable bases
    Lights(lights::LightsArguments),
    /// Find the directions of lights, and positions of near ones, from highlights on chrome spheres
    Calibrate(calibrate::CalibrateArguments),
    /// Find normals, albedo and height of a surface from pictures under known lights
    Normals(normals::NormalsArguments),
    /// Write a shader include that lights an asset, in WGSL, GLSL or HLSL
    Shader(shader::ShaderArguments),
    /// Draw an asset on the GPU and compare with the CPU's pictures
    #[cfg(feature = "gpu")]
    Verify(verify::VerifyArguments),
    /// Show an asset in a window; dragging moves the light
    #[cfg(feature = "gpu")]
    Preview(preview::PreviewArguments),
    /// Compute the position of every pixel from a depth map and its camera
    Positions(positions::PositionsArguments),
    /// Say what is in a file that relight reads or writes
    Info(info::InfoArguments),
}

fn main() -> ExitCode {
    let arguments = match job::expand(std::env::args_os().collect()) {
        Ok(arguments) => arguments,
        Err(failure) => return failure.report(),
    };
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(words) if words.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => words.exit(),
        Err(error) if error.use_stderr() => return Failure::of_command_line(&error).report(),
        Err(words) => words.exit(),
    };
    interrupt::watch();
    let result = std::panic::catch_unwind(|| match arguments.command {
        Command::Bake(arguments) => bake::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Rig(arguments) => rig::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Lights(arguments) => lights::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Normals(arguments) => normals::run(&arguments),
        Command::Shader(arguments) => shader::run(&arguments),
        #[cfg(feature = "gpu")]
        Command::Verify(arguments) => verify::run(&arguments),
        #[cfg(feature = "gpu")]
        Command::Preview(arguments) => preview::run(&arguments),
        Command::Positions(arguments) => positions::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
    });
    match result.map(|result| result.and_then(|()| say::finish())) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(failure)) => failure.report(),
        Err(_) => Failure::new(Exit::Bug, "a bug of ours; please report the lines above").report(),
    }
}
