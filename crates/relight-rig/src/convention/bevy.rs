//! Bevy: irradiance volumes of ambient cubes, which weigh a colour a side by the squares of the normal.
//!
//! Source: Bevy's irradiance_volume.wgsl and its module's page. They differ in which side comes first; this follows the shader,
//! which reads sides that face down an axis from the second half of y.

use super::{HARMONICS, Places, Target, reflected_polynomial};
use crate::{AxisFunction, Frame};

pub(super) const TARGET: Target = Target {
    name: "bevy",
    stores: "irradiance / pi on the six sides of an ambient cube, as texels of an IrradianceVolume of intensity 1",
    axes: "x,y,z",
    places: Places::Cells,
    values: &["+x", "-x", "+y", "-y", "+z", "-z"],
    convert: sides,
};

/// The sides that are closest to irradiance / pi over all normals, by least squares.
///
/// Of a polynomial c + v.n + n.Qn they are c + Q_aa +- 5/4 v_a on axis a: the even part is met but for products of two axes,
/// and 5/4 is what best makes n_a of n_a |n_a|. Sides may be negative, which formats without sign clip.
fn sides(radiance: &[[f64; 3]; HARMONICS]) -> Vec<[f64; 3]> {
    let p = reflected_polynomial(radiance);
    let side = |even: [f64; 3], odd: [f64; 3], sign: f64| [0, 1, 2].map(|c| even[c] + sign * 1.25 * odd[c]);
    // 3 z^2 - 1 is 2 on the z axis and -1 on the others.
    let axes = [(-1.0, 1.0, p[3]), (-1.0, -1.0, p[1]), (2.0, 0.0, p[2])];
    let pairs = axes.map(|(of_6, of_8, odd)| {
        let even = [0, 1, 2].map(|c| p[0][c] + of_6 * p[6][c] + of_8 * p[8][c]);
        [side(even, odd, 1.0), side(even, odd, -1.0)]
    });
    pairs.concat()
}

/// A volume of ambient cubes: where its cells are, and where their sides lie in its texture.
#[derive(Clone, Debug, PartialEq)]
pub struct AmbientCubes {
    /// Cells along each axis.
    pub cells: [usize; 3],
    /// The middle of the volume.
    pub centre: [f64; 3],
    /// Its edges: Bevy's scale of the volume.
    pub edges: [f64; 3],
}

/// The volume whose cells, blended by a linear sampler, give the model's weights exactly over the box.
///
/// An axis has a cell a node, two where the lighting changes evenly, one where it does not change. The volume is larger than the
/// box by half a cell each way, since samplers blend between the middles of cells.
pub fn ambient_cubes(frame: &Frame, products: &[[AxisFunction; 3]]) -> AmbientCubes {
    let cells = [0, 1, 2].map(|axis| {
        let of_product = |product: &[AxisFunction; 3]| match product[axis] {
            AxisFunction::One => 1,
            AxisFunction::Coordinate => 2,
            AxisFunction::Hat { nodes, .. } => nodes,
        };
        products.iter().map(of_product).max().unwrap_or(1)
    });
    let edges = [0, 1, 2].map(|axis| {
        let half = if frame.half_extent[axis] > 0.0 { frame.half_extent[axis] } else { 1.0 };
        let cells = cells[axis] as f64;
        if cells > 1.0 { 2.0 * half * cells / (cells - 1.0) } else { 2.0 * half }
    });
    AmbientCubes { cells, centre: frame.centre, edges }
}

impl AmbientCubes {
    /// The middle of a cell, in coordinates of the mesh's box.
    pub fn coordinates(&self, cell: [usize; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| match self.cells[axis] {
            1 => 0.0,
            cells => 2.0 * cell[axis] as f64 / (cells - 1) as f64 - 1.0,
        })
    }

    /// Width, height and depth of the texture.
    pub fn texels(&self) -> [usize; 3] {
        let [x, y, z] = self.cells;
        [x, 2 * y, 3 * z]
    }

    /// Column, row and slice of side `side` (+x, -x, +y, -y, +z, -z) of a cell.
    pub fn texel(&self, [x, y, z]: [usize; 3], side: usize) -> [usize; 3] {
        [x, y + self.cells[1] * (side % 2), z + self.cells[2] * (side / 2)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluation::{irradiance, lopsided, normals};
    use super::*;
    use std::f64::consts::PI;

    /// What irradiance_volume_light makes of a cell's own colours.
    fn cube(sides: &[[f64; 3]], normal: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|c| {
            (0..3).map(|a| normal[a] * normal[a] * sides[2 * a + usize::from(normal[a] < 0.0)][c]).sum()
        })
    }

    /// Squared error over the sphere by even steps in z and around.
    fn squared_error(sides: &[[f64; 3]]) -> f64 {
        let (mut sum, steps) = (0.0, 200);
        for i in 0..steps {
            let z = (i as f64 + 0.5) / steps as f64 * 2.0 - 1.0;
            for k in 0..2 * steps {
                let angle = (k as f64 + 0.5) / steps as f64 * PI;
                let s = (1.0 - z * z).sqrt();
                let normal = [s * libm::cos(angle), s * libm::sin(angle), z];
                let (got, expected) = (cube(sides, normal), irradiance(&lopsided(), normal));
                sum += (got[1] - expected[1] / PI) * (got[1] - expected[1] / PI);
            }
        }
        sum
    }

    #[test]
    fn no_other_sides_are_closer() {
        let sides = sides(&lopsided());
        let least = squared_error(&sides);
        for side in 0..6 {
            let moved = |step: f64| {
                let mut moved = sides.clone();
                moved[side][1] += step;
                squared_error(&moved)
            };
            // A parabola whose lowest point is where we are.
            let (less, more) = (moved(-0.01), moved(0.01));
            assert!(less > least && more > least, "side {side}: {less} {least} {more}");
            assert!(
                (less - more).abs() < 1e-2 * (less + more - 2.0 * least),
                "side {side}: {less} {least} {more}"
            );
        }
    }

    /// The shader's own arithmetic: a texture's linear sampler between texels, sides that face down an axis at y + 0.5.
    fn irradiance_volume_light(
        volume: &AmbientCubes,
        texel: impl Fn([usize; 3]) -> f64,
        at: [f64; 3],
        normal: [f64; 3],
    ) -> f64 {
        let [cells, texels] = [volume.cells, volume.texels()].map(|size| size.map(|n| n as f64));
        let unit = [0, 1, 2].map(|a| (at[a] - volume.centre[a]) / volume.edges[a]);
        let uvw = [0, 1, 2].map(|a| ((unit[a] + 0.5) * cells[a]).clamp(0.5, cells[a] - 0.5) / texels[a]);
        let sample = |uvw: [f64; 3]| {
            let at = [0, 1, 2].map(|a| (uvw[a] * texels[a] - 0.5).clamp(0.0, texels[a] - 1.0));
            let mut sum = 0.0;
            for corner in 0..8usize {
                let far = [corner & 1, corner >> 1 & 1, corner >> 2];
                let place =
                    [0, 1, 2].map(|a| ((at[a] + 1e-9).floor() as usize + far[a]).min(texels[a] as usize - 1));
                let weight = |a: usize| {
                    let t = (at[a] - (at[a] + 1e-9).floor()).max(0.0);
                    if far[a] == 1 { t } else { 1.0 - t }
                };
                sum += weight(0) * weight(1) * weight(2) * texel(place);
            }
            sum
        };
        let down = normal.map(|n| if n < 0.0 { 0.5 } else { 0.0 });
        let axis =
            |a: usize| normal[a] * normal[a] * sample([uvw[0], uvw[1] + down[a], uvw[2] + a as f64 / 3.0]);
        axis(0) + axis(1) + axis(2)
    }

    #[test]
    fn the_shader_finds_the_models_blend_of_the_right_side() {
        let model = crate::Model::parse("mixed:3,gradient,constant").unwrap();
        let frame = Frame { centre: [5.0, -2.0, 1.0], half_extent: [2.0, 0.5, 0.25], radius: 3.0 };
        let volume = ambient_cubes(&frame, model.parameters());
        assert_eq!((volume.cells, volume.texels()), ([3, 2, 1], [3, 4, 3]));
        // A parameter's value on a side: one-sided, so that a swap of sides shows.
        let value =
            |parameter: usize, side: usize| 1.0 + parameter as f64 * 0.37 + (side * side) as f64 * 0.11;
        let mut weights = vec![0.0; model.parameters().len()];
        let mut texture = vec![f64::NAN; 3 * 4 * 3];
        for cell in 0..6 {
            let cell = [cell % 3, cell / 3, 0];
            model.weights(volume.coordinates(cell), &mut weights);
            for side in 0..6 {
                let [x, y, z] = volume.texel(cell, side);
                texture[x + 3 * (y + 4 * z)] = (0..6).map(|p| weights[p] * value(p, side)).sum();
            }
        }
        assert!(texture.iter().all(|value| value.is_finite()), "every texel is filled");
        for normal in normals() {
            let at = [0, 1, 2].map(|a| frame.centre[a] + frame.half_extent[a] * normal[(a + 1) % 3]);
            let got = irradiance_volume_light(&volume, |[x, y, z]| texture[x + 3 * (y + 4 * z)], at, normal);
            model.weights(frame.coordinates(at), &mut weights);
            let side = |a: usize| 2 * a + usize::from(normal[a] < 0.0);
            let of_axis = |a: usize| {
                (0..6).map(|p| weights[p] * value(p, side(a))).sum::<f64>() * normal[a] * normal[a]
            };
            let expected = of_axis(0) + of_axis(1) + of_axis(2);
            assert!((got - expected).abs() < 1e-7, "{at:?} {normal:?}: {got} {expected}");
        }
    }
}
