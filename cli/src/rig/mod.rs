//! `relight rig`: moving meshes lit to match by a few vectors of spherical harmonics.

mod bake;
mod curves;
mod export;
mod mesh;
mod plan;
mod render;
mod report;
mod scene;
mod window;

use crate::failure::{Exit, Failure};
use clap::{Args, Subcommand};
use relight_rig::RigError;

/// Irradiance rigs.
#[derive(Args, Debug)]
pub(crate) struct RigArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Fit a rig to a mesh
    Bake(bake::BakeArguments),
    /// Say for each light of a scene whether it goes through the rig, is evaluated at every point, or is left out
    Plan(plan::PlanArguments),
    /// Draw a mesh under a scene: by brute force, by its rig or by the plan
    Render(render::RenderArguments),
    /// Draw errors against distance, a curve a model, and what each model costs
    Report(report::ReportArguments),
    /// Write what a scene gives a rig as an engine keeps it
    Export(export::ExportArguments),
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &RigArguments) -> Result<(), Failure> {
    match &arguments.command {
        Command::Bake(arguments) => bake::run(arguments),
        Command::Plan(arguments) => plan::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Export(arguments) => export::run(arguments),
    }
}

impl From<RigError> for Failure {
    fn from(error: RigError) -> Self {
        let exit = match error {
            RigError::NoSurface => Exit::BadInput,
            _ => Exit::Usage,
        };
        Self::new(exit, error.to_string())
    }
}

/// A number with so many digits that matter, for tables of people.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e6).contains(&size) => {
            let whole = libm::floor(libm::log10(size)) as i32 + 1;
            format!("{value:.*}", (3 - whole).max(0) as usize)
        }
        _ => format!("{value:.2e}"),
    }
}
