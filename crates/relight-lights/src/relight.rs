//! Pictures of an asset under a scene, by tiles.

use crate::bound::{Box3, largest_samples, negligible};
use crate::lamps::{RowLight, RowPositions};
use crate::path::Evaluator;
use crate::plan::Plan;
use crate::rows::{AddChannel, Channel, Gather, Interleave};
use crate::scene::{Lamp, Light, Scene};
use crate::strip::{STRIP, Strip, rows_at_once};
use crate::uniform::{coefficients, weighted_planes};
use rayon::prelude::*;
use relight_core::relighter::Picture;
use relight_core::{CpuLevel, PlaneRole, PositionMap, RelightingMap, RelightingMaps, Space};
use std::time::Instant;

/// Pixels of a tile from left to right: a row's vectors of k functions stay in the L1 cache.
const TILE_WIDTH: usize = 256;

/// Pixels that passes without positions take at a time where there are no others: sums and codes stay in
/// the L1 cache.
const RUN: usize = 8192;

/// Rows of a tile.
const TILE_HEIGHT: usize = 32;

/// How a scene is evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Instruction set.
    pub level: CpuLevel,
    /// The smallest step of linear light that the picture's file can show, near black; lights that add less
    /// than half of it to a tile, all together, are skipped there. 0 skips only what adds nothing.
    pub step: f64,
    /// Whether what every light costs is timed.
    pub timed: bool,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Pixels whose position was read.
    pub positions_read: usize,
    /// Tiles of the picture.
    pub tiles: usize,
    /// By local light of the plan, in order of its groups.
    pub local: Vec<LightReport>,
    /// Seconds of all threads together for the passes without positions.
    pub uniform_seconds: f64,
    /// Pixels at which a lamp stands right at the surface, by light, summed.
    pub at_surface: usize,
    /// Samples of the sum that came out negative, which bases do where they ring; the file clamps them.
    pub negative: usize,
}

/// What a local light cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightReport {
    /// Index in [`Scene::lights`].
    pub light: usize,
    /// Tiles in which it was evaluated.
    pub evaluated: usize,
    /// Tiles that its bound excluded.
    pub skipped: usize,
    /// Seconds of all threads together.
    pub seconds: f64,
}

/// The picture of `maps` under `scene` in linear light, not clipped; negative sums are kept.
///
/// `recycled` gives its memory to the picture: the samples of the one before in a sequence, or an empty vector.
///
/// # Panics
/// When the plan reads positions and there are none, or of another size.
pub fn relight_scene(
    maps: &RelightingMaps,
    positions: Option<&PositionMap>,
    scene: &Scene,
    plan: &Plan,
    settings: &Settings,
    recycled: Vec<f32>,
) -> (Picture, Report) {
    let positions = positions.filter(|_| plan.reads_positions());
    assert!(!plan.reads_positions() || positions.is_some(), "local lights need positions");
    assert!(
        positions.is_none_or(|map| (map.width, map.height) == (maps.width, maps.height)),
        "positions have the asset's size"
    );
    let worker = Worker::new(maps, positions, scene, plan, *settings);
    let (width, channels) = (maps.width, plan.channels);
    // Every sample is written: those of the picture before may stay, and new memory comes zeroed.
    let mut samples = recycled;
    if samples.len() != maps.pixels() * channels {
        samples = vec![0.0; maps.pixels() * channels];
    }
    let reports: Vec<Report> = samples
        .par_chunks_mut(TILE_HEIGHT * width * channels)
        .enumerate()
        .map_init(|| worker.workspace(), |space, (band, out)| worker.band(band * TILE_HEIGHT, space, out))
        .collect();
    let mut report = Report {
        local: plan
            .local
            .iter()
            .flatten()
            .map(|&light| LightReport { light, ..LightReport::default() })
            .collect(),
        ..Report::default()
    };
    for of_band in reports {
        report.add(&of_band);
    }
    (Picture { width, height: maps.height, channels, samples }, report)
}

impl Report {
    fn add(&mut self, other: &Self) {
        self.positions_read += other.positions_read;
        self.tiles += other.tiles;
        self.uniform_seconds += other.uniform_seconds;
        self.at_surface += other.at_surface;
        self.negative += other.negative;
        for (light, other) in self.local.iter_mut().zip(&other.local) {
            light.evaluated += other.evaluated;
            light.skipped += other.skipped;
            light.seconds += other.seconds;
        }
    }
}

struct Worker<'a> {
    maps: &'a RelightingMaps,
    positions: Option<&'a PositionMap>,
    scene: &'a Scene,
    plan: &'a Plan,
    settings: Settings,
    evaluator: Option<Evaluator>,
    /// Those of [`PlaneRole::Coefficient`].
    coefficients: Vec<&'a RelightingMap>,
    /// Of the asset: one or three.
    channels: Vec<Channel<'a>>,
    /// Whether the same weights make the same sum of all of them.
    alike: bool,
    /// The most that a sample can be; 1 where that decides nothing.
    largest: [f64; 3],
}

/// Working space of a thread.
struct Workspace<'a> {
    positions: RowPositions,
    light: RowLight,
    /// k rows.
    functions: Vec<f32>,
    /// k rows, summed over the lights of a group.
    weights: Vec<f32>,
    products: Workplace<'a>,
}

/// Where functions meet coefficients.
struct Workplace<'a> {
    strip: Strip<'a>,
    sum: Vec<f32>,
    /// Base colour.
    factor: Vec<f32>,
    /// The picture's, by channel.
    sums: Vec<f32>,
}

impl<'a> Worker<'a> {
    fn new(
        maps: &'a RelightingMaps,
        positions: Option<&'a PositionMap>,
        scene: &'a Scene,
        plan: &'a Plan,
        settings: Settings,
    ) -> Self {
        let mut channels: Vec<Channel<'_>> = (0..maps.model.channels())
            .zip(maps.model.mean_functions())
            .map(|(_, mean)| Channel {
                planes: Vec::new(),
                indices: Vec::new(),
                factor: None,
                mean: mean.map(usize::from),
            })
            .collect();
        let mut coefficients = Vec::new();
        for (plane, role) in maps.planes.iter().zip(maps.model.roles()) {
            match role {
                PlaneRole::Coefficient { functions } => {
                    for (channel, function) in channels.iter_mut().zip(functions) {
                        if let Some(function) = function {
                            channel.planes.push((plane, usize::from(function)));
                            channel.indices.push(coefficients.len());
                        }
                    }
                    coefficients.push(plane);
                }
                PlaneRole::BaseColor { channel } => channels[usize::from(channel)].factor = Some(plane),
            }
        }
        // Without a step only a light that can't reach is left out, whatever the asset holds.
        let largest =
            if settings.step > 0.0 && !plan.local.is_empty() { largest_samples(maps) } else { [1.0; 3] };
        Self {
            maps,
            positions,
            scene,
            plan,
            settings,
            evaluator: plan.evaluator(&maps.model),
            coefficients,
            alike: channels.iter().all(|channel| channel.sums_like(&channels[0])),
            channels,
            largest,
        }
    }

    /// Space for the bands of a thread, one after another.
    fn workspace(&self) -> Workspace<'_> {
        // Without local lights only the sums are used.
        let (count, width) = match self.positions {
            Some(_) => (self.maps.model.basis.count(), TILE_WIDTH),
            None => (0, 0),
        };
        let terms = self.channels.iter().map(|channel| channel.planes.len());
        let terms = if self.alike { terms.max() } else { Some(terms.sum()) };
        let planes = if self.positions.is_some() { &self.coefficients[..] } else { &[] };
        Workspace {
            positions: RowPositions::default(),
            light: RowLight::default(),
            functions: vec![0.0; count * width],
            weights: vec![0.0; count * width],
            products: Workplace {
                strip: Strip::new(planes, terms.unwrap_or(0)),
                sum: vec![0.0; width],
                factor: vec![0.0; width],
                sums: vec![0.0; self.plan.channels * RUN],
            },
        }
    }

    /// Rows `first_row ..` of the picture, as many as `out` has.
    fn band(&self, first_row: usize, space: &mut Workspace<'_>, out: &mut [f32]) -> Report {
        let width = self.maps.width;
        let rows = out.len() / (width * self.plan.channels);
        let mut report = Report {
            tiles: width.div_ceil(TILE_WIDTH),
            local: vec![LightReport::default(); self.plan.local.iter().map(Vec::len).sum()],
            ..Report::default()
        };
        let Some(positions) = self.positions else {
            let start = self.clock();
            for (run, out) in out.chunks_mut(RUN * self.plan.channels).enumerate() {
                let sums = &mut space.products.sums[..out.len()];
                sums.fill(0.0);
                self.uniform(first_row * width + run * RUN, sums);
                report.negative +=
                    self.settings.level.run(Interleave { sums, out, channels: self.plan.channels });
            }
            report.uniform_seconds = seconds(start);
            return report;
        };
        let tiles: Vec<Tile> = (0..width)
            .step_by(TILE_WIDTH)
            .map(|column| {
                let pixels = TILE_WIDTH.min(width - column);
                let skipped = self.out_of_reach(positions, (first_row, rows), (column, pixels), &mut report);
                Tile { column, pixels, lit: skipped.iter().any(|skipped| !skipped), skipped }
            })
            .collect();
        let at_once = rows_at_once(width);
        for (run, out) in out.chunks_mut(at_once * width * self.plan.channels).enumerate() {
            let first = (first_row + run * at_once) * width;
            let rows = out.len() / (width * self.plan.channels);
            // Several rows are no more than one strip.
            let strips = out.chunks_mut(STRIP * self.plan.channels).zip(tiles.chunks(STRIP / TILE_WIDTH));
            for (out, tiles) in strips {
                self.strip(positions, (first, rows), tiles, space, out, &mut report);
            }
        }
        report
    }

    fn clock(&self) -> Option<Instant> {
        self.settings.timed.then(Instant::now)
    }

    /// Adds the passes without positions, for the pixels from `first` on, to sums by channel.
    fn uniform(&self, first: usize, sums: &mut [f32]) {
        if self.plan.uniform.is_empty() {
            return;
        }
        let pixels = sums.len() / self.plan.channels;
        let (mut sum, mut factor) = (vec![0.0; pixels], vec![0.0; pixels]);
        for pass in &self.plan.uniform {
            let mut summed: Option<(&Channel<'_>, &[f32])> = None;
            for (c, total) in sums.chunks_exact_mut(pixels).enumerate() {
                let channel = &self.channels[c.min(self.channels.len() - 1)];
                let weights = &pass.weights[c][..];
                // Luminance under white light is the same in all channels.
                if !summed.is_some_and(|(other, of_other)| of_other == weights && other.sums_like(channel)) {
                    let planes: Vec<_> =
                        channel.planes.iter().map(|&(plane, f)| (plane, weights[f])).collect();
                    let mean = channel.mean.map_or(0.0, |f| weights[f]);
                    weighted_planes(self.settings.level, &planes, mean, first, &mut sum);
                    summed = Some((channel, weights));
                }
                let factor = channel.factor.map(|plane| {
                    coefficients(self.settings.level, plane, first, &mut factor);
                    &factor[..]
                });
                self.settings.level.run(AddChannel {
                    sum: &sum,
                    factor,
                    decode: self.maps.model.space == Space::Encoded,
                    strength: None,
                    color: pass.color[c],
                    total,
                });
            }
        }
    }

    /// Which of the local lights, in order of the plan's groups, need not be evaluated in the tile of these
    /// (first, number of) rows and columns.
    fn out_of_reach(
        &self,
        map: &PositionMap,
        (first_row, rows): (usize, usize),
        (column, pixels): (usize, usize),
        report: &mut Report,
    ) -> Vec<bool> {
        let mut bounds = Box3::new();
        bounds.add(self.settings.level, map, first_row * self.maps.width + column, (rows, pixels));
        report.positions_read += rows * pixels;
        let most: Vec<f64> = self
            .plan
            .local
            .iter()
            .flatten()
            .map(|&light| {
                let light = &self.scene.lights[light];
                let color = (0..3).map(|c| self.largest[c] * f64::from(light.color[c])).fold(0.0, f64::max);
                color * bounds.strength(light)
            })
            .collect();
        let skipped = negligible(&most, 0.5 * self.settings.step);
        for (report, skipped) in report.local.iter_mut().zip(&skipped) {
            *if *skipped { &mut report.skipped } else { &mut report.evaluated } += 1;
        }
        skipped
    }

    /// Draws tiles that lie side by side in some rows of pixels, of which the first begins at `first`.
    fn strip(
        &self,
        map: &PositionMap,
        (first, rows): (usize, usize),
        tiles: &[Tile],
        space: &mut Workspace<'_>,
        out: &mut [f32],
        report: &mut Report,
    ) {
        let (level, channels) = (self.settings.level, self.plan.channels);
        let (first, pixels) = (first + tiles[0].column, out.len() / channels);
        let columns = pixels / rows;
        let clock = self.clock();
        let sums = &mut space.products.sums[..out.len()];
        sums.fill(0.0);
        self.uniform(first, sums);
        report.uniform_seconds += seconds(clock);
        if tiles.iter().any(|tile| tile.lit) {
            // All of the strip, which the processor sees coming; tiles apart it would not.
            space.products.strip.load(level, first, pixels);
        }
        for row in 0..rows {
            for tile in tiles.iter().filter(|tile| tile.lit) {
                let offset = row * columns + tile.column - tiles[0].column;
                space.positions.load(level, map, first + offset, tile.pixels);
                let place = Place { first, offset, pixels: tile.pixels, stride: pixels };
                let mut number = 0;
                for group in &self.plan.local {
                    let numbers = number..number + group.len();
                    let skipped = &tile.skipped[numbers.clone()];
                    let reports = &mut report.local[numbers.clone()];
                    self.group(group, skipped, place, space, reports, &mut report.at_surface);
                    number = numbers.end;
                }
            }
        }
        report.negative += level.run(Interleave { sums: &space.products.sums[..out.len()], out, channels });
    }

    /// Adds the lights of one colour to a row of a tile.
    fn group(
        &self,
        group: &[usize],
        skipped: &[bool],
        place: Place,
        space: &mut Workspace<'_>,
        reports: &mut [LightReport],
        at_surface: &mut usize,
    ) {
        let Some(evaluator) = &self.evaluator else { return };
        let (count, pixels) = (evaluator.count(), place.pixels);
        let level = self.settings.level;
        let adds_up = self.maps.model.space == Space::Linear;
        let mut waiting = false;
        // A single direction needs no sum of its functions first.
        let alone = matches!(group, [light] if samples(&self.scene.lights[*light]) == 1);
        let color = self.scene.lights[group[0]].color;
        for ((&light, _), report) in
            group.iter().zip(skipped).zip(reports).filter(|((_, skipped), _)| !**skipped)
        {
            let start = self.clock();
            let light = &self.scene.lights[light];
            for sample in 0..samples(light) {
                let surface = space.light.aim(level, light, sample, &self.plan.horizon, &space.positions);
                *at_surface += if sample == 0 { surface } else { 0 };
                if space.light.is_dark() {
                    continue;
                }
                evaluator.evaluate(level, space.light.directions(), &mut space.functions[..count * pixels]);
                if adds_up && !alone && space.light.gobo.is_none() {
                    let functions = &space.functions[..count * pixels];
                    let weights = &mut space.weights[..count * pixels];
                    level.run(Gather {
                        functions,
                        strength: &space.light.strength,
                        weights,
                        fresh: !waiting,
                    });
                    waiting = true;
                } else {
                    let Workspace { functions, light: row, products, .. } = space;
                    let strength = Some(Strength { row: &row.strength, gobo: row.gobo.as_ref() });
                    self.add_sums(place, &functions[..count * pixels], color, strength, products);
                }
            }
            report.seconds += seconds(start);
        }
        if waiting {
            self.add_sums(place, &space.weights[..count * pixels], color, None, &mut space.products);
        }
    }

    /// Adds, by channel, color x the sum over functions of weight x coefficient to a strip's sums.
    fn add_sums(
        &self,
        place: Place,
        weights: &[f32],
        color: [f32; 3],
        strength: Option<Strength<'_>>,
        products: &mut Workplace<'_>,
    ) {
        let Place { first, offset, pixels, stride } = place;
        let level = self.settings.level;
        let Workplace { strip, sum, factor, sums } = products;
        let (sum, factor) = (&mut sum[..pixels], &mut factor[..pixels]);
        for (c, total) in sums.chunks_exact_mut(stride).take(self.plan.channels).enumerate() {
            let channel = &self.channels[c.min(self.channels.len() - 1)];
            if c == 0 || !self.alike {
                strip.products(level, offset, weights, channel, sum);
            }
            let factor = channel.factor.map(|plane| {
                coefficients(level, plane, first + offset, factor);
                &*factor
            });
            level.run(AddChannel {
                sum,
                factor,
                decode: self.maps.model.space == Space::Encoded,
                strength: strength.as_ref().map(|s| (s.row, s.gobo.map(|gobo| &gobo[c][..]))),
                color: color[c],
                total: &mut total[offset..offset + pixels],
            });
        }
    }
}

/// Some columns of a band.
struct Tile {
    column: usize,
    pixels: usize,
    /// Of the local lights, in order of the plan's groups.
    skipped: Vec<bool>,
    /// Whether one is not.
    lit: bool,
}

/// Where a tile's row lies in its strip.
#[derive(Clone, Copy)]
struct Place {
    /// The strip's first pixel.
    first: usize,
    /// Pixels of the strip before it.
    offset: usize,
    pixels: usize,
    /// Pixels of the strip.
    stride: usize,
}

struct Strength<'a> {
    row: &'a [f32],
    gobo: Option<&'a [Vec<f32>; 3]>,
}

fn samples(light: &Light) -> usize {
    match light.lamp {
        Lamp::Sphere { samples, .. } => samples,
        _ => 1,
    }
}

fn seconds(start: Option<Instant>) -> f64 {
    start.map_or(0.0, |start| start.elapsed().as_secs_f64())
}
