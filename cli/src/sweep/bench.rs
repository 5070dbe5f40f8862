//! Making and measuring choices that share the decoded pictures.

use super::Choice;
use super::axes::GridPoint;
use super::gpu_time::GpuClock;
use super::outcome::{Judged, Outcome, Times, outcome_of};
use super::render_time::render_times;
use crate::bake::{BakeFit, Coefficients, Made, Planned, Samples, Stages, bytes_beside, load, make};
use crate::evaluate::{self, PixelError};
use crate::failure::Failure;
use crate::options::Machine;
use relight_core::Space;
use relight_core::relighter::Picture;
use relight_formats::{OpenCapture, PictureStack, read_asset};
use relight_lights::Settings;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The pictures before they are decoded.
pub(crate) struct Opened<'a> {
    pub(crate) fitted: &'a OpenCapture,
    /// Those that judge, where some are left out.
    pub(crate) left_out: Option<&'a OpenCapture>,
    pub(crate) space: Space,
    pub(crate) machine: Machine,
    /// Where pictures go that exceed the memory.
    pub(crate) spill: &'a Path,
    /// Bytes of what else is held meanwhile.
    pub(crate) beside: u64,
}

/// The pictures as all choices share them.
pub(super) struct Decoded {
    pub(super) stack: PictureStack,
    /// Those that judge; nothing where they take more than a quarter of the memory and are decoded once a choice.
    judges: Option<Vec<Picture>>,
    seconds: f64,
}

impl Opened<'_> {
    pub(super) fn planned<'a>(&self, choice: &'a Choice, output: &Path) -> Result<Planned<'a>, Failure> {
        Planned::new(output, &choice.fit, &choice.textures, self.fitted, self.space, &self.machine, None)
    }

    /// Bytes of the judging pictures as f32.
    fn judge_bytes(&self) -> u64 {
        self.left_out.map_or(0, |capture| {
            let (width, height) = capture.size();
            (capture.infos.len() * width * height * 3 * 4) as u64
        })
    }

    pub(super) fn decode(
        &self,
        groups: &[Vec<&Planned<'_>>],
        stages: &mut Stages,
    ) -> Result<Decoded, Failure> {
        let Self { fitted, left_out, space, machine, spill, beside } = self;
        let groups = groups.iter().map(|group| bytes_beside(group, fitted, machine)).max().unwrap_or(0);
        let held = Some(self.judge_bytes()).filter(|&bytes| bytes <= machine.memory / 4);
        let beside = [groups, held.unwrap_or(0)].into_iter().fold(*beside, u64::saturating_add);
        let stack = stages.time("decode", || load(fitted, *space, machine, beside, spill))?;
        let seconds = stages.0.last().map_or(0.0, |(_, seconds)| *seconds);
        let judges = match (left_out, held) {
            (Some(capture), Some(_)) => {
                let photograph = |i| Ok(capture.photograph(i, machine.level, machine.memory)?);
                Some(stages.time("decode judges", || {
                    (0..capture.infos.len()).map(photograph).collect::<Result<_, Failure>>()
                })?)
            }
            _ => None,
        };
        Ok(Decoded { stack, judges, seconds })
    }
}

/// Makes and measures.
pub(crate) struct Bench<'a> {
    opened: &'a Opened<'a>,
    decoded: &'a Decoded,
    samples: Samples<'a>,
    /// Whether relighting is timed, and on which GPU.
    timed: Option<GpuClock>,
}

impl<'a> Bench<'a> {
    pub(super) fn new(opened: &'a Opened<'a>, decoded: &'a Decoded, timed: Option<GpuClock>) -> Self {
        Self { opened, decoded, samples: Samples::new(&decoded.stack), timed }
    }

    /// The fit that choices of a group share.
    pub(super) fn solve(
        &self,
        planned: &Planned<'_>,
        stages: &mut Stages,
    ) -> Result<BakeFit<'static>, Failure> {
        stages.time("solve", || planned.solve(self.opened.fitted, &self.samples, None))
    }

    /// Makes the assets of choices that share a fit, and measures them.
    pub(super) fn measure(
        &self,
        points: &[&GridPoint],
        planned: &mut [Planned<'_>],
        check: &dyn Fn(&[PathBuf]) -> Result<(), Failure>,
        stages: &mut Stages,
    ) -> Result<Vec<Outcome>, Failure> {
        let Some(first) = planned.first() else { return Ok(Vec::new()) };
        let mut own = Stages::default();
        let fit = self.solve(first, &mut own)?;
        let outcomes = self.measure_fit(&fit, points, planned, check, &mut own);
        stages.add(&own);
        outcomes
    }

    /// The same of a fit that is solved already.
    pub(super) fn measure_fit(
        &self,
        fit: &BakeFit<'_>,
        points: &[&GridPoint],
        planned: &mut [Planned<'_>],
        check: &dyn Fn(&[PathBuf]) -> Result<(), Failure>,
        stages: &mut Stages,
    ) -> Result<Vec<Outcome>, Failure> {
        let Opened { fitted, machine, .. } = self.opened;
        let mut assets: Vec<&mut Planned<'_>> = planned.iter_mut().collect();
        let mut coefficients = Coefficients { fit, stack: &self.decoded.stack, distributions: Vec::new() };
        let made = make(&mut assets, &mut coefficients, None, machine, stages, check)?;
        let shares = shares(&made, stages, machine);
        let mut outcomes = Vec::new();
        for (((point, planned), made), writing) in points.iter().zip(&*planned).zip(&made).zip(shares) {
            let mut times = Times {
                seconds: self.stages_alone(stages, writing),
                directional_ns: 0.0,
                point_ns: 0.0,
                gpu: None,
            };
            let judged = stages.time("measure", || -> Result<_, Failure> {
                let needs_maps = self.timed.is_some() || self.opened.left_out.is_some();
                let maps = match needs_maps {
                    true => Some(read_asset(&planned.output, machine.memory)?),
                    false => None,
                };
                if let (Some(maps), Some(gpu)) = (&maps, &self.timed) {
                    let settings = Settings { level: machine.level, step: 0.0, timed: false };
                    (times.directional_ns, times.point_ns) = render_times(maps, settings)?;
                    times.gpu = gpu.time(&planned.output, machine);
                }
                match (self.opened.left_out, &maps) {
                    (Some(capture), Some(maps)) => {
                        let photograph = |i: usize| match &self.decoded.judges {
                            Some(judges) => Ok(judges[i].clone()),
                            None => Ok(capture.photograph(i, machine.level, machine.memory)?),
                        };
                        let of_pixels = PixelError::None;
                        let evaluation =
                            evaluate::compare(maps, capture, None, machine, &photograph, of_pixels)?;
                        Ok(Judged::of_left_out(&evaluation))
                    }
                    _ => Ok(Judged::predicted(fit, made.packed.relit_rmse, fitted)),
                }
            })?;
            outcomes.push(outcome_of(
                point,
                fit,
                made,
                judged,
                planned.model.plane_count(),
                fitted.size(),
                times,
            ));
        }
        Ok(outcomes)
    }

    /// Seconds that a bake of one choice alone takes, by stage.
    fn stages_alone(&self, stages: &Stages, (fitting, writing): (f64, f64)) -> BTreeMap<String, f64> {
        let of =
            |name: &str| stages.0.iter().filter(|(stage, _)| *stage == name).map(|(_, s)| s).sum::<f64>();
        let all = [
            ("decode", self.decoded.seconds),
            ("solve", of("solve")),
            ("ranges", of("ranges")),
            ("formats", of("formats")),
            ("fit", fitting),
            ("write", writing),
        ];
        all.map(|(name, seconds)| (name.to_owned(), seconds)).into()
    }
}

/// Of the pass in which assets were fitted and written together, the seconds of fitting and of writing each.
fn shares(made: &[Made], stages: &Stages, machine: &Machine) -> Vec<(f64, f64)> {
    let pass =
        stages.0.iter().rev().find(|(name, _)| *name == "fit and write").map_or(0.0, |(_, seconds)| *seconds);
    let written: f64 = made.iter().map(|made| made.write_seconds).sum();
    // Of all threads together; those that wait for the last span count as fitting.
    let total = (pass * machine.threads as f64).max(written);
    let share = |seconds: f64| if total > 0.0 { pass * seconds / total } else { 0.0 };
    made.iter().map(|made| (share(total - written), share(made.write_seconds))).collect()
}
