//! Lights as a point sees them.

/// A light of a scene, in the scene's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// For people.
    pub name: String,
    /// What it is and where.
    pub source: Source,
    /// Linear R, G, B, not negative: radiance of spheres and discs; radiant intensity of points; irradiance at normal
    /// incidence of directional lights; factor of a probe's coefficients.
    pub color: [f64; 3],
}

/// Kinds of lights.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A sphere that shines alike all over. Points inside see what points on it see: half of all directions shine.
    Sphere {
        /// Its middle.
        centre: [f64; 3],
        /// Above 0.
        radius: f64,
    },
    /// A disc that shines on one side, alike in all directions (Lambertian).
    Disc {
        /// Its middle.
        centre: [f64; 3],
        /// Unit vector out of the side that shines.
        normal: [f64; 3],
        /// Above 0.
        radius: f64,
    },
    /// A point that shines alike in all directions.
    Point {
        /// Where it stands.
        position: [f64; 3],
        /// Above 0: points closer than this are lit as from this distance.
        nearest: f64,
    },
    /// From one direction everywhere.
    Directional {
        /// Unit vector towards the light.
        direction: [f64; 3],
    },
    /// From all around, alike everywhere.
    Probe(Probe),
}

/// Radiance from all around, in spherical harmonics.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// R, G, B of the radiance's coefficients (not of irradiance) by l * l + l + m with Condon-Shortley phase: 1, 4, 9 ..
    /// 121 of them.
    pub coefficients: Vec<[f64; 3]>,
}
