//! `relight`: bakes pictures taken under known lights into textures that can be lit anew.
//!
//! One module a subcommand; options that several share are in `options`. Exit codes are those of
//! [`failure::Exit`].

mod bake;
mod budget;
mod calibrate;
mod completions;
mod convert;
mod depfile;
mod evaluate;
mod explain;
mod failure;
mod function_options;
mod holdout;
mod info;
mod interrupt;
mod job;
mod key;
mod light_options;
mod lights;
mod log;
mod merge;
mod near;
mod normals;
mod notes;
mod options;
mod page;
mod photograph_options;
mod plan;
mod positions;
#[cfg(feature = "gpu")]
mod preview;
mod progress;
mod render;
mod response_file;
mod rig;
mod say;
mod several_jobs;
mod shader;
mod shard;
mod standard_streams;
mod sweep;
mod thread_tokens;
#[cfg(feature = "gpu")]
mod verify;
mod view;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use failure::{Exit, Failure};
use job::Call;
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
    #[command(after_help = BAKE_PLAN)]
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
    /// Print the key of what a bake will make: a hash of contents and choices
    Key(Box<key::KeyArguments>),
    /// List the files that a bake reads
    Inputs(Box<key::InputsArguments>),
    /// Say by what two assets, reports, jobs or keys differ
    Explain(explain::ExplainArguments),
    /// Spread a bake over processes: what each will do and take
    Plan(Box<plan::PlanArguments>),
    /// Fit one shard of a plan; also relight bake --plan
    Shard(shard::ShardArguments),
    /// Make the asset of a plan from what its shards fitted
    Merge(merge::MergeArguments),
    /// Say what is in a file that relight reads or writes
    Info(info::InfoArguments),
    /// Write a script that completes command lines, for a shell
    Completions(completions::CompletionsArguments),
    /// Write manual pages
    Man(completions::ManArguments),
}

/// What the options of `bake` are not.
const BAKE_PLAN: &str = "\
One shard of a bake that is spread over processes:
  relight bake --plan FILE.json --shard K/N|auto -o PARTS   (relight plan, shard and merge --help)";

/// What the command line may say.
fn parser() -> clap::Command {
    Arguments::command().arg(log::argument())
}

fn main() -> ExitCode {
    // Before any file is opened.
    thread_tokens::connect();
    let mut arguments = std::env::args_os().collect();
    // Response files may fail, and hold the option.
    log::take_format(&mut arguments);
    let mut arguments = match response_file::expand(arguments) {
        Ok(arguments) => arguments,
        Err(failure) => return failure.report(),
    };
    log::take_format(&mut arguments);
    let mut calls = match job::expand(arguments) {
        Ok(calls) => calls,
        Err(failure) => return failure.report(),
    };
    interrupt::watch();
    // Building it takes as long as to check a small job.
    let mut parser = parser();
    let mut run = |call| run(&mut parser, call);
    let ended = match calls.len() {
        1 => run(calls.remove(0)).and_then(|()| say::finish()).map_err(|failure| failure.report()),
        _ => several_jobs::run(calls, run).map_err(|exit| ExitCode::from(exit as u8)),
    };
    thread_tokens::release();
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(code) => code,
    }
}

/// Runs the command that a call stands for.
fn run(parser: &mut clap::Command, call: Call) -> Result<(), Failure> {
    let parsed = parser.try_get_matches_from_mut(call.arguments?).and_then(|matches| {
        let command = Arguments::from_arg_matches(&matches)?.command;
        Ok((command, matches))
    });
    let (mut command, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(words)
            if words.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand && !log::is_json() =>
        {
            words.exit()
        }
        Err(error) if error.use_stderr() => return Err(Failure::of_command_line(&error)),
        Err(words) => words.exit(),
    };
    standard_streams::check(parser, &matches)?;
    match (&mut command, call.job_file) {
        (Command::Bake(arguments), Some(file)) => arguments.set_job_file(file),
        (Command::Inputs(arguments), Some(file)) => arguments.set_job_file(file),
        _ => {}
    }
    let result = std::panic::catch_unwind(|| match command {
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
        Command::Key(arguments) => key::run_key(&arguments),
        Command::Inputs(arguments) => key::run_inputs(&arguments),
        Command::Explain(arguments) => explain::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Shard(arguments) => shard::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Completions(arguments) => completions::run_completions(&arguments, self::parser()),
        Command::Man(arguments) => completions::run_man(&arguments, self::parser()),
    });
    result.unwrap_or_else(|_| Err(Failure::new(Exit::Bug, "a bug of ours; please report the lines above")))
}
