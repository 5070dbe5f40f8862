//! Relit textures on meshes.

use crate::{noise_picture, same_with_any_threads};
use relight_core::relighter::Picture;
use relight_core::{Camera, Projection, Wrap};
use relight_surface::{Albedo, DrawSettings, Mesh, chart_coverage, dilate, draw_lightmapped};

/// A camera above the plane z = 0 that sees x from 0 to `width` and y from 0 to `height`, a unit a pixel.
fn above(width: usize, height: usize) -> Camera {
    let middle = [0.5 * width as f64, 0.5 * height as f64];
    let projection = Projection::Orthographic { width: width as f64 };
    let (eye, target) = ([middle[0], middle[1], 5.0], [middle[0], middle[1], 0.0]);
    Camera::new(projection, (width, height), eye, target, [0.0, 1.0, 0.0]).unwrap()
}

/// A rectangle of the plane z = 0 with its part of the lightmap: (left, top, right, bottom) of each.
fn rectangle([x0, y1, x1, y0]: [f32; 4], [u0, v0, u1, v1]: [f32; 4]) -> Mesh {
    Mesh {
        positions: vec![[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]],
        normals: vec![[0.0, 0.0, 1.0]; 4],
        uv: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        uv2: vec![[u0, v1], [u1, v1], [u1, v0], [u0, v0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

const PLAIN: DrawSettings =
    DrawSettings { supersampling: 1, background: [4.0, 5.0, 6.0], wrap: Wrap::Repeat };

#[test]
fn a_lightmap_seen_from_above_is_itself_times_the_albedo() {
    let (relit, albedo) = (noise_picture(13, 9, 3), noise_picture(26, 18, 1));
    let whole = rectangle([0.0, 9.0, 13.0, 0.0], [0.0, 0.0, 1.0, 1.0]);
    let plain = same_with_any_threads(|| {
        draw_lightmapped(&whole, &above(13, 9), &relit, Albedo::Constant([0.5, 1.0, 2.0]), &PLAIN).unwrap()
    });
    let colored = draw_lightmapped(&whole, &above(13, 9), &relit, Albedo::Texture(&albedo), &PLAIN).unwrap();
    for y in 0..9 {
        for x in 0..13 {
            let at = 3 * (13 * y + x);
            // Four texels of the finer albedo meet in the middle of a pixel.
            let texel = |i: usize, j: usize| albedo.samples[26 * (2 * y + j) + 2 * x + i];
            let own = 0.25 * (texel(0, 0) + texel(1, 0) + texel(0, 1) + texel(1, 1));
            for (c, factor) in [0.5, 1.0, 2.0].into_iter().enumerate() {
                assert!((plain.samples[at + c] - factor * relit.samples[at + c]).abs() < 1e-5, "{x} {y} {c}");
                assert!((colored.samples[at + c] - own * relit.samples[at + c]).abs() < 1e-5, "{x} {y} {c}");
            }
        }
    }
}

#[test]
fn pixels_are_means_of_their_samples_over_the_background() {
    // The left edge of the rectangle cuts a pixel at three quarters, the upper one at a quarter from below.
    let half = rectangle([1.75, 1.25, 4.0, 0.0], [0.0, 0.0, 1.0, 1.0]);
    let relit = Picture { width: 1, height: 1, channels: 1, samples: vec![1.0] };
    let settings = DrawSettings { supersampling: 4, ..PLAIN };
    let white = Albedo::Constant([1.0; 3]);
    let picture = draw_lightmapped(&half, &above(4, 2), &relit, white, &settings).unwrap();
    let covered = [0.0, 0.25 * 0.25, 0.25, 0.25, 0.0, 0.25, 1.0, 1.0];
    for (pixel, covered) in picture.samples.chunks_exact(3).zip(covered) {
        for (value, background) in pixel.iter().zip(PLAIN.background) {
            assert!((value - covered - (1.0 - covered) * background).abs() < 1e-5, "{pixel:?} {covered}");
        }
    }
    for supersampling in [0, 17] {
        let settings = DrawSettings { supersampling, ..PLAIN };
        assert!(draw_lightmapped(&half, &above(4, 2), &relit, white, &settings).is_err());
    }
}

#[test]
fn lightmaps_end_at_their_edges_and_textures_go_on() {
    let whole = rectangle([0.0, 1.0, 8.0, 0.0], [0.0, 0.0, 1.0, 1.0]);
    let relit = Picture { width: 2, height: 1, channels: 1, samples: vec![1.0, 3.0] };
    let drawn = |relit: &Picture, albedo: &Picture, wrap| {
        let settings = DrawSettings { wrap, ..PLAIN };
        let albedo = Albedo::Texture(albedo);
        let picture = draw_lightmapped(&whole, &above(8, 1), relit, albedo, &settings).unwrap();
        picture.samples.chunks_exact(3).map(|pixel| pixel[0]).collect::<Vec<_>>()
    };
    let white = Picture { width: 1, height: 1, channels: 1, samples: vec![1.0] };
    let kept = [1.0, 1.0, 1.25, 1.75, 2.25, 2.75, 3.0, 3.0];
    assert_eq!(drawn(&relit, &white, Wrap::Repeat), kept);
    assert_eq!(drawn(&white, &relit, Wrap::Clamp), kept);
    assert_eq!(drawn(&white, &relit, Wrap::Mirror), kept);
    let around = [1.75, 1.25, 1.25, 1.75, 2.25, 2.75, 2.75, 2.25];
    assert_eq!(drawn(&white, &relit, Wrap::Repeat), around);
}

#[test]
fn no_seam_shows_where_charts_meet() {
    // Neighbours on the table, apart in the lightmap, with black between and values of their own.
    let left = rectangle([0.0, 8.0, 20.0, 0.0], [0.1, 0.1, 0.43, 0.37]);
    let right = rectangle([20.0, 8.0, 40.0, 0.0], [0.57, 0.63, 0.93, 0.91]);
    let mesh = Mesh::joined(vec![left, right]).unwrap();
    let mut relit = noise_picture(16, 16, 3);
    let coverage = chart_coverage(&mesh, 16, 16).unwrap();
    for (texel, covered) in relit.samples.chunks_exact_mut(3).zip(&coverage) {
        texel.fill(if *covered { 0.7 } else { 0.0 });
    }
    let least = |relit: &Picture| {
        let settings = DrawSettings { supersampling: 3, ..PLAIN };
        let white = Albedo::Constant([1.0; 3]);
        let picture = draw_lightmapped(&mesh, &above(40, 8), relit, white, &settings).unwrap();
        picture.samples.iter().fold(f32::INFINITY, |least, v| least.min(*v))
    };
    assert!(least(&relit) < 0.5);
    assert!(least(&dilate(&relit, &coverage, 2)) > 0.699);
}

#[test]
fn dilation_takes_means_of_what_was_there_before_the_step() {
    let mut picture = noise_picture(7, 5, 3);
    let mut coverage = vec![false; 35];
    for (texel, value) in [(8, 1.0), (11, 5.0), (18, 9.0)] {
        coverage[texel] = true;
        picture.samples[3 * texel..3 * texel + 3].copy_from_slice(&[value, 10.0 * value, -value]);
    }
    let at = |picture: &Picture, x: usize, y: usize| picture.samples[3 * (7 * y + x)];
    let untouched = picture.clone();
    assert_eq!(dilate(&picture, &coverage, 0), untouched);
    let once = same_with_any_threads(|| dilate(&picture, &coverage, 1));
    // (1, 1) is 1, (4, 1) is 5, (4, 2) is 9.
    for (x, y, expected) in [
        (0, 0, 1.0),
        (2, 2, 1.0),
        (3, 0, 5.0),
        (3, 1, 7.0),
        (5, 2, 7.0),
        (4, 3, 9.0),
        (1, 1, 1.0),
        (4, 2, 9.0),
    ] {
        assert_eq!(at(&once, x, y), expected, "{x} {y}");
    }
    assert_eq!(once.samples[3 * (7 + 3)..][..3], [7.0, 70.0, -7.0]);
    // Nothing beyond a texel yet.
    assert_eq!(at(&once, 6, 0), at(&untouched, 6, 0));
    let twice = dilate(&picture, &coverage, 2);
    assert_eq!(at(&twice, 6, 0), (5.0 + 7.0) / 2.0);
    assert_eq!(dilate(&picture, &[false; 35], 9), untouched);
    // Enough steps fill everything, then nothing changes any more.
    assert_eq!(dilate(&picture, &coverage, 10), dilate(&picture, &coverage, 1000));
}
