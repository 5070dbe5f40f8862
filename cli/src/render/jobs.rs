//! Which pictures a command asks for, and the scene of each.

use super::{Depth, RenderArguments};
use crate::failure::Failure;
use crate::notes;
use crate::options::{Machine, check_sequence_folder};
use relight_core::relighter::DirectionalLight;
use relight_formats::{read_light_file, read_scene};
use relight_lights::{Attenuation, HorizonRule, Lamp, Light, Scene};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// A picture to draw.
pub(super) struct Job {
    pub(super) path: PathBuf,
    pub(super) scene: Scene,
}

/// All pictures of a command.
pub(super) struct Jobs {
    /// At least one.
    pub(super) list: Vec<Job>,
    /// Where they go, if it is not one picture.
    pub(super) folder: Option<PathBuf>,
    /// Files that were read for them.
    pub(super) inputs: Vec<PathBuf>,
}

pub(super) fn jobs(arguments: &RenderArguments, machine: &Machine) -> Result<Jobs, Failure> {
    let output = &arguments.output;
    if let Some(file) = &arguments.lights {
        let list = jobs_of_file(file, output, arguments.depth)?;
        return Ok(Jobs { list, folder: Some(output.clone()), inputs: vec![file.clone()] });
    }
    if let Some(path) = &arguments.scene {
        let file = read_scene(path, machine.level, machine.memory)?;
        let inputs = file.inputs.iter().cloned().chain([path.clone()]).collect();
        if file.times.is_empty() {
            let list = vec![Job { path: output.clone(), scene: file.scene(path, 0.0)? }];
            return Ok(Jobs { list, folder: None, inputs });
        }
        check_sequence_folder(output)?;
        let list = frame_paths(output, file.times.len(), extension_for(arguments.depth))
            .zip(&file.times)
            .map(|(frame, &time)| Ok(Job { path: frame, scene: file.scene(path, time)? }))
            .collect::<Result<_, Failure>>()?;
        return Ok(Jobs { list, folder: Some(output.clone()), inputs });
    }
    let lights: Vec<_> = arguments.light.iter().chain(&arguments.angles).copied().collect();
    if lights.is_empty() {
        let message = "no light; give --light X,Y,Z, --angles AZ,EL, --lights FILE.lp or --scene SCENE.toml";
        return Err(Failure::usage(message));
    }
    Ok(Jobs {
        list: vec![Job { path: output.clone(), scene: scene_of(&lights) }],
        folder: None,
        inputs: Vec::new(),
    })
}

/// Numbered pictures of a sequence in a folder, from 1, in names that sort.
pub(crate) fn frame_paths(folder: &Path, frames: usize, extension: &str) -> impl Iterator<Item = PathBuf> {
    let digits = frames.to_string().len().max(4);
    (1..=frames).map(move |frame| folder.join(format!("frame_{frame:0digits$}.{extension}")))
}

/// Directional lights as the command line has them: the asset as it is, below its horizon, too.
fn scene_of(lights: &[DirectionalLight]) -> Scene {
    let light = |(index, light): (usize, &DirectionalLight)| Light {
        name: format!("light {}", index + 1),
        lamp: Lamp::Directional { direction: light.direction },
        color: light.color,
        intensity: 1.0,
        attenuation: Attenuation::None,
    };
    Scene { lights: lights.iter().enumerate().map(light).collect(), horizon: HorizonRule::Extrapolate }
}

/// What numbered pictures of `depth` are.
fn extension_for(depth: Option<Depth>) -> &'static str {
    match depth {
        Some(Depth::Half | Depth::Float) => "exr",
        _ => "png",
    }
}

/// One picture for each line of a light file, named as the line names it.
fn jobs_of_file(file: &Path, folder: &Path, depth: Option<Depth>) -> Result<Vec<Job>, Failure> {
    let file = read_light_file(file)?;
    notes::print(&file.notes);
    let extension = extension_for(depth);
    let mut taken = HashSet::new();
    let jobs = file.entries.iter().map(|entry| {
        let base = entry.name.rsplit(['/', '\\']).next().unwrap_or("light");
        let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
        let stem = if stem.trim_matches('.').is_empty() { "light" } else { stem };
        let mut name = format!("{stem}.{extension}");
        let mut again = 0;
        while !taken.insert(name.to_lowercase()) {
            again += 1;
            let suffix = if again == 1 { String::new() } else { format!("_{again}") };
            name = format!("{stem}_line{}{suffix}.{extension}", entry.line);
        }
        let light = DirectionalLight { direction: entry.direction, color: [1.0; 3] };
        Job { path: folder.join(name), scene: scene_of(&[light]) }
    });
    Ok(jobs.collect())
}
