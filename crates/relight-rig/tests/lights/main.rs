//! Lights: against golden values, quadrature, differences, and each other.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

mod discs;
mod golden;
mod projector;
mod rows;
mod spheres;

use relight_rig::{Light, Probe, Source};

/// A colour whose channels differ, so that a swap shows.
const COLOR: [f64; 3] = [1.0, 0.5, 3.0];

fn light(source: Source) -> Light {
    Light { name: String::new(), source, color: COLOR }
}

fn sphere(centre: [f64; 3], radius: f64) -> Light {
    light(Source::Sphere { centre, radius })
}

fn disc(centre: [f64; 3], normal: [f64; 3], radius: f64) -> Light {
    light(Source::Disc { centre, normal, radius })
}

/// Numbers that look random and are always the same.
struct Random(u64);

impl Random {
    /// -1 to 1.
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> [f64; 3] {
        [self.number(), self.number(), self.number()]
    }

    fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = self.vector();
            let length = dot(v, v).sqrt();
            if length > 0.1 && length < 1.0 {
                return v.map(|c| c / length);
            }
        }
    }

    /// A light of any kind, none of which touches the ball of radius 1 around the origin.
    fn light(&mut self) -> Light {
        let (away, distance) = (self.direction(), 4.0 + 2.0 * self.number());
        let place = away.map(|c| c * distance);
        let radius = 0.3 + 0.2 * self.number();
        let color = self.vector().map(f64::abs);
        let source = match (self.number() * 2.5 + 2.5) as u32 {
            0 => Source::Sphere { centre: place, radius },
            1 => Source::Disc { centre: place, normal: self.direction(), radius },
            2 => Source::Point { position: place, nearest: 0.1 },
            3 => Source::Directional { direction: away },
            _ => Source::Probe(Probe { coefficients: (0..25).map(|_| self.vector()).collect() }),
        };
        Light { name: String::new(), source, color }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The largest component of a list of colours.
fn largest(list: &[[f64; 3]]) -> f64 {
    list.iter().flatten().fold(0.0, |a, c| a.max(c.abs()))
}

/// The largest difference of two lists.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |worst, (a, b)| worst.max((a - b).abs()))
}
