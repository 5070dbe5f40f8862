//! Positions as texels: R, G, B are x, y, z by scale and bias, A is 1 where there is a point.

use crate::{Precision, TexelFormat};
use half::f16;
use relight_core::{NO_SURFACE, PointKind, PositionMap, SKY};

/// The largest component of a half texel of the sky: the largest half.
const SKY_TEXEL: f64 = 65504.0;

/// Half texels beyond this are the sky; those of surfaces lie within -1 to 1.
const SKY_FROM: f64 = 32768.0;

/// How positions lie in texels of four channels: position = scale x texel + bias in the first three,
/// and the fourth is 1, or 0 for a pixel without a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionPlan {
    /// F16 or F32.
    pub precision: Precision,
    /// By axis, in units of the world.
    pub scale: [f32; 3],
    /// By axis.
    pub bias: [f32; 3],
}

impl PositionPlan {
    /// The plan for `map`. Floats are positions as they are. Halves are relative to the box of all
    /// surface points: its middle is 0, half its longest edge is 1 on every axis. One scale for all axes
    /// loses nothing, since halves are finer the nearer they are to 0, and keeps directions.
    ///
    /// # Panics
    /// For 8 bits.
    pub fn new(map: &PositionMap, precision: Precision) -> Self {
        assert_ne!(precision, Precision::U8, "positions take halves or floats");
        let (scale, bias) = match (precision, map.bounds()) {
            (Precision::F16, Some((least, largest))) => {
                let [least, largest] = [least, largest].map(|point| point.map(f64::from));
                let bias = [0, 1, 2].map(|i| (0.5 * (least[i] + largest[i])) as f32);
                let reach = (0..3)
                    .map(|i| (largest[i] - f64::from(bias[i])).max(f64::from(bias[i]) - least[i]))
                    .fold(0.0, f64::max);
                // One point, or points too near each other for f32 to count their distances.
                let scale = if (reach as f32).is_normal() { reach as f32 } else { 1.0 };
                ([scale; 3], bias)
            }
            _ => ([1.0; 3], [0.0; 3]),
        };
        Self { precision, scale, bias }
    }

    /// The texels' format: four channels.
    pub fn format(&self) -> TexelFormat {
        TexelFormat::Plain { precision: self.precision, channels: 4 }
    }

    /// Appends the texels of `points` to `bytes`, little-endian.
    pub fn append_texels(&self, points: &[[f32; 3]], bytes: &mut Vec<u8>) {
        for point in points {
            let texel = self.texel(*point);
            match self.precision {
                Precision::F32 => bytes.extend(texel.iter().flat_map(|c| c.to_le_bytes())),
                _ => bytes.extend(texel.iter().flat_map(|c| f16::from_f32(*c).to_le_bytes())),
            }
        }
    }

    /// The points of `texels` as [`Self::append_texels`] made them. Those of the sky are [`SKY`] away
    /// again.
    ///
    /// # Panics
    /// When `texels` has another number of texels than `points`.
    pub fn copy_points(&self, texels: &[u8], points: &mut [[f32; 3]]) {
        let bytes = self.format().unit_bytes();
        assert_eq!(texels.len(), points.len() * bytes, "a texel a point");
        for (point, texel) in points.iter_mut().zip(texels.chunks_exact(bytes)) {
            let channel = |c: usize| match self.precision {
                Precision::F32 => {
                    f32::from_le_bytes([texel[4 * c], texel[4 * c + 1], texel[4 * c + 2], texel[4 * c + 3]])
                }
                _ => f16::from_le_bytes([texel[2 * c], texel[2 * c + 1]]).to_f32(),
            };
            *point = self.point([0, 1, 2, 3].map(channel));
        }
    }

    fn texel(&self, point: [f32; 3]) -> [f32; 4] {
        let relative = |i: usize| (f64::from(point[i]) - f64::from(self.bias[i])) / f64::from(self.scale[i]);
        let [x, y, z] = match (PointKind::of(point), self.precision) {
            (PointKind::Missing, _) => return [0.0; 4],
            (PointKind::Sky, Precision::F16) => {
                let towards = [0, 1, 2].map(|i| f64::from(point[i]) / f64::from(self.scale[i]));
                let largest = towards.iter().fold(0.0f64, |largest, c| largest.max(c.abs()));
                towards.map(|c| (c / largest * SKY_TEXEL) as f32)
            }
            _ => [0, 1, 2].map(|i| relative(i) as f32),
        };
        [x, y, z, 1.0]
    }

    fn point(&self, texel: [f32; 4]) -> [f32; 3] {
        let [x, y, z, there] = texel.map(f64::from);
        let scaled: [f64; 3] = [0, 1, 2].map(|i| [x, y, z][i] * f64::from(self.scale[i]));
        let largest = [x, y, z].iter().fold(0.0f64, |largest, c| largest.max(c.abs()));
        let point = if self.precision == Precision::F16 && largest > SKY_FROM {
            // Divided first: the squares of what a file calls its scale may leave f64.
            let longest = scaled.iter().fold(0.0f64, |longest, c| longest.max(c.abs()));
            let part = scaled.map(|c| c / longest);
            let length = part.iter().map(|c| c * c).sum::<f64>().sqrt();
            part.map(|c| (SKY * c / length) as f32)
        } else {
            [0, 1, 2].map(|i| (scaled[i] + f64::from(self.bias[i])) as f32)
        };
        let known = there > 0.5 && PointKind::of(point) != PointKind::Missing;
        if known { point } else { NO_SURFACE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points in a lopsided box from (-3, 10, 99.99) to (5, 11, 100.01), the sky twice, and nothing.
    fn map() -> PositionMap {
        let mut points: Vec<[f32; 3]> = (0..9)
            .map(|i| {
                let t = i as f32 / 8.0;
                [-3.0 + 8.0 * t, 10.0 + t * t, 100.01 - 0.02 * t]
            })
            .collect();
        points.extend([[6e14, 0.0, -8e14], [-1e15, 1e3, -2e14], NO_SURFACE]);
        PositionMap { width: 4, height: 3, points }
    }

    fn round_trip(plan: PositionPlan, map: &PositionMap) -> Vec<[f32; 3]> {
        let mut bytes = Vec::new();
        let (first, rest) = map.points.split_at(map.points.len() / 2);
        plan.append_texels(first, &mut bytes);
        plan.append_texels(rest, &mut bytes);
        let mut points = vec![[7.0; 3]; map.points.len()];
        plan.copy_points(&bytes, &mut points);
        points
    }

    #[test]
    fn floats_come_back_as_they_were() {
        let map = map();
        let plan = PositionPlan::new(&map, Precision::F32);
        let found = round_trip(plan, &map);
        assert_eq!(found[..11], map.points[..11]);
        assert!(found[11].iter().all(|c| c.is_nan()));
    }

    #[test]
    fn halves_come_back_within_half_a_step_of_the_box() {
        let map = map();
        let plan = PositionPlan::new(&map, Precision::F16);
        assert_eq!((plan.scale, plan.bias), ([4.0; 3], [1.0, 10.5, 100.0]));
        for (found, point) in round_trip(plan, &map).iter().zip(&map.points).take(9) {
            for i in 0..3 {
                // Half a step of 2^-11 of each axis' own half edge, and the rounding of f32.
                let edge = [8.0, 1.0, 0.02][i];
                let allowed = 0.5 * edge / 4096.0 + 1e-7 * point[i].abs();
                assert!((found[i] - point[i]).abs() <= allowed, "{found:?} {point:?}");
            }
        }
    }

    #[test]
    fn half_texels_of_the_sky_are_far_away_along_its_direction() {
        let map = map();
        let plan = PositionPlan::new(&map, Precision::F16);
        let mut bytes = Vec::new();
        plan.append_texels(&map.points[9..], &mut bytes);
        let texel = |at: usize| f16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]).to_f32();
        assert_eq!([0, 1, 2, 3].map(texel), [49120.0, 0.0, -65504.0, 1.0]);
        assert_eq!([8, 9, 10, 11].map(texel), [0.0; 4]);
        let found = round_trip(plan, &map);
        for (found, point) in found[9..11].iter().zip(&map.points[9..]) {
            let [found, point] = [found, point].map(|p| p.map(f64::from));
            let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
            assert!((dot(found, found).sqrt() / SKY - 1.0).abs() < 1e-6, "{found:?}");
            let cosine = dot(found, point) / (dot(found, found) * dot(point, point)).sqrt();
            assert!(cosine > 1.0 - 1e-7, "{cosine}");
        }
    }

    #[test]
    fn a_single_point_and_none_at_all_have_a_plan_too() {
        for points in
            [vec![[3.5, 0.1, -7e11]; 2], vec![NO_SURFACE; 2], vec![[1e15, 0.0, 0.0], [1e-42, 0.0, 0.0]]]
        {
            let map = PositionMap { width: 2, height: 1, points };
            let plan = PositionPlan::new(&map, Precision::F16);
            assert_eq!(plan.scale, [1.0; 3]);
            for (found, point) in round_trip(plan, &map).iter().zip(&map.points) {
                assert_eq!(PointKind::of(*found), PointKind::of(*point));
                let near = (0..3).all(|i| found[i] == point[i] || point[i].is_nan());
                assert!(near, "{found:?} {point:?}");
            }
        }
    }

    #[test]
    fn texels_of_a_damaged_file_are_points_or_nothing() {
        let plan =
            PositionPlan { precision: Precision::F16, scale: [f32::MAX, 0.0, 1e-45], bias: [f32::MAX; 3] };
        for texel in [[65504.0; 4], [f32::INFINITY; 4], [f32::NAN; 4], [0.0, 65504.0, 0.0, 1.0], [1.0; 4]] {
            let point = plan.point(texel);
            assert!(point.iter().all(|c| c.is_finite()) || point.iter().all(|c| c.is_nan()), "{point:?}");
        }
        assert!(plan.point([0.1, 0.2, 0.3, 0.0])[0].is_nan());
    }
}
