//! The pixels of a part, lit by lights one by one, by the rig, or by both.

use crate::{
    Bands, CutDiscs, Light, LightPlan, PlacedPart, Projector, RigRows, ShadedRig, Source, SurfaceRows,
    add_reflectance,
};
use rayon::prelude::*;
use relight_core::CpuLevel;
use relight_core::vectors::{difference, unit};
use std::ops::Range;

/// Pixels lit together: what they are and what they get stays in the nearest cache.
const SPAN: usize = 1024;

/// Surface points that pixels see, each number in a list of its own.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// x, y, z in the mesh's box.
    coordinates: [Vec<f32>; 3],
    /// x, y, z in the scene, from the middle of the part's frame: far from the scene's origin nothing is lost.
    points: [Vec<f32>; 3],
    /// x, y, z of unit normals in the scene.
    normals: [Vec<f32>; 3],
}

/// R, G, B of reflected light by pixel.
pub type Reflected = [Vec<f32>; 3];

impl Pixels {
    /// Adds a point of the mesh, in the mesh's axes; its normal need not have unit length.
    pub fn push(&mut self, placed: &PlacedPart<'_>, point: [f64; 3], normal: [f64; 3]) {
        let frame = &placed.part.frame;
        let coordinates = frame.coordinates(point);
        let from_middle = placed.placement.direction([0, 1, 2].map(|i| point[i] - frame.centre[i]));
        let normal = unit(placed.placement.direction(normal)).unwrap_or([0.0, 0.0, 1.0]);
        for axis in 0..3 {
            self.coordinates[axis].push(coordinates[axis] as f32);
            self.points[axis].push(from_middle[axis] as f32);
            self.normals[axis].push(normal[axis] as f32);
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.points[0].len()
    }

    /// Whether the part is not seen at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Every light evaluated exactly at every pixel.
    pub fn by_brute_force(&self, placed: &PlacedPart<'_>, lights: &[Light], level: CpuLevel) -> Reflected {
        let lights: Vec<_> = lights.iter().map(|light| (light, 1.0)).collect();
        self.lit(&around(placed, &lights), CutDiscs::Exact, None, level)
    }

    /// All light through the rig.
    pub fn by_rig(
        &self,
        placed: &PlacedPart<'_>,
        lights: &[Light],
        bands: impl Into<Bands>,
        level: CpuLevel,
    ) -> Reflected {
        let lights: Vec<_> = lights.iter().map(|light| (light, 1.0)).collect();
        let rig = shaded(placed, &lights, bands.into(), level);
        self.lit(&[], CutDiscs::Fast, Some(&rig), level)
    }

    /// Each light as `plans` has it; discs that horizons cut are [`CutDiscs::Fast`].
    pub fn by_plan(
        &self,
        placed: &PlacedPart<'_>,
        lights: &[Light],
        plans: &[LightPlan],
        bands: impl Into<Bands>,
        level: CpuLevel,
    ) -> Reflected {
        let analytic = shares(lights, plans, |plan| plan.analytic);
        let through = through(lights, plans);
        let rig = (!through.is_empty()).then(|| shaded(placed, &through, bands.into(), level));
        self.lit(&around(placed, &analytic), CutDiscs::Fast, rig.as_ref(), level)
    }

    fn lit(&self, lights: &[Light], cut: CutDiscs, rig: Option<&ShadedRig>, level: CpuLevel) -> Reflected {
        let mut out: Reflected = [0, 1, 2].map(|_| vec![0.0; self.len()]);
        let [r, g, b] = &mut out;
        let spans =
            r.par_chunks_mut(SPAN).zip(g.par_chunks_mut(SPAN)).zip(b.par_chunks_mut(SPAN)).enumerate();
        spans.for_each(|(span, ((r, g), b))| {
            let range = span * SPAN..span * SPAN + r.len();
            let rows = |columns| part_of(columns, range.clone());
            if let Some(rig) = rig {
                let (coordinates, normals) = (rows(&self.coordinates), rows(&self.normals));
                rig.add(level, RigRows { coordinates, normals, out: [r, g, b] });
            }
            let ([x, y, z], [nx, ny, nz]) = (rows(&self.points), rows(&self.normals));
            for light in lights {
                add_reflectance(light, cut, level, &SurfaceRows { x, y, z, nx, ny, nz }, [r, g, b]);
            }
        });
        out
    }
}

impl PlacedPart<'_> {
    /// [`crate::RigPart::reflectance_by_band`] of lights, each as often as `plans` sends it through the rig; of all in full without plans.
    pub fn reflectance_by_band(
        &self,
        lights: &[Light],
        plans: Option<&[LightPlan]>,
        bands: usize,
        level: CpuLevel,
    ) -> Vec<Vec<[f64; 3]>> {
        let lights = match plans {
            Some(plans) => through(lights, plans),
            None => lights.iter().map(|light| (light, 1.0)).collect(),
        };
        let coefficients = coefficients(self, &lights, bands, level);
        self.part.reflectance_by_band(&coefficients, &self.placement, bands)
    }
}

fn shares<'a>(
    lights: &'a [Light],
    plans: &[LightPlan],
    share: fn(&LightPlan) -> f64,
) -> Vec<(&'a Light, f64)> {
    let shares = lights.iter().zip(plans).map(|(light, plan)| (light, share(plan)));
    shares.filter(|(_, share)| *share > 0.0).collect()
}

/// What goes through the rig.
fn through<'a>(lights: &'a [Light], plans: &[LightPlan]) -> Vec<(&'a Light, f64)> {
    shares(lights, plans, |plan| if plan.dropped { 0.0 } else { 1.0 - plan.analytic })
}

fn part_of(columns: &[Vec<f32>; 3], range: Range<usize>) -> [&[f32]; 3] {
    columns.each_ref().map(|column| &column[range.clone()])
}

/// Lights by their shares, seen from the middle of the part's frame.
fn around(placed: &PlacedPart<'_>, lights: &[(&Light, f64)]) -> Vec<Light> {
    let origin = placed.placement.point(placed.part.frame.centre);
    let moved = |(light, share): &(&Light, f64)| {
        let from_origin = |place: [f64; 3]| difference(place, origin);
        let source = match light.source.clone() {
            Source::Sphere { centre, radius } => Source::Sphere { centre: from_origin(centre), radius },
            Source::Disc { centre, normal, radius } => {
                Source::Disc { centre: from_origin(centre), normal, radius }
            }
            Source::Point { position, nearest } => Source::Point { position: from_origin(position), nearest },
            afar @ (Source::Directional { .. } | Source::Probe(_)) => afar,
        };
        Light { name: light.name.clone(), source, color: light.color.map(|c| c * share) }
    };
    lights.iter().map(moved).collect()
}

fn shaded(placed: &PlacedPart<'_>, lights: &[(&Light, f64)], bands: Bands, level: CpuLevel) -> ShadedRig {
    ShadedRig::new(placed.part, &coefficients(placed, lights, bands.count, level), bands)
}

/// The rig's vectors, those of bands without irradiance left 0.
fn coefficients(
    placed: &PlacedPart<'_>,
    lights: &[(&Light, f64)],
    bands: usize,
    level: CpuLevel,
) -> Vec<[f64; 3]> {
    let part = placed.part;
    let middle = placed.placement.point(part.frame.centre);
    let projector = Projector::new(lights, bands, (middle, part.frame.radius)).for_irradiance();
    part.coefficients_by(&projector, &placed.placement, bands, level)
}
