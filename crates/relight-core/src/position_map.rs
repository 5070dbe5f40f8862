//! Where each pixel's surface is.

/// The surface point of each pixel, in the axes of the light directions.
///
/// Source: P of Wong et al., *Lighting Precomputation Using the Relighting Map*, equation 3, and
/// *Interactive Relighting of Panoramas*, equation 2, where V points from the scene to the eye.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionMap {
    /// Pixels in a row.
    pub width: usize,
    /// Rows, the first at the top.
    pub height: usize,
    /// width x height points, row-major. NaN in all three where there is no surface; where the sky
    /// is, a point as far along the ray as the numbers go.
    pub points: Vec<[f32; 3]>,
}

/// How far away the sky is, in units of the world: any lamp is in the direction of the eye from there,
/// and squares stay finite.
pub const SKY: f64 = 1e15;

/// The point of a pixel without a surface.
pub const NO_SURFACE: [f32; 3] = [f32::NAN; 3];

impl PositionMap {
    /// The smallest box that holds all points that are neither sky nor missing, (least, largest) by axis;
    /// `None` where there are none.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let near = |point: &&[f32; 3]| point.iter().all(|c| c.abs() < (SKY / 1e3) as f32);
        let mut points = self.points.iter().filter(near);
        let first = *points.next()?;
        Some(points.fold((first, first), |(least, largest), point| {
            ([0, 1, 2].map(|i| least[i].min(point[i])), [0, 1, 2].map(|i| largest[i].max(point[i])))
        }))
    }
}
