//! Views out of panoramas against functions of direction that are known.

use crate::{noise_picture, same_with_any_threads};
use relight_core::relighter::Picture;
use relight_surface::{Filter, PanoramaView, view_of_panorama};
use std::f64::consts::{FRAC_PI_2, PI};

const FILTERS: [Filter; 3] = [Filter::Bilinear, Filter::Bicubic, Filter::Area];

/// Harmonics up to the second order, others in each channel.
fn smooth([x, y, z]: [f64; 3]) -> [f64; 3] {
    [
        0.5 + 0.3 * x - 0.2 * y + 0.15 * z + 0.2 * x * y,
        0.4 - 0.25 * z + 0.2 * y * z - 0.1 * (x * x - y * y),
        0.6 + 0.2 * x + 0.1 * (3.0 * z * z - 1.0) - 0.15 * x * z,
    ]
}

/// The panorama of [`smooth`] between +-`latitude`.
fn smooth_panorama(width: usize, height: usize, latitude: f64) -> Picture {
    let value = |i: usize| {
        let azimuth = ((i % width) as f64 + 0.5) / width as f64 * 2.0 * PI - PI;
        let elevation = latitude * (1.0 - 2.0 * ((i / width) as f64 + 0.5) / height as f64);
        let flat = libm::cos(elevation);
        smooth([flat * libm::sin(azimuth), flat * libm::cos(azimuth), libm::sin(elevation)])
    };
    let samples = (0..width * height).flat_map(|i| value(i).map(|v| v as f32)).collect();
    Picture { width, height, channels: 3, samples }
}

fn view(yaw_deg: f64, pitch_deg: f64, fov_deg: f64, filter: Filter) -> PanoramaView {
    PanoramaView {
        yaw: yaw_deg.to_radians(),
        pitch: pitch_deg.to_radians(),
        fov_x: fov_deg.to_radians(),
        width: 21,
        height: 15,
        filter,
        latitude: FRAC_PI_2,
        background: [9.0, 8.0, 7.0],
    }
}

/// The direction of a pixel by rotations: up by the pitch, then right by the yaw.
fn direction(view: &PanoramaView, x: usize, y: usize) -> [f64; 3] {
    let scale = libm::tan(view.fov_x / 2.0) / (view.width as f64 / 2.0);
    let a = (x as f64 + 0.5 - view.width as f64 / 2.0) * scale;
    let b = (view.height as f64 / 2.0 - y as f64 - 0.5) * scale;
    let length = (a * a + b * b + 1.0).sqrt();
    let (sin, cos) = libm::sincos(view.pitch);
    let (ahead, up) = (cos - b * sin, sin + b * cos);
    let (sin, cos) = libm::sincos(view.yaw);
    [a * cos + ahead * sin, ahead * cos - a * sin, up].map(|c| c / length)
}

fn largest_error(panorama: &Picture, view: &PanoramaView) -> f64 {
    let picture = view_of_panorama(panorama, view).unwrap();
    assert_eq!((picture.width, picture.height, picture.channels), (view.width, view.height, 3));
    let mut worst = 0.0f64;
    for (i, pixel) in picture.samples.chunks_exact(3).enumerate() {
        let expected = smooth(direction(view, i % view.width, i / view.width));
        worst = (0..3).fold(worst, |worst, c| worst.max((f64::from(pixel[c]) - expected[c]).abs()));
    }
    worst
}

#[test]
fn a_smooth_function_is_seen_in_every_direction_poles_and_seam_included() {
    // Odd: half a turn ends between two columns.
    let panorama = smooth_panorama(257, 128, FRAC_PI_2);
    for filter in FILTERS {
        for pitch in [-90.0, -89.6, -50.0, 0.0, 30.0, 89.9, 90.0] {
            for yaw in [0.0, 47.0, 180.0, -179.0, 270.0, 3600.0 - 90.0] {
                for fov in [2.0, 12.0] {
                    let error = largest_error(&panorama, &view(yaw, pitch, fov, filter));
                    assert!(error < 1e-3, "{filter:?} yaw {yaw} pitch {pitch} fov {fov}: {error}");
                }
            }
        }
        // The area filter's pixels are wide here: their mean is not the value at their middle.
        let wide = PanoramaView { width: 210, height: 150, ..view(160.0, 70.0, 150.0, filter) };
        assert!(largest_error(&panorama, &wide) < 1e-3, "{filter:?}");
    }
}

#[test]
fn the_cubic_is_the_sharper_one_and_goes_through_the_pixels() {
    let panorama = smooth_panorama(64, 32, FRAC_PI_2);
    let of = |filter| largest_error(&panorama, &view(20.0, 10.0, 70.0, filter));
    assert!(
        of(Filter::Bicubic) < 0.2 * of(Filter::Bilinear),
        "{} {}",
        of(Filter::Bicubic),
        of(Filter::Bilinear)
    );
    // A view of one pixel that looks at the middle of a panorama's pixel.
    let panorama = noise_picture(8, 4, 3);
    for (filter, x, y) in [(Filter::Bilinear, 5, 1), (Filter::Bicubic, 7, 3), (Filter::Bicubic, 0, 0)] {
        let yaw = (x as f64 + 0.5) / 8.0 * 360.0 - 180.0;
        let pitch = 90.0 - (y as f64 + 0.5) / 4.0 * 180.0;
        let one = PanoramaView { width: 1, height: 1, ..view(yaw, pitch, 1.0, filter) };
        let pixel = view_of_panorama(&panorama, &one).unwrap().samples;
        for (found, expected) in pixel.iter().zip(&panorama.samples[3 * (8 * y + x)..]) {
            assert!((found - expected).abs() < 1e-6, "{filter:?} {x} {y}");
        }
    }
}

#[test]
fn a_view_across_the_seam_is_that_of_the_turned_panorama() {
    let panorama = noise_picture(64, 32, 3);
    let mut turned = panorama.clone();
    for (i, pixel) in turned.samples.chunks_exact_mut(3).enumerate() {
        let from = i / 64 * 64 + (i % 64 + 16) % 64;
        pixel.copy_from_slice(&panorama.samples[3 * from..3 * from + 3]);
    }
    for filter in FILTERS {
        // Noise has no one value at the pole itself.
        for pitch in [0.0, -75.0, 88.0] {
            let across = view_of_panorama(&panorama, &view(180.0, pitch, 60.0, filter)).unwrap();
            let beside = view_of_panorama(&turned, &view(90.0, pitch, 60.0, filter)).unwrap();
            let differences = across.samples.iter().zip(&beside.samples).map(|(a, b)| (a - b).abs());
            let worst = differences.fold(0.0, f32::max);
            assert!(worst < 1e-5, "{filter:?} pitch {pitch}: {worst}");
        }
    }
}

#[test]
fn small_views_of_fine_stripes_are_grey_with_the_area_filter_alone() {
    let mut panorama = noise_picture(512, 256, 1);
    for (i, sample) in panorama.samples.iter_mut().enumerate() {
        *sample = ((i + i / 512) % 2) as f32;
    }
    let contrast = |filter| {
        let small = PanoramaView { width: 16, height: 12, ..view(0.3, 5.0, 90.0, filter) };
        let picture = view_of_panorama(&panorama, &small).unwrap();
        assert_eq!(picture.channels, 1);
        picture.samples.iter().fold(0.0f32, |worst, value| worst.max((value - 0.5).abs()))
    };
    assert!(contrast(Filter::Area) < 0.05, "{}", contrast(Filter::Area));
    assert!(contrast(Filter::Bilinear) > 0.3);
}

#[test]
fn panoramas_of_limited_latitude_end_at_the_background() {
    let latitude = FRAC_PI_2 / 2.0;
    let panorama = smooth_panorama(256, 64, latitude);
    for filter in FILTERS {
        let tall = PanoramaView { latitude, width: 60, height: 90, ..view(-120.0, 10.0, 80.0, filter) };
        let picture = view_of_panorama(&panorama, &tall).unwrap();
        let (mut inside, mut outside) = (0, 0);
        for (i, pixel) in picture.samples.chunks_exact(3).enumerate() {
            let direction = direction(&tall, i % 60, i / 60);
            let elevation = libm::asin(direction[2]);
            // The pixel's own height, about 1.6 degrees, is a mixture.
            if elevation.abs() > latitude + 0.03 {
                outside += 1;
                assert_eq!(pixel, [9.0, 8.0, 7.0], "{filter:?}");
            } else if elevation.abs() < latitude - 0.03 {
                inside += 1;
                let expected = smooth(direction);
                assert!((0..3).all(|c| (f64::from(pixel[c]) - expected[c]).abs() < 2e-3), "{filter:?}");
            }
        }
        assert!(inside > 1000 && outside > 500, "{inside} {outside}");
    }
}

#[test]
fn angles_out_of_range_are_refused_in_one_sentence() {
    let panorama = noise_picture(8, 4, 3);
    let refused = |view: PanoramaView| view_of_panorama(&panorama, &view).unwrap_err().to_string();
    let base = view(0.0, 0.0, 60.0, Filter::Area);
    assert_eq!(
        refused(view(0.0, 0.0, 180.0, Filter::Area)),
        "the horizontal field of view is 180; the camera needs above 0 and below 180 degrees"
    );
    assert!(refused(view(0.0, 0.0, 250.0, Filter::Area)).contains("250"));
    assert!(
        refused(view(0.0, 91.0, 60.0, Filter::Area)).contains("the pitch is 91; the camera needs -90 to 90")
    );
    assert!(refused(view(f64::INFINITY, 0.0, 60.0, Filter::Area)).contains("the yaw"));
    assert!(refused(view(0.0, f64::NAN, 60.0, Filter::Area)).contains("the pitch"));
    assert!(refused(PanoramaView { latitude: 1.6, ..base }).contains("latitude"));
    assert!(refused(PanoramaView { height: 0, ..base }).contains("height"));
}

#[test]
fn views_have_the_same_bits_with_any_threads_and_odd_panoramas_hold() {
    for filter in FILTERS {
        same_with_any_threads(|| {
            let views = [(1, 1), (2, 1), (1, 2), (5, 3), (33, 16)].map(|(width, height)| {
                view_of_panorama(&noise_picture(width, height, 3), &view(100.0, 88.0, 120.0, filter)).unwrap()
            });
            assert!(views.iter().all(|view| view.samples.iter().all(|v| (-0.5..1.5).contains(v))));
            views
        });
    }
}
