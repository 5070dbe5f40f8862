//! Pictures of awkward values, one a test (docs/stability.md).

use crate::pictures::{Pictures, basis_of, direction, dome, fit_of, model_of, random, relit};
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Basis, CoefficientMap, CpuLevel, Direction, Layout};
use relight_fit::{
    FitError, LeastSquares, LightWeights, Ridge, coefficient_distributions, coefficient_sample, fit_map,
};

const LAYOUTS: [(Layout, usize); 3] = [(Layout::Grey, 1), (Layout::Rgb, 3), (Layout::Lrgb, 3)];

/// Size of all pictures here: a tile and a bit.
const SIZE: (usize, usize) = (41, 59);

fn map_of(
    basis: &Basis,
    lights: &[Direction],
    ridge: Ridge,
    pictures: &Pictures,
    layout: Layout,
) -> CoefficientMap {
    let fit = fit_of(basis, lights, LightWeights::Voronoi, ridge, pictures);
    fit_map(pictures, &fit, model_of(basis, layout), CpuLevel::detect()).unwrap()
}

fn constant(lights: usize, channels: usize, color: [f64; 3]) -> Pictures {
    Pictures::of((lights, SIZE, channels), |_, _, channel| color[channel])
}

#[test]
fn black_pictures_are_black_and_their_base_colour_is_white() {
    let lights = dome(24);
    for (name, count) in [("ptm", 6), ("sh", 9), ("hsh", 9), ("srbf", 12)] {
        let basis = basis_of(name, count, &lights);
        for (layout, channels) in LAYOUTS {
            for ridge in [Ridge::Auto, Ridge::Fixed(0.0)] {
                let black = constant(24, channels, [0.0; 3]);
                let map = map_of(&basis, &lights, ridge, &black, layout);
                for (p, plane) in map.planes.iter().enumerate() {
                    let expected = if layout == Layout::Lrgb && p >= count { 1.0 } else { 0.0 };
                    assert!(plane.iter().all(|value| *value == expected), "{name} {layout:?} plane {p}");
                }
            }
        }
    }
}

#[test]
fn a_pixel_lit_in_one_picture_only_has_a_base_colour() {
    // Between black pixels: sums of products start at 0 for every pixel.
    let lights = dome(24);
    let basis = basis_of("ptm", 6, &lights);
    let color = [0.1, 0.4, 0.2];
    let pictures =
        Pictures::of(
            (24, SIZE, 3),
            |light, pixel, channel| {
                if light == 7 && pixel % 3 == 1 { color[channel] } else { 0.0 }
            },
        );
    let map = map_of(&basis, &lights, Ridge::Fixed(0.0), &pictures, Layout::Lrgb);
    for pixel in 0..SIZE.0 * SIZE.1 {
        for (channel, component) in color.iter().enumerate() {
            let expected = if pixel % 3 == 1 { component / 0.4 } else { 1.0 };
            let found = f64::from(map.planes[6 + channel][pixel]);
            assert!((found - expected).abs() < 1e-6, "pixel {pixel} channel {channel}: {found} {expected}");
        }
    }
}

#[test]
fn constant_pictures_stay_constant_under_every_light() {
    let lights = dome(50);
    let between = fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 23);
    for color in [[1.0; 3], [0.25, 0.5, 0.75], [0.9, 0.0, 1e-3]] {
        for (name, count) in [("ptm", 6), ("ptm", 15), ("sh", 9), ("hsh", 9), ("hsh", 16)] {
            let basis = basis_of(name, count, &lights);
            for (layout, channels) in LAYOUTS {
                let pictures = constant(50, channels, color);
                // With a ridge a constant falls short by about ridge s0^2 / s^2.
                for (ridge, bound) in [(Ridge::Fixed(0.0), 2e-5), (Ridge::Auto, 0.02)] {
                    let map = map_of(&basis, &lights, ridge, &pictures, layout);
                    for light in &between {
                        for pixel in [0, 1000, SIZE.0 * SIZE.1 - 1] {
                            for (channel, component) in color.iter().enumerate().take(channels) {
                                let error = (relit(&map, *light, pixel, channel) - component).abs();
                                assert!(error < bound, "{name} {count} {layout:?} {ridge:?}: {error}");
                            }
                        }
                    }
                    if layout == Layout::Lrgb {
                        let largest = color.iter().fold(0.0f64, |a, b| a.max(*b));
                        for channel in 0..3 {
                            let base = f64::from(map.planes[count + channel][17]);
                            assert!((base - color[channel] / largest).abs() < 1e-6, "{color:?}: {base}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn values_far_above_one_are_linear() {
    // A factor of 2^14 scales every f32 exactly: the same bits but for the exponent.
    let lights = dome(30);
    let basis = basis_of("srbf", 12, &lights);
    for (layout, channels) in LAYOUTS {
        let of = |factor: f64| {
            Pictures::of((30, SIZE, channels), |light, pixel, channel| {
                factor * (0.5 + 0.5 * random(light * 3 + channel, pixel))
            })
        };
        let map = map_of(&basis, &lights, Ridge::Auto, &of(1.0), layout);
        let bright = map_of(&basis, &lights, Ridge::Auto, &of(16_384.0), layout);
        for (p, (plane, bright)) in map.planes.iter().zip(&bright.planes).enumerate() {
            let factor = if layout == Layout::Lrgb && p >= 12 { 1.0 } else { 16_384.0 };
            let same = plane.iter().zip(bright).all(|(a, b)| (a * factor).to_bits() == b.to_bits());
            assert!(same, "{layout:?} plane {p}");
        }
    }
    // And 1e4 to rounding.
    let sun = constant(30, 3, [1e4, 2e4, 5e3]);
    let map = map_of(&basis_of("sh", 9, &lights), &lights, Ridge::Fixed(0.0), &sun, Layout::Lrgb);
    let value = relit(&map, direction(0.2, 0.3, 0.9), 5, 1);
    assert!((value - 2e4).abs() < 1.0, "{value}");
}

#[test]
fn base_colours_from_1e_minus_15_to_1e15() {
    // Sums of products of values, as the base colour needs them, are f32: they end at 3e38 and 1e-38.
    let lights = dome(30);
    let basis = basis_of("ptm", 6, &lights);
    for value in [1e-15, 1e-9, 1e9, 1e15] {
        let pictures = constant(30, 3, [value, 0.5 * value, 0.25 * value]);
        let map = map_of(&basis, &lights, Ridge::Fixed(0.0), &pictures, Layout::Lrgb);
        assert!(map.planes.iter().flatten().all(|c| c.is_finite()), "{value:e}");
        let found = relit(&map, direction(0.2, 0.3, 0.9), 5, 0);
        assert!((found / value - 1.0).abs() < 1e-4, "{value:e}: {found:e}");
    }
}

#[test]
fn grey_pictures_have_no_base_colour() {
    let lights = dome(12);
    let pictures = constant(12, 1, [0.5; 3]);
    let fit: LeastSquares =
        fit_of(&basis_of("ptm", 6, &lights), &lights, LightWeights::Voronoi, Ridge::Auto, &pictures);
    let refused = fit_map(&pictures, &fit, model_of(&fit.basis, Layout::Lrgb), CpuLevel::detect());
    assert!(matches!(refused, Err(FitError::GreyHasNoColor)));
    let check = || Ok::<(), FitError>(());
    let refused = coefficient_distributions(&pictures, (&fit, Layout::Lrgb), CpuLevel::detect(), check);
    assert!(matches!(refused, Err(FitError::GreyHasNoColor)));
    let refused = coefficient_sample(&pictures, (&fit, Layout::Lrgb), CpuLevel::detect(), 9);
    assert!(matches!(refused, Err(FitError::GreyHasNoColor)));
}

#[test]
fn a_coefficient_that_is_no_number_is_named_by_plane_and_pixel() {
    let lights = dome(24);
    let basis = basis_of("ptm", 6, &lights);
    let calm = Pictures::of((24, SIZE, 3), |light, pixel, _| 0.5 + 0.5 * random(light, pixel));
    let fit = fit_of(&basis, &lights, LightWeights::Voronoi, Ridge::Fixed(0.0), &calm);
    // Finite values that the first function's row of the solution adds up to more than f32 holds.
    let bad = SIZE.0 * 57 + 13;
    let pictures = Pictures::of((24, SIZE, 3), |light, pixel, channel| match (pixel, channel) {
        (pixel, 1) if pixel == bad => 3e38 * fit.solution[light].signum(),
        _ => f64::from(calm.rows[light][pixel * 3 + channel]),
    });
    let check = || Ok::<(), FitError>(());
    let found = coefficient_distributions(&pictures, (&fit, Layout::Rgb), CpuLevel::detect(), check).unwrap();
    let map = fit_map(&pictures, &fit, model_of(&basis, Layout::Rgb), CpuLevel::detect()).unwrap();
    let mut named = 0;
    for (plane, distribution) in found.iter().enumerate() {
        let expected = map.planes[plane].iter().position(|value| !value.is_finite());
        assert_eq!(distribution.first_not_finite(), expected, "plane {plane}");
        assert!(expected.is_none_or(|pixel| pixel == bad && plane % 3 == 1), "plane {plane}");
        named += usize::from(expected.is_some());
    }
    assert!(named > 0);
}
