//! The pictures of a scene, as rigs know them.

use crate::failure::{Exit, Failure};
use crate::notes;
use crate::options::Machine;
use relight_formats::{RigFile, SceneFile, read_scene};
use relight_rig::{Light, PlacedPart, Placement};
use std::path::{Path, PathBuf};

/// What one picture is lit by, and where the parts stand.
pub(super) struct Moment {
    pub(super) time: f64,
    pub(super) lights: Vec<Light>,
    /// By part of the rig.
    pub(super) placements: Vec<Placement>,
}

/// The pictures of a scene.
pub(super) struct Moments {
    /// One for a scene that stands still.
    pub(super) list: Vec<Moment>,
    /// Whether it is a sequence, of one picture even.
    pub(super) is_sequence: bool,
    /// Files that were read.
    pub(super) inputs: Vec<PathBuf>,
}

/// Reads a scene for a rig.
///
/// # Errors
/// [`Exit::BadInput`] where it moves a part that the rig has not.
pub(super) fn moments(path: &Path, rig: &RigFile, machine: &Machine) -> Result<Moments, Failure> {
    let file = read_scene(path, machine.level, machine.memory)?;
    let is_sequence = !file.times.is_empty();
    let times = if is_sequence { file.times.clone() } else { vec![0.0] };
    let list = times.into_iter().map(|time| moment(path, &file, rig, time));
    let list: Vec<Moment> = list.collect::<Result<_, Failure>>()?;
    if list.iter().all(|moment| moment.lights.is_empty()) {
        notes::print(&[format!("{}: there is no light, all is black", path.display())]);
    }
    Ok(Moments { list, is_sequence, inputs: file.inputs.into_iter().chain([path.to_owned()]).collect() })
}

/// A scene at a time, for a rig.
///
/// # Errors
/// [`Exit::BadInput`] where it moves a part that the rig has not.
pub(super) fn moment(path: &Path, file: &SceneFile, rig: &RigFile, time: f64) -> Result<Moment, Failure> {
    let parts = &rig.rig.parts;
    let scene = file.rig_scene(path, time)?;
    if let Some((name, _)) = scene.parts.iter().find(|(name, _)| parts.iter().all(|part| part.name != *name))
    {
        let known: Vec<_> = parts.iter().map(|part| format!("'{}'", part.name)).collect();
        let words = match &known[..] {
            [whole] if whole == "''" => "was baked as one; bake it again with --parts".to_owned(),
            _ => format!("has {}", known.join(", ")),
        };
        let words = format!("{}: it moves part '{name}', but the rig {words}", path.display());
        return Err(Failure::new(Exit::BadInput, words));
    }
    let of_part =
        |name: &str| scene.parts.iter().find(|part| part.0 == name).map_or(scene.object, |part| part.1);
    let placements = parts.iter().map(|part| of_part(&part.name)).collect();
    Ok(Moment { time, lights: scene.lights, placements })
}

impl Moments {
    /// What a plan is made for.
    pub(super) fn pictures<'a>(&'a self, rig: &'a RigFile) -> Vec<(&'a [Light], Vec<PlacedPart<'a>>)> {
        let placed = |moment: &Moment| {
            let parts = rig.rig.parts.iter().zip(&moment.placements);
            parts.map(|(part, &placement)| PlacedPart { part, placement }).collect()
        };
        self.list.iter().map(|moment| (&moment.lights[..], placed(moment))).collect()
    }
}
