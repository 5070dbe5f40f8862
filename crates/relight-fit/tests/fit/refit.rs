//! From one basis to another: what a basis holds comes back, what it doesn't is left by the least squares, and
//! every layout becomes those that it can.

use crate::pictures::{basis_of, direction, random};
use relight_core::basis::Learned;
use relight_core::relighter::relight;
use relight_core::sphere::{Cap, Octahedral, fibonacci_in};
use relight_core::{Basis, CpuLevel, Direction, Layout, Model, RelightingMap, RelightingMaps, Space, Texels};
use relight_fit::{FitError, PlaneStack, Refit, RelitStack, SPAN, fit_map, for_each_span};
use relight_fit::{LeastSquares, LightWeights, Ridge, Sample};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Mutex;

const SIZE: (usize, usize) = (37, 5);

fn model_of(basis: Basis, layout: Layout) -> Model {
    Model { basis, layout, space: Space::Encoded, lights: Vec::new(), figures: None, provenance: None }
}

fn functions(family: &str, count: usize) -> Basis {
    basis_of(family, count, &fibonacci_in(cap(FRAC_PI_2), 60))
}

fn cap(radius: f64) -> Cap {
    Cap { axis: Direction::OUT, radius }
}

/// Functions that differ from plane to plane and channel to channel.
fn learned(planes: usize, channels: usize) -> Basis {
    let square = Octahedral { nodes: 9, hemisphere: true };
    let count = (planes + 1) * channels;
    let of_node = |node: usize| {
        let [x, y, z] = square.direction(node).components();
        (0..count).map(move |f| (0.3 + 0.1 * x * f as f64 - 0.2 * y * z + 0.05 * f as f64 * y * y) as f32)
    };
    let table = (0..square.count()).flat_map(of_node).collect();
    Basis::Learned(Learned::new("pca".to_owned(), planes, channels, square, table).unwrap())
}

/// An asset with a value of its own in every plane and pixel.
fn asset(basis: Basis, layout: Layout) -> RelightingMaps {
    let model = model_of(basis, layout);
    let values = |plane: usize| (0..SIZE.0 * SIZE.1).map(move |x| random(plane, x) as f32).collect();
    let plane = |plane| RelightingMap { scale: 0.8, bias: 0.1, texels: Texels::F32(values(plane)) };
    let planes = (0..model.plane_count()).map(plane).collect();
    RelightingMaps { width: SIZE.0, height: SIZE.1, model, planes }
}

/// `maps` refitted to `basis`, in spans of `span` pixels.
fn refitted(
    maps: &RelightingMaps,
    basis: &Basis,
    layout: Layout,
    domain: Cap,
    span: usize,
) -> RelightingMaps {
    made_by(&Refit::new(&maps.model, basis.clone(), layout, domain, 0.0).unwrap(), maps, span)
}

fn made_by(refit: &Refit, maps: &RelightingMaps, span: usize) -> RelightingMaps {
    let layout = refit.layout;
    let model = model_of(refit.basis.clone(), layout);
    let stride = layout.planes_per_map();
    let planes = Mutex::new(vec![vec![f32::NAN; maps.pixels()]; model.plane_count()]);
    for_each_span(&PlaneStack(maps), refit, CpuLevel::detect(), span, |span| {
        let mut planes = planes.lock().unwrap();
        for (p, plane) in planes.iter_mut().enumerate() {
            let (row, channels, channel) = match p.checked_sub(model.maps() * stride) {
                Some(channel) => (span.base_color, 3, channel),
                None => (&span.maps[p / stride * span.pixels * stride..], stride, p % stride),
            };
            for x in 0..span.pixels {
                plane[span.first + x] = row[x * channels + channel];
            }
        }
        Ok::<(), FitError>(())
    })
    .unwrap();
    let planes = planes.into_inner().unwrap().into_iter();
    let planes = planes.map(|plane| RelightingMap { scale: 1.0, bias: 0.0, texels: Texels::F32(plane) });
    RelightingMaps { width: SIZE.0, height: SIZE.1, planes: planes.collect(), model }
}

/// Largest difference of relit samples over `lights`; grey against colour by each channel.
fn difference(a: &RelightingMaps, b: &RelightingMaps, lights: &[Direction]) -> f32 {
    let of_light = |&light: &Direction| {
        let [a, b] = [a, b].map(|maps| relight(maps, light, CpuLevel::BASELINE));
        let channels = a.channels.max(b.channels);
        let sample = |i: usize| {
            let of = |p: &relight_core::relighter::Picture| {
                p.samples[i / channels * p.channels + (i % channels).min(p.channels - 1)]
            };
            (of(&a) - of(&b)).abs()
        };
        (0..a.width * a.height * channels).map(sample).fold(0.0, f32::max)
    };
    lights.iter().map(of_light).fold(0.0, f32::max)
}

#[test]
fn functions_that_the_new_basis_holds_come_back_in_every_layout() {
    let lights = fibonacci_in(cap(1.5), 23);
    // Polynomials of degree 2 are harmonics of order 2, on the sphere as on half of it.
    let (old, new) = (functions("ptm", 6), functions("sh", 9));
    for (from, to) in [
        (Layout::Rgb, Layout::Rgb),
        (Layout::Lrgb, Layout::Lrgb),
        (Layout::Lrgb, Layout::Rgb),
        (Layout::Grey, Layout::Grey),
        (Layout::Grey, Layout::Rgb),
    ] {
        let maps = asset(old.clone(), from);
        for domain in [cap(FRAC_PI_2), cap(PI)] {
            let back = refitted(&maps, &new, to, domain, SPAN);
            assert!(difference(&maps, &back, &lights) < 3e-5, "{from:?} to {to:?}");
            assert_eq!(back, refitted(&maps, &new, to, domain, 16), "{from:?} to {to:?}: spans show");
        }
        // And the other way they are what they were.
        let there = refitted(&maps, &new, to, cap(PI), SPAN);
        let again = refitted(&there, &old, to, cap(PI), SPAN);
        assert!(difference(&maps, &again, &lights) < 3e-5, "{from:?} to {to:?} and back");
    }
}

#[test]
fn what_is_left_is_orthogonal_to_every_new_function() {
    // Normal equations, over directions of the test's own and light by light.
    for (old, new, radius) in [
        (functions("sh", 25), functions("ptm", 6), FRAC_PI_2),
        (functions("srbf", 20), functions("sh", 9), PI),
        (learned(4, 3), functions("hsh", 9), FRAC_PI_2),
    ] {
        let layout = if matches!(old, Basis::Learned(_)) { Layout::Shared } else { Layout::Rgb };
        let maps = asset(old, layout);
        let back = refitted(&maps, &new, Layout::Rgb, cap(radius), SPAN);
        let lights = fibonacci_in(cap(radius), 5000);
        let (mut products, mut left) = (vec![0.0; new.count()], 0.0f64);
        for &light in &lights {
            let [a, b] = [&maps, &back].map(|maps| relight(maps, light, CpuLevel::BASELINE).samples);
            let mut b_j = vec![0.0; new.count()];
            new.evaluate(light, &mut b_j);
            let residual = f64::from(a[100] - b[100]);
            left += residual * residual;
            products.iter_mut().zip(b_j).for_each(|(sum, b)| *sum += residual * b);
        }
        let count = lights.len() as f64;
        let rms = (left / count).sqrt();
        assert!(rms > 1e-3, "nothing is left to tell");
        for (j, product) in products.iter().enumerate() {
            assert!((product / count).abs() < 0.02 * rms, "{}: {product} of function {j}", new.family().name);
        }
    }
}

#[test]
fn the_same_functions_keep_their_planes_to_the_bit() {
    for (basis, layout) in [
        (functions("hsh", 9), Layout::Rgb),
        (functions("ptm", 6), Layout::Lrgb),
        (functions("srbf", 7), Layout::Grey),
        (learned(5, 3), Layout::Shared),
        (learned(5, 1), Layout::Shared),
    ] {
        let maps = asset(basis.clone(), layout);
        let refit = Refit::new(&maps.model, basis.clone(), layout, cap(PI), 0.0).unwrap();
        assert!(refit.keeps_planes(&maps.model) && refit.condition == 1.0);
        let back = refitted(&maps, &basis, layout, cap(PI), 16);
        assert_eq!(back.coefficient_map().planes, maps.coefficient_map().planes, "{layout:?}");
    }
    let maps = asset(functions("sh", 4), Layout::Lrgb);
    let out = refitted(&maps, &functions("sh", 4), Layout::Rgb, cap(PI), SPAN);
    assert!(difference(&maps, &out, &fibonacci_in(cap(PI), 9)) < 1e-6, "multiplied out");
}

#[test]
fn layouts_that_sums_of_planes_don_t_make_are_refused() {
    let refused = |from: &RelightingMaps, basis: Basis, layout| {
        let error = Refit::new(&from.model, basis, layout, cap(PI), 0.0).unwrap_err();
        assert!(matches!(error, FitError::Layouts { .. }), "{error}");
    };
    let rgb = asset(functions("ptm", 6), Layout::Rgb);
    refused(&rgb, functions("ptm", 6), Layout::Lrgb);
    refused(&rgb, functions("ptm", 6), Layout::Grey);
    refused(&rgb, learned(3, 3), Layout::Shared);
    refused(&asset(learned(2, 3), Layout::Shared), learned(3, 3), Layout::Shared);
    refused(&asset(learned(2, 3), Layout::Shared), functions("ptm", 6), Layout::Grey);
    let error = Refit::new(&rgb.model, functions("sh", 9), Layout::Rgb, cap(PI), 1.5).unwrap_err();
    assert!(matches!(error, FitError::Ridge { .. }), "{error}");
}

#[test]
fn functions_agree_over_the_sphere_only_where_both_know_it_and_light_came_from_below() {
    let radius = |from: &Basis, lights: &[Direction], to: &Basis| {
        let model = Model { lights: lights.to_vec(), ..model_of(from.clone(), Layout::Rgb) };
        Refit::domain(&model, to).radius
    };
    let (sh, ptm, hsh) = (functions("sh", 9), functions("ptm", 6), functions("hsh", 9));
    let (above, below) = (direction(0.1, 0.2, 0.9), direction(0.5, 0.1, -0.3));
    assert_eq!(radius(&sh, &[], &functions("srbf", 9)), PI);
    assert_eq!(radius(&sh, &[above, below], &sh), PI);
    assert_eq!(radius(&sh, &[above], &sh), FRAC_PI_2);
    assert_eq!(radius(&ptm, &[above, below], &sh), FRAC_PI_2);
    assert_eq!(radius(&sh, &[], &hsh), FRAC_PI_2);
    assert_eq!(radius(&learned(2, 3), &[], &sh), FRAC_PI_2);
}

#[test]
fn pictures_of_an_asset_are_those_that_it_relights() {
    let lights = fibonacci_in(cap(1.2), 40);
    let maps = asset(functions("ptm", 6), Layout::Rgb);
    let stack = RelitStack::new(&maps, &lights, Space::Encoded, CpuLevel::detect());
    let sample = Sample::of(&stack).unwrap();
    let uniform = LightWeights::Uniform;
    let fit = LeastSquares::new(functions("ptm", 6), &lights, uniform, Ridge::Fixed(0.0), &sample).unwrap();
    let back = fit_map(&stack, &fit, maps.model.clone(), CpuLevel::detect()).unwrap();
    let expected = maps.coefficient_map();
    let pairs = expected.planes.iter().flatten().zip(back.planes.iter().flatten());
    assert!(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-4);
    // In linear light they are decoded.
    let linear = RelitStack::new(&maps, &lights, Space::Linear, CpuLevel::BASELINE);
    let mut row = vec![0.0; 30];
    let rows = relight_core::Stack::rows(&linear, 33..99).unwrap();
    rows.copy(7, 6, &mut row);
    let encoded = relight(&maps, lights[7], CpuLevel::BASELINE).samples;
    let expected: Vec<f32> = encoded[39..69].iter().map(|&v| relight_core::linear_from_srgb(v)).collect();
    assert_eq!(row, expected);
}

#[test]
fn harmonics_that_half_the_sphere_hardly_tells_apart_stay_small_by_a_ridge() {
    let maps = asset(learned(6, 3), Layout::Shared);
    let lights = fibonacci_in(cap(FRAC_PI_2), 50);
    let fit = |ridge: f64| {
        let refit = Refit::new(&maps.model, functions("sh", 49), Layout::Rgb, cap(FRAC_PI_2), ridge).unwrap();
        assert!(refit.condition > 5e3, "{}", refit.condition);
        let back = made_by(&refit, &maps, SPAN);
        let planes = back.coefficient_map().planes;
        let largest = planes.iter().flatten().fold(0.0f32, |largest, c| largest.max(c.abs()));
        (largest, difference(&maps, &back, &lights))
    };
    let ((largest, exact), (held, near)) = (fit(0.0), fit(1e-6));
    assert!(largest > 3.0 * held, "{largest} without, {held} with a ridge");
    assert!(near < 2.0 * exact + 0.02, "{near} from the old with a ridge, {exact} without");
}
