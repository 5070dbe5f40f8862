//! A target's axes in those of the scene, and what they make of a rig.

use super::HARMONICS;
use crate::{AxisFunction, Frame};

/// Each axis of a target along one of the scene's, there or back; left-handed ones too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// For the target's x, y, z: which axis of the scene, and 1 or -1.
    along: [(usize, f64); 3],
}

impl Axes {
    /// `-x,y,z`: what the target's x, y and z are in the scene. `None` where that makes no sense.
    pub fn parse(text: &str) -> Option<Self> {
        let of_word = |word: &str| {
            let (sign, letter) = word.strip_prefix('-').map_or((1.0, word), |letter| (-1.0, letter));
            Some((["x", "y", "z"].iter().position(|&axis| axis == letter)?, sign))
        };
        let along: [_; 3] = text.split(',').map(of_word).collect::<Option<Vec<_>>>()?.try_into().ok()?;
        (0..3).all(|axis| along.iter().any(|&(of, _)| of == axis)).then_some(Self { along })
    }

    /// What [`Self::parse`] understands.
    pub fn text(&self) -> String {
        let words = self
            .along
            .map(|(axis, sign)| format!("{}{}", if sign < 0.0 { "-" } else { "" }, ["x", "y", "z"][axis]));
        words.join(",")
    }

    /// A vector of the scene in the target's axes.
    pub fn vector(&self, of_scene: [f64; 3]) -> [f64; 3] {
        self.along.map(|(axis, sign)| sign * of_scene[axis])
    }

    /// A matrix that acts on vectors of the scene, as one that acts on those of the target; rows.
    pub fn matrix(&self, of_scene: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
        self.along.map(|(row, down)| self.along.map(|(column, across)| down * across * of_scene[row][column]))
    }

    /// A box of the scene in the target's axes.
    pub fn frame(&self, frame: &Frame) -> Frame {
        let half_extent = self.along.map(|(axis, _)| frame.half_extent[axis]);
        Frame { centre: self.vector(frame.centre), half_extent, radius: frame.radius }
    }

    /// A parameter's product in the target's axes, and 1 or -1 by which its harmonics are multiplied to suit.
    pub fn product(&self, product: [AxisFunction; 3]) -> ([AxisFunction; 3], f64) {
        let mut of_parameter = 1.0;
        let product = self.along.map(|(axis, sign)| match product[axis] {
            AxisFunction::Hat { node, nodes } if sign < 0.0 => {
                AxisFunction::Hat { node: nodes - 1 - node, nodes }
            }
            AxisFunction::Coordinate => {
                of_parameter *= sign;
                AxisFunction::Coordinate
            }
            function => function,
        });
        (product, of_parameter)
    }

    /// Harmonics (by l * l + l + m with Condon-Shortley phase) that give at a direction in the target's axes what those given
    /// do in the scene's.
    ///
    /// Band 1 is a vector and band 2 a symmetric matrix without trace, whose axes are exchanged.
    pub fn harmonics(&self, of_scene: &[[f64; 3]; HARMONICS]) -> [[f64; 3]; HARMONICS] {
        let mut turned = *of_scene;
        for c in 0..3 {
            let l = |i: usize| of_scene[i][c];
            let vector = self.vector([-l(3), -l(1), l(2)]);
            let third = l(6) / 3f64.sqrt();
            let matrix =
                [[l(8) - third, l(4), -l(7)], [l(4), -l(8) - third, -l(5)], [-l(7), -l(5), 2.0 * third]];
            let turned_matrix = self
                .along
                .map(|(row, down)| self.along.map(|(column, across)| down * across * matrix[row][column]));
            let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = turned_matrix;
            let band_2 = [xy, -yz, zz * 3f64.sqrt() / 2.0, -xz, (xx - yy) / 2.0];
            for (i, value) in (1..).zip([-vector[1], vector[2], -vector[0]].into_iter().chain(band_2)) {
                turned[i][c] = value;
            }
        }
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluation::{irradiance, lopsided, normals};
    use super::*;

    #[test]
    fn turned_harmonics_and_products_give_what_they_gave() {
        let hat = |node| AxisFunction::Hat { node, nodes: 3 };
        let products = [
            [hat(0), AxisFunction::Coordinate, AxisFunction::One],
            [AxisFunction::Coordinate, hat(1), hat(2)],
        ];
        for text in ["x,y,z", "-x,y,z", "x,z,-y", "-z,-x,y", "y,x,z"] {
            let axes = Axes::parse(text).unwrap();
            assert_eq!(axes.text(), text);
            let turned = axes.harmonics(&lopsided());
            for normal in normals() {
                let (got, expected) =
                    (irradiance(&turned, axes.vector(normal)), irradiance(&lopsided(), normal));
                assert!((0..3).all(|c| (got[c] - expected[c]).abs() < 1e-12), "{text}: {got:?} {expected:?}");
                for product in products {
                    let (turned, sign) = axes.product(product);
                    let weight = |product: [AxisFunction; 3], at: [f64; 3]| {
                        (0..3).map(|axis| product[axis].value(at[axis])).product::<f64>()
                    };
                    let (got, expected) =
                        (sign * weight(turned, axes.vector(normal)), weight(product, normal));
                    assert!((got - expected).abs() < 1e-15, "{text} {product:?}: {got} {expected}");
                }
            }
        }
        for text in ["", "x,y", "x,x,z", "x,y,z,x", "x,y,w", "--x,y,z"] {
            assert_eq!(Axes::parse(text), None, "{text}");
        }
    }
}
