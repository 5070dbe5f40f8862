//! Exposure factors of pictures that were made brighter and darker.

use crate::pictures::{Pictures, direction, dome, random};
use relight_core::vectors::{dot, unit};
use relight_core::{Direction, LightSet};
use relight_fit::{FitError, exposure_factors, exposure_trial};

const SIZE: (usize, usize) = (67, 59);

/// A bumpy surface of three colours, a third of whose pixels lie in a cast shadow of some lights and shine under others.
fn scaled(lights: &[Direction], factor: impl Fn(usize) -> f64, full_scale: f64) -> Pictures {
    Pictures::of((lights.len(), SIZE, 3), |light, pixel, channel| {
        let normal = unit([0.7 * random(pixel, 1), 0.7 * random(pixel, 2) - 0.15, 1.0]).unwrap();
        let cosine = dot(normal, lights[light].components()).max(0.0);
        let albedo = 0.35 + 0.2 * random(pixel, 3 + channel);
        let spoilt = match (pixel % 3, (light + pixel) % 5) {
            (0, 0) => 0.1,
            (0, 1) => 3.0,
            _ => 1.0,
        };
        (factor(light) * spoilt * cosine * albedo).min(full_scale)
    })
}

/// Fails unless factors are within 2 % of `expected`, whose mean becomes 1.
#[track_caller]
fn assert_near(found: &[Option<f64>], expected: &[f64]) {
    let mean = expected.iter().sum::<f64>() / expected.len() as f64;
    for (light, (found, expected)) in found.iter().zip(expected).enumerate() {
        let found = found.unwrap();
        assert!((found / (expected / mean) - 1.0).abs() < 0.02, "{light}: {found} for {}", expected / mean);
    }
    assert!((found.iter().flatten().sum::<f64>() / found.len() as f64 - 1.0).abs() < 1e-12);
}

#[test]
fn factors_of_all_pictures_come_back_through_shadows_highlights_and_clipping() {
    let lights = dome(30);
    let factors: Vec<f64> = (0..30).map(|i| 1.0 + 0.35 * random(i, 11)).collect();
    let pictures = scaled(&lights, |light| factors[light], 0.6);
    let clipped = pictures.rows.iter().flatten().filter(|value| **value == 0.6).count();
    assert!(clipped > pictures.rows.len() * pictures.rows[0].len() / 50, "the input must contain the hazard");
    let found = exposure_factors(&pictures, &lights, &[0.6; 90]).unwrap();
    assert_near(&found, &factors);
}

#[test]
fn one_picture_off_leaves_the_others_at_one() {
    let lights = dome(30);
    let mut factors = vec![1.0; 30];
    factors[7] = 1.8;
    let pictures = scaled(&lights, |light| factors[light], f64::INFINITY);
    assert_near(&exposure_factors(&pictures, &lights, &[]).unwrap(), &factors);
}

#[test]
fn a_black_picture_has_no_factor_and_two_lights_are_refused() {
    let lights = dome(20);
    let pictures = scaled(&lights, |light| if light == 4 { 0.0 } else { 1.0 }, 1.0);
    let found = exposure_factors(&pictures, &lights, &[1.0; 60]).unwrap();
    assert!(found.iter().enumerate().all(|(light, factor)| factor.is_some() == (light != 4)), "{found:?}");
    let two = [direction(0.1, 0.2, 1.0), direction(-0.4, 0.1, 1.0)];
    let refused = exposure_factors(&scaled(&two, |_| 1.0, 1.0), &two, &[1.0; 6]).unwrap_err();
    assert!(matches!(refused, FitError::TooFewForNormals { lights: 2 }));
}

/// A nearly flat, glossy surface: what shines into the lens does so in all pixels of a picture alike.
fn flat(lights: &[Direction], factor: impl Fn(usize) -> f64) -> Pictures {
    Pictures::of((lights.len(), SIZE, 3), |light, pixel, channel| {
        let normal = unit([0.02 * random(pixel, 1), 0.02 * random(pixel, 2), 1.0]).unwrap();
        let [x, y, z] = lights[light].components();
        let halfway = unit([x, y, z + 1.0]).unwrap();
        let gloss = dot(normal, halfway).max(0.0).powi(40);
        let albedo = 0.35 + 0.2 * random(pixel, 3 + channel);
        factor(light) * (albedo * dot(normal, [x, y, z]).max(0.0) + 0.5 * gloss)
    })
}

#[test]
fn factors_are_taken_where_lamps_flickered_and_not_where_the_surface_makes_them() {
    let lights = dome(40);
    let set = LightSet::from_directions(lights.clone());
    let trial = |pictures: &Pictures| {
        let found = exposure_factors(pictures, &lights, &[]).unwrap();
        let factors: Vec<f64> = found.iter().map(|factor| factor.unwrap_or(1.0)).collect();
        let off = factors.iter().map(|factor| (factor - 1.0).abs()).fold(0.0, f64::max);
        (exposure_trial(&set, &pictures.sample(), &factors).unwrap().unwrap(), off)
    };
    let flicker = |light| 1.0 + 0.25 * random(light, 11);
    for pictures in [scaled(&lights, flicker, 10.0), flat(&lights, flicker)] {
        let (trial, _) = trial(&pictures);
        assert!(trial.is_accepted(), "{trial:?}");
    }
    let (even, off) = trial(&flat(&lights, |_| 1.0));
    assert!(off > 0.15 && !even.is_accepted(), "{even:?}, factors {off} off");
    let (even, off) = trial(&scaled(&lights, |_| 1.0, 10.0));
    assert!(off < 0.02 && !even.is_accepted(), "{even:?}, factors {off} off");
    let one = dome(1);
    let none = exposure_trial(&LightSet::from_directions(one.clone()), &flat(&one, |_| 1.0).sample(), &[1.0]);
    assert_eq!(none.unwrap(), None);
}
