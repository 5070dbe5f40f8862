//! How far a picture may be from the reference when a GPU decodes the blocks itself.

use rayon::prelude::*;
use relight_core::{Basis, Direction, PlaneRole, RelightingMap, RelightingMaps};
use relight_texture::{BlockFormat, Packing, TexelFormat};

/// How far a GPU's decoding of a texel may be from ours, in units of the format's domain.
///
/// Source: measured on Mesa 22.3's lavapipe, which interpolates BC1 to BC5 in 8 bits (SNORM with
/// half the codes); BC6H and BC7 are exact by their specification.
pub fn decoding_tolerance(format: TexelFormat) -> f64 {
    match format {
        TexelFormat::Block(BlockFormat::Bc4Signed | BlockFormat::Bc5Signed) => 0.016,
        TexelFormat::Block(BlockFormat::Bc1 | BlockFormat::Bc3 | BlockFormat::Bc4 | BlockFormat::Bc5) => {
            0.008
        }
        TexelFormat::Block(BlockFormat::Bc6h | BlockFormat::Bc6hSigned | BlockFormat::Bc7)
        | TexelFormat::Plain { .. } => 0.0,
    }
}

/// What the tolerance of texels comes to in relit pictures of an asset.
#[derive(Clone, Debug)]
pub struct DecodingBound {
    basis: Basis,
    planes: Vec<PlaneBound>,
}

#[derive(Clone, Copy, Debug)]
struct PlaneBound {
    role: PlaneRole,
    /// How far a coefficient may be off.
    error: f64,
    /// Its largest magnitude.
    reach: f64,
}

impl DecodingBound {
    /// The bound for an asset whose decoded maps, of any level, are `maps`.
    ///
    /// # Panics
    /// When `packing` lacks a plane of `maps`.
    pub fn new(maps: &RelightingMaps, packing: &Packing) -> Self {
        let mut errors = vec![0.0; maps.planes.len()];
        for array in &packing.arrays {
            for layer in &array.layers {
                for (plane, quantizer) in layer.planes.iter().zip(&layer.quantizers) {
                    errors[*plane] = decoding_tolerance(array.format) * f64::from(quantizer.scale.abs());
                }
            }
        }
        let reaches: Vec<f64> =
            maps.planes.par_iter().map(|plane| reach(plane, maps.width, maps.height)).collect();
        let planes = maps.model.roles().into_iter().zip(errors).zip(reaches);
        let planes = planes.map(|((role, error), reach)| PlaneBound { role, error, reach }).collect();
        Self { basis: maps.model.basis.clone(), planes }
    }

    /// How far any sample under `light` may be off: the sum over a channel's planes of
    /// |weight| x |scale| x tolerance, and, where base colour multiplies it, the products of either
    /// error with the largest value of the other.
    pub fn at(&self, light: Direction) -> f64 {
        let mut weights = vec![0.0; self.basis.count()];
        self.basis.evaluate(light, &mut weights);
        let mut sums = [(0.0, 0.0); 3];
        let mut factors = [(0.0, 1.0); 3];
        for plane in &self.planes {
            match plane.role {
                PlaneRole::Coefficient { functions } => {
                    for ((error, reach), function) in sums.iter_mut().zip(functions) {
                        let weight = function.map_or(0.0, |f| weights[usize::from(f)].abs());
                        *error += weight * plane.error;
                        *reach += weight * plane.reach;
                    }
                }
                PlaneRole::BaseColor { channel } => {
                    factors[usize::from(channel)] = (plane.error, plane.reach)
                }
            }
        }
        let of_channel = |((error, reach), (factor_error, factor_reach)): ((f64, f64), (f64, f64))| {
            error * factor_reach + reach * factor_error + error * factor_error
        };
        sums.into_iter().zip(factors).map(of_channel).fold(0.0, f64::max)
    }
}

/// The largest magnitude of a plane's coefficients.
fn reach(plane: &RelightingMap, width: usize, height: usize) -> f64 {
    let mut row = vec![0.0f32; width];
    let mut reach = 0.0f32;
    for y in 0..height {
        plane.coefficients(y * width, &mut row);
        reach = row.iter().fold(reach, |reach, c| reach.max(c.abs()));
    }
    f64::from(reach)
}

#[cfg(test)]
mod tests {
    use super::*;
    use relight_core::{Design, Family, Layout, LightSet, Model, Space, Texels};
    use relight_texture::{ArrayPlan, LayerPlan, Quantizer, Wrap};

    /// Luminance in BC4, base colour in BC5 SNORM and BC1, a scale of its own in every plane.
    #[test]
    fn the_bound_is_that_of_the_errors_by_hand() {
        let basis = Family::by_name("ptm").unwrap().build(&Design::new(6, &LightSet::default())).unwrap();
        let model = Model {
            basis,
            layout: Layout::Lrgb,
            space: Space::Encoded,
            lights: vec![],
            figures: None,
            provenance: None,
        };
        let scales: Vec<f32> = (0..9).map(|p| 1.0 + 0.5 * p as f32).collect();
        let plane =
            |p: usize| RelightingMap { scale: scales[p], bias: -1.0, texels: Texels::F32(vec![0.25, 1.0]) };
        let planes = (0..9).map(plane).collect();
        let maps = RelightingMaps { width: 1, height: 2, model, planes };
        let layer = |planes: &[usize]| LayerPlan {
            planes: planes.to_vec(),
            quantizers: planes.iter().map(|p| Quantizer { scale: scales[*p], bias: -1.0 }).collect(),
        };
        let array = |block, layers: &[&[usize]]| ArrayPlan {
            format: TexelFormat::Block(block),
            layers: layers.iter().map(|planes| layer(planes)).collect(),
        };
        let packing = Packing {
            arrays: vec![
                array(BlockFormat::Bc4, &[&[0], &[1], &[2], &[3], &[4], &[5]]),
                array(BlockFormat::Bc5Signed, &[&[6, 7]]),
                array(BlockFormat::Bc1, &[&[8]]),
            ],
            levels: 1,
            wrap: Wrap::Clamp,
        };
        // Light from above: functions u^2, v^2, uv, u, v are 0, the constant is 1: plane 5, scale
        // 3.5, from -0.125 to 2.5. Base colours reach 3, 3.5 and 4; the second is worst.
        let (luminance, base) = (0.008 * 3.5, 0.016 * 4.5);
        let expected = luminance * 3.5 + 2.5 * base + luminance * base;
        let found = DecodingBound::new(&maps, &packing).at(Direction::OUT);
        assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
    }
}
