//! The pixels of a part, lit by lights one by one, by the rig, or by both.

use crate::{
    Light, LightPlan, PlacedPart, Projector, RigRows, ShadedRig, Source, SurfaceRows, add_reflectance,
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
        self.lit(&around(placed, &lights), None, level)
    }

    /// All light through the rig.
    pub fn by_rig(
        &self,
        placed: &PlacedPart<'_>,
        lights: &[Light],
        bands: usize,
        level: CpuLevel,
    ) -> Reflected {
        let lights: Vec<_> = lights.iter().map(|light| (light, 1.0)).collect();
        self.lit(&[], Some(&shaded(placed, &lights, bands, level)), level)
    }

    /// Each light as `plans` has it.
    pub fn by_plan(
        &self,
        placed: &PlacedPart<'_>,
        lights: &[Light],
        plans: &[LightPlan],
        bands: usize,
        level: CpuLevel,
    ) -> Reflected {
        let shares = |share: fn(&LightPlan) -> f64| -> Vec<(&Light, f64)> {
            let shares = lights.iter().zip(plans).map(|(light, plan)| (light, share(plan)));
            shares.filter(|(_, share)| *share > 0.0).collect()
        };
        let analytic = shares(|plan| plan.analytic);
        let through = shares(|plan| if plan.dropped { 0.0 } else { 1.0 - plan.analytic });
        let rig = (!through.is_empty()).then(|| shaded(placed, &through, bands, level));
        self.lit(&around(placed, &analytic), rig.as_ref(), level)
    }

    fn lit(&self, lights: &[Light], rig: Option<&ShadedRig>, level: CpuLevel) -> Reflected {
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
                add_reflectance(light, level, &SurfaceRows { x, y, z, nx, ny, nz }, [r, g, b]);
            }
        });
        out
    }
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

fn shaded(placed: &PlacedPart<'_>, lights: &[(&Light, f64)], bands: usize, level: CpuLevel) -> ShadedRig {
    let part = placed.part;
    let middle = placed.placement.point(part.frame.centre);
    let projector = Projector::new(lights, bands, (middle, part.frame.radius));
    let coefficients = part.coefficients_by(&projector, &placed.placement, bands, level);
    ShadedRig::new(part, &coefficients, bands)
}
