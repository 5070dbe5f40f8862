//! Normals, albedo and heights of surfaces that are known.

use crate::pictures::{Pictures, direction, dome, random};
use relight_core::Direction;
use relight_core::vectors::{dot, unit};
use relight_fit::{
    FitError, NormalMap, NormalMethod, PhotometricStereo, heights_from_normals, normal_error, normal_map,
};

const SIZE: (usize, usize) = (97, 89);

/// A normal of its own for every pixel, up to some 50 degrees off the view.
fn normal_of(pixel: usize) -> [f64; 3] {
    unit([0.8 * random(pixel, 1), 0.8 * random(pixel, 2) - 0.1, 1.0]).unwrap()
}

fn albedo_of(pixel: usize, channel: usize) -> f64 {
    0.3 + 0.25 * random(pixel, 3 + channel)
}

/// Matte pictures in which the lights in `spoilt` of each pixel hold other values.
fn pictures(lights: &[Direction], channels: usize, spoilt: impl Fn(usize, usize) -> Option<f64>) -> Pictures {
    Pictures::of((lights.len(), SIZE, channels), |light, pixel, channel| {
        let cosine = dot(normal_of(pixel), lights[light].components()).max(0.0);
        spoilt(light, pixel).unwrap_or(cosine * albedo_of(pixel, channel))
    })
}

fn map_of(pictures: &Pictures, lights: &[Direction], method: NormalMethod) -> NormalMap {
    let full_scale = vec![1.0; lights.len() * pictures.channels];
    normal_map(pictures, lights, method, &full_scale, || Ok::<(), FitError>(())).unwrap()
}

/// Mean angle to the true normals in degrees.
fn error_deg(map: &NormalMap) -> f64 {
    let truth: Vec<[f32; 3]> = (0..SIZE.0 * SIZE.1).map(|pixel| normal_of(pixel).map(|c| c as f32)).collect();
    normal_error(&map.normals, &truth).unwrap().mean.to_degrees()
}

#[test]
fn matte_surfaces_give_their_normals_and_albedos() {
    let lights = dome(24);
    for channels in [1, 3] {
        let map = map_of(&pictures(&lights, channels, |_, _| None), &lights, NormalMethod::Robust);
        assert!(map.found.iter().all(|&found| found));
        assert!(error_deg(&map) < 1e-3, "{}", error_deg(&map));
        for (at, found) in map.albedo.iter().enumerate() {
            let expected = albedo_of(at / channels, at % channels);
            assert!((f64::from(*found) - expected).abs() < 1e-5, "sample {at}: {found} for {expected}");
        }
    }
}

#[test]
fn shadows_and_highlights_are_left_out() {
    let lights = dome(40);
    // A fifth in cast shadow, a tenth in highlights.
    let spoilt = |light: usize, pixel: usize| match random(light + 100, pixel) {
        chance if chance < -0.6 => Some(0.02),
        chance if chance > 0.8 => Some(0.9),
        _ => None,
    };
    let pictures = pictures(&lights, 3, spoilt);
    let robust = map_of(&pictures, &lights, NormalMethod::Robust);
    let plain = map_of(&pictures, &lights, NormalMethod::LeastSquares);
    let (robust, plain) = (error_deg(&robust), error_deg(&plain));
    println!("robust {robust:.2}, least squares {plain:.2} degrees");
    assert!(robust < 1.0 && plain > 8.0, "{robust} {plain}");
}

#[test]
fn saturated_values_say_nothing() {
    let lights = dome(9);
    let mut stereo = PhotometricStereo::new(&lights, NormalMethod::Robust).unwrap();
    let normal = [0.6, 0.0, 0.8];
    let exposed = |gain: f64| -> Vec<f32> {
        lights.iter().map(|l| (gain * dot(normal, l.components()).max(0.0)).min(1.0) as f32).collect()
    };
    let values = exposed(1.3);
    assert!(values.iter().filter(|&&value| value == 1.0).count() >= 2, "the input must contain the hazard");
    let found = stereo.surface_of(&values, 1, &[1.0; 9]).unwrap();
    assert!(
        (dot(found.normal, normal) - 1.0).abs() < 1e-9 && (found.albedo[0] - 1.3).abs() < 1e-5,
        "{found:?}"
    );
    let taken = stereo.surface_of(&values, 1, &[]).unwrap();
    assert!(dot(taken.normal, normal) < 0.9999, "{taken:?}");
    assert_eq!(stereo.surface_of(&[1.0; 9], 1, &[1.0; 9]), None);
}

#[test]
fn black_pixels_have_no_normal_and_constant_ones_have_one() {
    let lights = dome(9);
    for method in [NormalMethod::Robust, NormalMethod::LeastSquares] {
        let mut stereo = PhotometricStereo::new(&lights, method).unwrap();
        assert_eq!(stereo.surface_of(&[0.0; 9], 1, &[1.0; 9]), None);
        assert_eq!(stereo.surface_of(&[-0.5; 27], 3, &[]), None);
        let constant = stereo.surface_of(&[0.5; 27], 3, &[]).unwrap();
        assert!(
            constant.normal[2] > 0.9 && constant.albedo.iter().all(|a| (0.3..0.9).contains(a)),
            "{constant:?}"
        );
    }
    let half = pictures(&lights, 3, |_, pixel| (pixel % 2 == 1).then_some(0.0));
    let map = map_of(&half, &lights, NormalMethod::Robust);
    for (pixel, normal) in map.normals.iter().enumerate() {
        assert_eq!(map.found[pixel], pixel % 2 == 0);
        assert!(pixel % 2 == 0 || (*normal == [0.0, 0.0, 1.0] && map.albedo[3 * pixel] == 0.0), "{pixel}");
    }
}

#[test]
fn three_lights_are_enough_and_two_or_a_plane_of_them_are_not() {
    let lights = [direction(0.5, 0.1, 0.8), direction(-0.4, 0.4, 0.8), direction(0.0, -0.6, 0.7)];
    let mut stereo = PhotometricStereo::new(&lights, NormalMethod::Robust).unwrap();
    let normal = unit([0.1, -0.2, 1.0]).unwrap();
    let values: Vec<f32> = lights.iter().map(|l| dot(normal, l.components()) as f32).collect();
    let found = stereo.surface_of(&values, 1, &[]).unwrap();
    assert!(dot(found.normal, normal) > 1.0 - 1e-12, "{found:?}");
    let refused = PhotometricStereo::new(&lights[..2], NormalMethod::Robust).unwrap_err();
    assert!(matches!(refused, FitError::TooFewForNormals { lights: 2 }));
    // Three digits of a light file off the plane.
    let plane: Vec<Direction> =
        (0..20).map(|i| direction(0.1 * f64::from(i) - 1.0, 0.0005 * f64::from(i % 2), 0.7)).collect();
    let refused = PhotometricStereo::new(&plane, NormalMethod::LeastSquares).unwrap_err();
    assert!(matches!(refused, FitError::CoplanarLights { lights: 20 }));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let lights = dome(17);
    let pictures = pictures(&lights, 3, |light, pixel| (random(light, pixel) > 0.6).then_some(0.0));
    let work = || {
        let map = map_of(&pictures, &lights, NormalMethod::Robust);
        let heights = heights_from_normals(&map, || Ok::<(), FitError>(())).unwrap();
        (map, heights)
    };
    let on = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work);
    let expected = on(1);
    for threads in [2, 5] {
        assert!(on(threads) == expected, "{threads} threads");
    }
}

/// The normals of `height`, of which `unknown` has none, and how far the heights found from them are off.
fn height_error(
    (width, height): (usize, usize),
    slopes: impl Fn(f64, f64) -> [f64; 3],
    unknown: impl Fn(usize, usize) -> bool,
) -> f64 {
    let place = |at: usize| ((at % width) as f64, -((at / width) as f64));
    let surface = |at: usize| slopes(place(at).0, place(at).1);
    let normals = (0..width * height).map(|at| {
        let [_, p, q] = surface(at);
        unit([-p, -q, 1.0]).unwrap().map(|c| c as f32)
    });
    let found: Vec<bool> = (0..width * height).map(|at| !unknown(at % width, at / width)).collect();
    let normals = normals.zip(&found).map(|(n, &found)| if found { n } else { [0.0, 0.0, 1.0] }).collect();
    let map = NormalMap { width, height, channels: 1, normals, albedo: Vec::new(), found: found.clone() };
    let heights = heights_from_normals(&map, || Ok::<(), FitError>(())).unwrap();
    let mean: f64 = heights.iter().map(|h| f64::from(*h)).sum::<f64>() / heights.len() as f64;
    assert!(mean.abs() < 1e-3, "mean {mean}");
    let differences: Vec<f64> = (0..width * height)
        .filter(|&at| found[at])
        .map(|at| f64::from(heights[at]) - surface(at)[0])
        .collect();
    let offset = differences.iter().sum::<f64>() / differences.len() as f64;
    differences.iter().fold(0.0, |worst, d| worst.max((d - offset).abs()))
}

#[test]
fn heights_of_slants_and_hills_come_back() {
    let known = |_, _| false;
    let slant = |x: f64, y: f64| [0.3 * x - 0.7 * y, 0.3, -0.7];
    for size in [(64, 64), (131, 47), (1, 40), (33, 1), (1, 1), (5, 200)] {
        let error = height_error(size, slant, known);
        assert!(error < 1e-3, "{size:?}: {error}");
    }
    // A lopsided hill; its differences are the mean slopes up to third derivatives.
    let hill = |x: f64, y: f64| {
        let (u, v) = (x / 40.0 - 1.0, y / 30.0 + 1.5);
        let h = 12.0 * libm::exp(-u * u - v * v);
        [h, -2.0 * u * h / 40.0, -2.0 * v * h / 30.0]
    };
    let error = height_error((150, 121), hill, known);
    assert!(error < 5e-3, "{error}");
    // A hole without normals in a slant: around it nothing bends by more than the weight of what is unknown.
    let error = height_error((90, 80), slant, |x, y| (30..40).contains(&x) && (20..50).contains(&y));
    assert!(error < 0.05, "{error}");
}

#[test]
fn heights_take_no_more_iterations_for_larger_pictures() {
    let iterations = |side: usize, hole: usize| {
        let normal = |at: usize| {
            let (x, y) = ((at % side) as f64, (at / side) as f64);
            unit([0.6 * libm::sin(0.05 * x + 0.3), 0.4 * random(at, 7) + 0.002 * y, 1.0])
                .unwrap()
                .map(|c| c as f32)
        };
        let found = (0..side * side).map(|at| at % side >= hole || at / side >= hole).collect();
        let normals = (0..side * side).map(normal).collect();
        let map = NormalMap { width: side, height: side, channels: 1, normals, albedo: Vec::new(), found };
        let count = std::cell::Cell::new(0);
        let counted = || {
            count.set(count.get() + 1);
            Ok::<(), FitError>(())
        };
        heights_from_normals(&map, counted).unwrap();
        count.get()
    };
    let counts = [(40, 0), (640, 0), (640, 300)].map(|(side, hole)| iterations(side, hole));
    println!("{counts:?} iterations");
    assert!(counts[1] < 16 && counts[2] < 32, "{counts:?}");
}
