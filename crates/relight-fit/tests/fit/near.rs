//! Near lamps, held to a fit of its own for every pixel.

use crate::pictures::{Pictures, basis_of, fit_of, random, weights_of};
use relight_core::{Basis, CpuLevel, Direction, Layout, NO_SURFACE, PositionMap, Space, Stack};
use relight_fit::{
    FitError, LeastSquares, LevelledStack, LightWeights, MOST_OFF, NearLamps, NearSolutions, NearSurface,
    PixelFit, Ridge, Vignetting, for_each_span, near_bytes, near_least_squares,
};
use std::sync::Mutex;

/// Lamps on a dome of radius 13 over the plane, more or less.
fn dome(count: usize) -> Vec<[f64; 3]> {
    let of = |(i, direction): (usize, Direction)| {
        let radius = 13.0 + 2.0 * random(7, i);
        [direction.x(), direction.y(), direction.z()].map(|c| radius * c)
    };
    crate::pictures::dome(count).into_iter().enumerate().map(of).collect()
}

/// A plane 10 wide.
fn plane((width, height): (usize, usize)) -> NearSurface {
    let pixel = 10.0 / width as f64;
    let middle = |edge: usize| 0.5 * pixel * (edge as f64 - 1.0);
    NearSurface::Plane { width, height, first: [-middle(width), middle(height)], pixel }
}

/// Bumps on a slope, 10 wide, with a hole.
fn bumps((width, height): (usize, usize)) -> NearSurface {
    let point = |pixel: usize| match pixel {
        17 | 18 => NO_SURFACE,
        _ => {
            let (x, y) = ((pixel % width) as f32, (pixel / width) as f32);
            let scale = 10.0 / width as f32;
            [scale * x - 5.0, 3.0 - scale * y, 0.1 * scale * x + 0.8 * random(5, pixel) as f32]
        }
    };
    NearSurface::Points(PositionMap { width, height, points: (0..width * height).map(point).collect() })
}

fn points_of(lamps: &NearLamps) -> Vec<[f64; 3]> {
    lamps.position_map().points.iter().map(|point| point.map(f64::from)).collect()
}

fn way(lamp: [f64; 3], point: [f64; 3]) -> ([f64; 3], f64) {
    let way = [0, 1, 2].map(|axis| lamp[axis] - point[axis]);
    (way, way.iter().map(|c| c * c).sum())
}

/// The basis at every lamp from `point`.
fn design(basis: &Basis, lamps: &[[f64; 3]], point: [f64; 3]) -> Vec<Vec<f64>> {
    let row = |lamp: &[f64; 3]| {
        let ([x, y, z], _) = way(*lamp, point);
        weights_of(basis, Direction::new(x, y, z).unwrap())
    };
    lamps.iter().map(row).collect()
}

/// `argmin_c sum of w (a c - y)^2 + ridge |c|^2` by elimination in the normal equations.
fn solved(design: &[Vec<f64>], weights: &[f64], ridge: f64, values: &[f64]) -> Vec<f64> {
    let k = design[0].len();
    let rows = || design.iter().zip(weights).zip(values);
    let mut system: Vec<Vec<f64>> = (0..k)
        .map(|i| {
            let square = |j: usize| rows().map(|((a, w), _)| w * a[i] * a[j]).sum::<f64>();
            let right = rows().map(|((a, w), y)| w * a[i] * y).sum::<f64>();
            (0..k).map(|j| square(j) + if i == j { ridge } else { 0.0 }).chain([right]).collect()
        })
        .collect();
    for i in 0..k {
        let pivot: Vec<f64> = system[i].iter().map(|c| c / system[i][i]).collect();
        for (at, row) in system.iter_mut().enumerate().filter(|(at, _)| *at != i) {
            let factor = if at == i { 0.0 } else { row[i] };
            row.iter_mut().zip(&pivot).for_each(|(c, p)| *c -= factor * p);
        }
        system[i] = pivot;
    }
    system.into_iter().map(|row| row[k]).collect()
}

/// Coefficients by function, then sample, and base colours.
fn coefficients(
    stack: &dyn Stack,
    fit: PixelFit<'_>,
    level: CpuLevel,
    span: usize,
    functions: usize,
) -> (Vec<Vec<f32>>, Vec<f32>) {
    let layers = Mutex::new((vec![Vec::new(); functions], vec![0.0; 3 * stack.pixels()]));
    for_each_span(stack, fit, level, span, |span| {
        let (maps, colors) = &mut *layers.lock().unwrap();
        for (map, row) in maps.iter_mut().zip(span.maps.chunks_exact(span.maps.len() / functions)) {
            let channels = row.len() / span.pixels;
            map.resize(stack.pixels() * channels, 0.0f32);
            map[span.first * channels..][..row.len()].copy_from_slice(row);
        }
        colors[3 * span.first..][..span.base_color.len()].copy_from_slice(span.base_color);
        Ok::<(), FitError>(())
    })
    .unwrap();
    layers.into_inner().unwrap()
}

fn largest_singular(fit: &LeastSquares) -> f64 {
    fit.decomposition.singular_values[0]
}

#[test]
fn between_nodes_fits_are_those_of_every_pixel_within_the_bound() {
    let positions = dome(40);
    for (surface, vignetting) in
        [(plane((96, 60)), Some(Vignetting { focal: 80.0, axis: [40.0, 31.0] })), (bumps((48, 33)), None)]
    {
        let size = surface.size();
        let lamps = NearLamps::new(positions.clone(), surface, vignetting).unwrap();
        let points = points_of(&lamps);
        let level = |light: usize, pixel: usize| {
            let fall = way(positions[light], points[pixel]).1 / lamps.distances()[light].powi(2);
            fall / lamps.transmission(pixel)
        };
        // What lamps would show from the middle's distance: values from 0 to 1, as wild as can be.
        let value = |light: usize, sample: usize| 0.5 + 0.5 * random(100 + light, sample);
        let stack =
            Pictures::of((40, size, 3), |light, pixel, c| value(light, 3 * pixel + c) / level(light, pixel));
        let basis = basis_of("hsh", 9, lamps.directions());
        let stack =
            LevelledStack { stack: &stack, lamps: &lamps, space: Space::Linear, level: CpuLevel::detect() };
        let fit =
            near_least_squares(basis.clone(), &lamps, LightWeights::Voronoi, Ridge::Fixed(1e-3), &stack)
                .unwrap();
        let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
        assert!(near.off <= MOST_OFF && near.nodes() > 20, "{} {}", near.off, near.nodes());
        let (found, _) =
            coefficients(&stack, PixelFit::Near(&fit, &near, Layout::Rgb), CpuLevel::detect(), 1000, 9);
        let ridge = 1e-3 * largest_singular(&fit).powi(2);
        let (mut worst, mut mean) = (0.0f64, 0.0);
        for sample in (0..3 * size.0 * size.1).step_by(7) {
            let design = design(&basis, &positions, points[sample / 3]);
            let values: Vec<f64> = (0..40).map(|light| value(light, sample)).collect();
            let exact = solved(&design, &fit.decomposition.weights, ridge, &values);
            for row in &design {
                let off: f64 = row
                    .iter()
                    .zip(&exact)
                    .enumerate()
                    .map(|(j, (a, c))| a * (f64::from(found[j][sample]) - c))
                    .sum();
                worst = worst.max(off.abs());
                mean += off * off;
            }
        }
        let count = (3 * size.0 * size.1).div_ceil(7) * 40;
        println!(
            "{size:?}: {} nodes, bound {:.1e}, worst {worst:.1e}, rms {:.1e}",
            near.nodes(),
            near.off,
            (mean / count as f64).sqrt()
        );
        assert!(worst < near.off, "{worst} {}", near.off);
        assert!(worst > 1e-6, "nothing was interpolated");
    }
}

#[test]
fn a_pixel_has_the_same_bits_in_any_span_on_any_machine() {
    let lamps = NearLamps::new(dome(30), bumps((31, 17)), None).unwrap();
    let stack = Pictures::of((30, (31, 17), 3), |light, pixel, c| 0.5 + 0.5 * random(light, 3 * pixel + c));
    let basis = basis_of("ptm", 6, lamps.directions());
    let fit = near_least_squares(basis, &lamps, LightWeights::Voronoi, Ridge::Auto, &stack).unwrap();
    let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
    for layout in [Layout::Rgb, Layout::Lrgb] {
        let of = |level, span| {
            let levelled = LevelledStack { stack: &stack, lamps: &lamps, space: Space::Encoded, level };
            coefficients(&levelled, PixelFit::Near(&fit, &near, layout), level, span, 6)
        };
        let first = of(CpuLevel::detect(), 8192);
        for level in CpuLevel::available() {
            for span in [1, 13, 100] {
                assert!(of(level, span) == first, "{layout:?} {} {span}", level.name());
            }
        }
    }
}

#[test]
fn luminance_is_fitted_under_the_pixels_own_lamps_too() {
    // Grey pictures times a colour: the luminance's coefficients are those of grey pictures, the base colour is the colour.
    let (size, color) = ((40, 24), [0.25, 1.0, 0.5]);
    let lamps = NearLamps::new(dome(30), plane(size), None).unwrap();
    let grey = |light: usize, pixel: usize| 0.5 + 0.5 * random(light, pixel);
    let basis = basis_of("ptm", 6, lamps.directions());
    let [colored, plain] = [color, [1.0; 3]]
        .map(|color| Pictures::of((30, size, 3), |light, pixel, c| color[c] * grey(light, pixel)));
    let fit = near_least_squares(basis, &lamps, LightWeights::Voronoi, Ridge::Fixed(1e-4), &plain).unwrap();
    let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
    let of = |stack: &Pictures, layout| {
        coefficients(stack, PixelFit::Near(&fit, &near, layout), CpuLevel::detect(), 100, 6)
    };
    let ((luminance, colors), (rgb, _)) = (of(&colored, Layout::Lrgb), of(&plain, Layout::Rgb));
    for pixel in 0..size.0 * size.1 {
        for c in 0..3 {
            assert!((colors[3 * pixel + c] - color[c] as f32).abs() < 1e-5);
        }
        for (a, b) in luminance.iter().zip(&rgb) {
            assert!((a[pixel] - b[3 * pixel]).abs() < 1e-4 * b[3 * pixel].abs().max(1.0), "pixel {pixel}");
        }
    }
}

#[test]
fn lamps_a_million_away_are_distant_ones() {
    let positions: Vec<[f64; 3]> = dome(40).into_iter().map(|lamp| lamp.map(|c| 1e6 * c)).collect();
    let lamps = NearLamps::new(positions, plane((30, 20)), None).unwrap();
    let pictures =
        Pictures::of((40, (30, 20), 3), |light, pixel, c| 0.5 + 0.5 * random(light, 3 * pixel + c));
    for (name, count) in [("hsh", 9), ("ptm", 6), ("sh", 16)] {
        let basis = basis_of(name, count, lamps.directions());
        let ridge = Ridge::Fixed(1e-4);
        let far = fit_of(&basis, lamps.directions(), LightWeights::Voronoi, ridge, &pictures);
        for space in [Space::Linear, Space::Encoded] {
            let level = CpuLevel::detect();
            let stack = LevelledStack { stack: &pictures, lamps: &lamps, space, level };
            let fit =
                near_least_squares(basis.clone(), &lamps, LightWeights::Voronoi, ridge, &stack).unwrap();
            let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
            let (found, _) =
                coefficients(&stack, PixelFit::Near(&fit, &near, Layout::Rgb), level, 8192, count);
            let (expected, _) = coefficients(&pictures, (&far, Layout::Rgb).into(), level, 8192, count);
            let largest = expected.iter().flatten().fold(0.0f32, |most, c| most.max(c.abs()));
            for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
                assert!((a - b).abs() < 1e-5 * largest, "{name} {space:?}: {a} {b}");
            }
        }
    }
}

#[test]
fn a_lamp_at_or_behind_the_surface_counts_nothing_there() {
    let size = (24, 16);
    let kept = dome(30);
    let all = |extra: [f64; 3]| kept.iter().copied().chain([extra]).collect::<Vec<_>>();
    let value = |light: usize, pixel: usize| 0.5 + 0.5 * random(light, pixel);
    // Of the last lamp there is nothing but nonsense.
    let pictures =
        Pictures::of((31, size, 1), |light, pixel, _| if light == 30 { 1e4 } else { value(light, pixel) });
    let fit_to = |lamps: &NearLamps, pictures: &Pictures| {
        let basis = basis_of("ptm", 6, &lamps.directions()[..30]);
        let fit =
            near_least_squares(basis, lamps, LightWeights::Uniform, Ridge::Fixed(0.0), pictures).unwrap();
        let near = NearSolutions::new::<FitError>(&fit, lamps, || Ok(())).unwrap();
        let pixel_fit = PixelFit::Near(&fit, &near, Layout::Grey);
        (coefficients(pictures, pixel_fit, CpuLevel::detect(), 8192, 6).0, fit)
    };
    let without = NearLamps::new(kept.clone(), plane(size), None).unwrap();
    let (expected, _) = fit_to(&without, &pictures.only(&(0..30).collect::<Vec<_>>()));
    for behind in [[3.0, 1.0, -4.0], [3.0, 1.0, 0.0]] {
        let lamps = NearLamps::new(all(behind), plane(size), None).unwrap();
        assert_eq!(lamps.behind(), [30]);
        let (found, fit) = fit_to(&lamps, &pictures);
        for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((a - b).abs() < 2e-4 * b.abs().max(1.0), "{a} {b}");
        }
        let errors = &fit.leave_one_out;
        assert!(errors.left_out[30].is_infinite() && errors.leverage[30] == 0.0);
        assert!(errors.left_out[..30].iter().all(|rmse| rmse.is_finite() && *rmse < 2.0));
    }
    // In front of the plane but right at the first pixel: nothing of it there, and numbers everywhere.
    let corner = points_of(&without)[0];
    let lamps = NearLamps::new(all([corner[0], corner[1], 1e-4]), plane(size), None).unwrap();
    assert!(lamps.behind().is_empty());
    assert!(lamps.direction(30, corner).is_none() && lamps.direction(30, points_of(&without)[1]).is_some());
    let (found, _) = fit_to(&lamps, &pictures);
    assert!(found.iter().flatten().all(|c| c.is_finite()));
    for (a, b) in found.iter().zip(&expected) {
        assert!((a[0] - b[0]).abs() < 2e-4 * b[0].abs().max(1.0), "{} {}", a[0], b[0]);
    }
}

#[test]
fn five_lamps_for_six_functions_give_their_pictures_back() {
    let (size, positions) = ((30, 20), dome(5));
    let lamps = NearLamps::new(positions.clone(), plane(size), None).unwrap();
    let pictures = Pictures::of((5, size, 1), |light, pixel, _| 0.5 + 0.5 * random(light, pixel));
    let basis = basis_of("ptm", 6, lamps.directions());
    let fit = near_least_squares(basis.clone(), &lamps, LightWeights::Voronoi, Ridge::Fixed(0.0), &pictures)
        .unwrap();
    let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
    let pixel_fit = PixelFit::Near(&fit, &near, Layout::Grey);
    let (found, _) = coefficients(&pictures, pixel_fit, CpuLevel::detect(), 8192, 6);
    for (pixel, point) in points_of(&lamps).into_iter().enumerate() {
        for (light, row) in design(&basis, &positions, point).iter().enumerate() {
            let value: f64 = row.iter().zip(&found).map(|(a, c)| a * f64::from(c[pixel])).sum();
            let off = (value - f64::from(pictures.rows[light][pixel])).abs();
            assert!(off < MOST_OFF, "pixel {pixel}, light {light}: {off}");
        }
    }
}

#[test]
fn left_out_errors_are_those_of_fits_without_the_light() {
    // As few pixels as are judged all.
    let (size, lights) = ((5, 4), 14);
    let positions = dome(lights);
    let lamps = NearLamps::new(positions.clone(), plane(size), None).unwrap();
    let pictures = Pictures::of((lights, size, 3), |light, pixel, c| random(light, 3 * pixel + c));
    let basis = basis_of("ptm", 6, lamps.directions());
    let fit = near_least_squares(basis.clone(), &lamps, LightWeights::Voronoi, Ridge::Fixed(1e-3), &pictures)
        .unwrap();
    let ridge = 1e-3 * largest_singular(&fit).powi(2);
    let points = points_of(&lamps);
    for light in 0..lights {
        let (mut without, mut with) = (0.0, 0.0);
        for sample in 0..3 * size.0 * size.1 {
            let design = design(&basis, &positions, points[sample / 3]);
            let values: Vec<f64> = (0..lights).map(|i| f64::from(pictures.rows[i][sample])).collect();
            let mut weights = fit.decomposition.weights.clone();
            let error = |weights: &[f64]| {
                let solution = solved(&design, weights, ridge, &values);
                let fitted: f64 = design[light].iter().zip(solution).map(|(a, c)| a * c).sum();
                (fitted - values[light]).powi(2)
            };
            with += error(&weights);
            weights[light] = 0.0;
            without += error(&weights);
        }
        let count = (3 * size.0 * size.1) as f64;
        for (found, expected) in
            [(fit.leave_one_out.fit[light], with), (fit.leave_one_out.left_out[light], without)]
        {
            let expected = (expected / count).sqrt();
            assert!((found / expected - 1.0).abs() < 1e-9, "light {light}: {found} {expected}");
        }
    }
}

#[test]
fn nodes_stay_few_under_a_lamp_that_all_but_touches_the_surface() {
    let pictures = Pictures::of((41, (300, 200), 1), |light, pixel, _| random(light, pixel));
    let of = |height: f64| {
        let positions = dome(40).into_iter().chain([[1.0, 0.7, height]]).collect();
        let lamps = NearLamps::new(positions, plane((300, 200)), None).unwrap();
        let basis = basis_of("sh", 25, lamps.directions());
        let fit =
            near_least_squares(basis, &lamps, LightWeights::Voronoi, Ridge::Fixed(1e-4), &pictures).unwrap();
        let called_off = NearSolutions::new(&fit, &lamps, || Err(FitError::NoLights));
        assert!(matches!(called_off, Err(FitError::NoLights)));
        let near = NearSolutions::new::<FitError>(&fit, &lamps, || Ok(())).unwrap();
        let bytes = (near.nodes() * 41 * 25 * 4) as u64;
        assert!(2 * bytes <= near_bytes(41, 25, 1), "{} nodes", near.nodes());
        near.off
    };
    assert!(of(9.0) <= MOST_OFF);
    assert!(of(0.02) > MOST_OFF);
}

#[test]
fn lamps_in_the_middle_and_maps_without_a_point_are_refused() {
    let in_the_middle = NearLamps::new(vec![[1.0, 0.0, 2.0], [0.0; 3]], plane((4, 3)), None);
    assert!(matches!(in_the_middle, Err(FitError::LampInTheMiddle { light: 1 })));
    let nothing = PositionMap { width: 2, height: 1, points: vec![NO_SURFACE, [1e15, 0.0, 0.0]] };
    let nowhere = NearLamps::new(vec![[1.0; 3]], NearSurface::Points(nothing), None);
    assert!(matches!(nowhere, Err(FitError::NoSurface)));
    assert!(matches!(NearLamps::new(Vec::new(), plane((4, 3)), None), Err(FitError::NoLights)));
}
