//! Scenes against a slow, obvious relighter in f64: every kind of light, layout and space, and what is hard.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use half::f16;
use relight_core::basis::Learned;
use relight_core::relighter::Picture;
use relight_core::sphere::{Cap, Octahedral, fibonacci_in};
use relight_core::{
    Basis, CpuLevel, Design, Direction, Family, Layout, LightSet, Model, NO_SURFACE, PositionMap,
    RelightingMap, RelightingMaps, SKY, Space, Texels, linear_from_srgb,
};
use relight_lights::{
    Accuracy, Attenuation, Environment, Gobo, Horizon, HorizonRule, Lamp, Light, Plan, Report, Scene,
    Settings, Spot, relight_scene,
};
use std::f64::consts::PI;

const SIZE: (usize, usize) = (150, 130);

fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Learned functions of `planes` planes: of colour over the sphere, or grey over the upper half.
fn learned(family: &str, planes: usize) -> Basis {
    let grey = family == "grey pca";
    let (channels, square) = (if grey { 1 } else { 3 }, Octahedral { nodes: 9, hemisphere: grey });
    let mut next = random(planes as u64);
    let table = (0..square.count() * channels * (planes + 1)).map(|_| (next() - 0.5) as f32).collect();
    Basis::Learned(Learned::new(family.to_owned(), planes, channels, square, table).unwrap())
}

/// An asset with a value of its own in every plane and pixel.
fn asset(family: &str, count: usize, layout: Layout, space: Space, precision: usize) -> RelightingMaps {
    let lights = fibonacci_in(Cap { axis: Direction::OUT, radius: PI }, 60);
    let set = LightSet::from_directions(lights.clone());
    let basis = match layout {
        Layout::Shared => learned(family, count),
        _ => Family::by_name(family).unwrap().build(&Design::new(count, &set)).unwrap(),
    };
    let model = Model { basis, layout, space, lights, figures: None, provenance: None };
    let mut next = random(count as u64 + precision as u64);
    let planes = (0..model.plane_count())
        .map(|p| {
            let pixels = 0..SIZE.0 * SIZE.1;
            let base = layout == Layout::Lrgb && p >= count;
            let (scale, bias) = if base { (0.9, 0.1) } else { (0.3, -0.05 - 0.01 * (p % 7) as f32) };
            match precision {
                0 => RelightingMap {
                    scale,
                    bias,
                    texels: Texels::U8(pixels.map(|_| (next() * 256.0) as u8).collect()),
                },
                1 => RelightingMap {
                    scale,
                    bias,
                    texels: Texels::F16(pixels.map(|_| f16::from_f64(next())).collect()),
                },
                _ => RelightingMap {
                    scale,
                    bias,
                    texels: Texels::F32(pixels.map(|_| next() as f32).collect()),
                },
            }
        })
        .collect();
    RelightingMaps { width: SIZE.0, height: SIZE.1, model, planes }
}

/// A bent floor with a corner of sky and a hole.
fn positions() -> PositionMap {
    let point = |i: usize| {
        let (x, y) = (i % SIZE.0, i / SIZE.0);
        match (x, y) {
            (0..20, 0..9) => [SKY as f32 * 0.6, SKY as f32 * 0.8, 0.0],
            (100..110, 40..50) => NO_SURFACE,
            _ => {
                let (u, v) = (x as f32 / 20.0, y as f32 / 20.0);
                [u - 3.0, 2.0 - v, 0.2 * libm::sinf(u * 2.0) * libm::cosf(v * 3.0)]
            }
        }
    };
    PositionMap { width: SIZE.0, height: SIZE.1, points: (0..SIZE.0 * SIZE.1).map(point).collect() }
}

fn light(lamp: Lamp) -> Light {
    Light { name: "lamp".into(), lamp, color: [1.0; 3], intensity: 1.0, attenuation: Attenuation::None }
}

fn point(position: [f64; 3]) -> Light {
    light(Lamp::Point { position })
}

fn spot(position: [f64; 3], axis: [f64; 3], cone_deg: f64, beam_deg: f64) -> Light {
    let axis = Direction::new(axis[0], axis[1], axis[2]).unwrap();
    let (cone, beam) = (cone_deg.to_radians(), beam_deg.to_radians());
    light(Lamp::Spot(Box::new(Spot { position, axis, cone, beam, gobo: None })))
}

const NEAR: Attenuation = Attenuation::InverseSquare { nearest: 0.01 };

fn settings() -> Settings {
    Settings { level: CpuLevel::detect(), step: 0.0, timed: false }
}

fn drawn(maps: &RelightingMaps, scene: &Scene, settings: Settings) -> (Picture, Report) {
    let plan = Plan::new(scene, &maps.model, Accuracy::Exact);
    let positions = positions();
    relight_scene(maps, plan.reads_positions().then_some(&positions), scene, &plan, &settings, Vec::new())
}

/// The relit sample of a pixel under one direction, decoded: the definition, in f64.
fn sample(maps: &RelightingMaps, pixel: usize, direction: Direction) -> [f64; 3] {
    let model = &maps.model;
    let count = model.basis.count();
    let mut functions = vec![0.0; count];
    model.basis.evaluate(direction, &mut functions);
    let coefficient = |plane: usize| {
        let plane = &maps.planes[plane];
        let q = match &plane.texels {
            Texels::U8(codes) => f64::from(codes[pixel]) / 255.0,
            Texels::F16(values) => values[pixel].to_f64(),
            Texels::F32(values) => f64::from(values[pixel]),
        };
        f64::from(plane.scale) * q + f64::from(plane.bias)
    };
    let sum = |plane: &dyn Fn(usize) -> usize| {
        (0..count).map(|f| functions[f] * coefficient(plane(f))).sum::<f64>()
    };
    let values = match model.layout {
        Layout::Rgb => [0, 1, 2].map(|c| sum(&|f| 3 * f + c)),
        Layout::Grey => [sum(&|f| f); 3],
        Layout::Lrgb => [0, 1, 2].map(|c| sum(&|f| f) * coefficient(count + c)),
        Layout::Shared => [0, 1, 2].map(|c| {
            let c = c.min(model.channels() - 1);
            let of = |plane: usize| functions[(plane + 1) * model.channels() + c] * coefficient(plane);
            functions[c] + (0..model.maps()).map(of).sum::<f64>()
        }),
    };
    match model.space {
        Space::Linear => values,
        Space::Encoded => values.map(|v| f64::from(linear_from_srgb(v as f32))),
    }
}

/// Direction and factor of a point-like light at a pixel; `None` where it lights nothing.
fn aim(light: &Light, point: [f32; 3]) -> Option<(Direction, f64)> {
    let lamp = light.position().unwrap();
    let to = [0, 1, 2].map(|i| lamp[i] - f64::from(point[i]));
    let direction = Direction::new(to[0], to[1], to[2]).ok()?;
    let distance = to.iter().map(|c| c * c).sum::<f64>().sqrt();
    let mut factor = light.intensity * light.attenuation.factor(distance);
    if let Lamp::Spot(spot) = &light.lamp {
        let back = spot.axis.components();
        let angle = direction.angle_to(Direction::new(-back[0], -back[1], -back[2]).unwrap());
        factor *= match spot.cone - spot.beam {
            width if width > 0.0 => ((spot.cone - angle) / width).clamp(0.0, 1.0),
            _ => f64::from(u8::from(angle < spot.cone || spot.cone >= PI)),
        };
    }
    Some((direction, factor))
}

/// Point and spot lights and directional ones, added up in f64.
fn reference(maps: &RelightingMaps, scene: &Scene) -> Vec<[f64; 3]> {
    let points = positions().points;
    let horizon = Horizon::of(&maps.model, scene.horizon);
    (0..maps.pixels())
        .map(|pixel| {
            let mut sum = [0.0; 3];
            for light in &scene.lights {
                let aimed = match &light.lamp {
                    Lamp::Directional { direction } => Some((*direction, light.intensity)),
                    _ => aim(light, points[pixel]),
                };
                let Some((direction, factor)) = aimed else { continue };
                let taken = horizon.take(direction);
                let value = sample(maps, pixel, taken.direction);
                for c in 0..3 {
                    sum[c] += f64::from(light.color[c]) * factor * taken.factor * value[c];
                }
            }
            sum
        })
        .collect()
}

fn assert_near(picture: &Picture, expected: &[[f64; 3]], tolerance: f64, what: &str) {
    let mut worst = (0.0, 0);
    for (i, sample) in picture.samples.iter().enumerate() {
        let (pixel, c) = (i / picture.channels, i % picture.channels);
        let error = (f64::from(*sample) - expected[pixel][c]).abs() / expected[pixel][c].abs().max(1.0);
        assert!(error.is_finite(), "{what}: {sample} at pixel {pixel}");
        if error > worst.0 {
            worst = (error, pixel);
        }
    }
    assert!(worst.0 < tolerance, "{what}: {:e} at pixel {}", worst.0, worst.1);
}

fn scene(lights: Vec<Light>) -> Scene {
    Scene { lights, horizon: HorizonRule::Fade }
}

#[test]
fn every_light_is_the_reference_within_1e_5_in_every_layout_space_and_precision() {
    let directional = Light {
        color: [1.0, 0.4, 0.1],
        intensity: 1.5,
        ..light(Lamp::Directional { direction: Direction::OUT })
    };
    let tilted = light(Lamp::Directional { direction: Direction::new(0.6, -0.5, 0.4).unwrap() });
    let lights = vec![
        directional,
        tilted,
        Light { attenuation: NEAR, ..point([0.5, 0.5, 0.8]) },
        Light {
            attenuation: Attenuation::Inverse { a0: 0.7 },
            color: [0.2, 1.0, 0.5],
            ..point([-2.0, 1.0, 0.5])
        },
        Light { intensity: 0.3, ..point([1.0, -1.0, 2.0]) },
        Light { attenuation: NEAR, intensity: 2.0, ..spot([2.0, 0.0, 1.5], [-0.2, 0.1, -1.0], 35.0, 20.0) },
    ];
    let scene = scene(lights);
    for (family, count) in [("srbf", 25), ("ptm", 10), ("sh", 16), ("hsh", 9)] {
        for (layout, space, precision) in [
            (Layout::Rgb, Space::Linear, 0),
            (Layout::Rgb, Space::Encoded, 1),
            (Layout::Lrgb, Space::Encoded, 0),
            (Layout::Lrgb, Space::Linear, 2),
            (Layout::Grey, Space::Linear, 1),
            (Layout::Grey, Space::Encoded, 2),
        ] {
            let maps = asset(family, count, layout, space, precision);
            let what = format!("{family} {layout:?} {space:?} {precision}");
            assert_near(&drawn(&maps, &scene, settings()).0, &reference(&maps, &scene), 1e-5, &what);
        }
    }
    for (family, count, space, precision) in [
        ("pca", 9, Space::Encoded, 0),
        ("pca", 5, Space::Linear, 1),
        ("grey pca", 4, Space::Encoded, 2),
        ("grey pca", 6, Space::Linear, 0),
    ] {
        let maps = asset(family, count, Layout::Shared, space, precision);
        let what = format!("{family} {count} {space:?} {precision}");
        assert_near(&drawn(&maps, &scene, settings()).0, &reference(&maps, &scene), 1e-5, &what);
    }
}

#[test]
fn every_level_gives_the_same_bits_with_any_threads() {
    let maps = asset("srbf", 25, Layout::Rgb, Space::Encoded, 0);
    let linear = asset("sh", 25, Layout::Lrgb, Space::Linear, 0);
    let sphere = light(Lamp::Sphere { position: [0.0, 0.0, 1.0], radius: 0.3, samples: 5 });
    let scene = scene(vec![
        light(Lamp::Directional { direction: Direction::RIGHT }),
        Light { attenuation: NEAR, ..sphere },
        Light {
            attenuation: NEAR,
            color: [1.0, 0.5, 0.2],
            ..spot([2.0, 0.0, 1.5], [0.0, 0.0, -1.0], 40.0, 10.0)
        },
    ]);
    for maps in [maps, linear] {
        let (first, _) = drawn(&maps, &scene, Settings { level: CpuLevel::BASELINE, ..settings() });
        for level in CpuLevel::available() {
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let (picture, _) = pool.install(|| drawn(&maps, &scene, Settings { level, ..settings() }));
                let same =
                    picture.samples.iter().zip(&first.samples).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "{} with {threads} threads", level.name());
            }
        }
    }
}

/// |L| = 0 and denormal: a lamp right at a surface point lights nothing there and everything else.
#[test]
fn a_lamp_at_a_surface_point_is_dark_there_and_counted() {
    let maps = asset("srbf", 16, Layout::Rgb, Space::Linear, 0);
    let pixel = 30 * SIZE.0 + 77;
    let lamp = positions().points[pixel].map(f64::from);
    for attenuation in [Attenuation::None, Attenuation::Inverse { a0: 1.0 }, NEAR] {
        let scene = scene(vec![Light { attenuation, ..point(lamp) }]);
        let (picture, report) = drawn(&maps, &scene, settings());
        assert_eq!(report.at_surface, 1);
        assert_eq!(picture.samples[3 * pixel..3 * pixel + 3], [0.0; 3]);
        let mut expected = reference(&maps, &scene);
        expected[pixel] = [0.0; 3];
        assert_near(&picture, &expected, 2e-5, &format!("{attenuation:?}"));
    }
    // So near that squares of the distance are denormal: as good as at the surface.
    let mut map = positions();
    map.points[pixel] = [1e-20, 0.0, 0.0];
    let scene = scene(vec![Light { attenuation: NEAR, ..point([0.0; 3]) }]);
    let plan = Plan::new(&scene, &maps.model, Accuracy::Exact);
    let (picture, report) = relight_scene(&maps, Some(&map), &scene, &plan, &settings(), Vec::new());
    assert_eq!((report.at_surface, picture.samples[3 * pixel]), (1, 0.0));
    assert!(picture.samples.iter().all(|s| s.is_finite()));
}

#[test]
fn lamps_1e_minus_6_and_1e6_away_are_the_reference() {
    let maps = asset("srbf", 25, Layout::Rgb, Space::Linear, 0);
    let pixel = 30 * SIZE.0 + 77;
    let p = positions().points[pixel].map(f64::from);
    let close = point([p[0], p[1], p[2] + 1e-6]);
    let far = Light { intensity: 1e12, attenuation: NEAR, ..point([6e5, -3e5, 7e5]) };
    for light in [close, far] {
        let scene = scene(vec![light]);
        let (picture, _) = drawn(&maps, &scene, settings());
        let expected = reference(&maps, &scene);
        assert_near(&picture, &expected, 3e-5, "far and close");
    }
}

/// Without a surface there is nothing to light; the sky is so far that only unattenuated light reaches it,
/// from the direction of the eye.
#[test]
fn holes_are_dark_and_the_sky_has_its_limit() {
    let maps = asset("sh", 9, Layout::Rgb, Space::Linear, 0);
    let (hole, sky) = (45 * SIZE.0 + 105, 3 * SIZE.0 + 5);
    for attenuation in [Attenuation::None, NEAR, Attenuation::Inverse { a0: 1.0 }] {
        let scene = scene(vec![Light { attenuation, ..point([0.0, 0.0, 1.0]) }]);
        let (picture, _) = drawn(&maps, &scene, settings());
        assert_eq!(picture.samples[3 * hole..3 * hole + 3], [0.0; 3]);
        let limit = sample(&maps, sky, Direction::new(-0.6, -0.8, 0.0).unwrap());
        let expected = if attenuation == Attenuation::None { limit[1] } else { 0.0 };
        assert!((f64::from(picture.samples[3 * sky + 1]) - expected).abs() < 1e-5);
    }
}

#[test]
fn spots_of_0_and_180_degrees_are_nothing_and_everything() {
    let maps = asset("srbf", 9, Layout::Rgb, Space::Linear, 0);
    let of = |lights| drawn(&maps, &scene(lights), settings()).0;
    let (lamp, axis) = ([0.2, 0.1, 0.9], [0.1, 0.3, -1.0]);
    let whole = of(vec![Light { attenuation: NEAR, ..point(lamp) }]);
    for (cone, beam) in [(180.0, 180.0), (180.0, 179.999)] {
        let all = of(vec![Light { attenuation: NEAR, ..spot(lamp, axis, cone, beam) }]);
        for (a, b) in all.samples.iter().zip(&whole.samples) {
            assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{cone} {beam}: {a} {b}");
        }
    }
    let none = of(vec![spot(lamp, axis, 0.0, 0.0)]);
    assert!(none.samples.iter().all(|s| *s == 0.0));
    // A sharp edge, and a beam of no width at all.
    for (cone, beam) in [(30.0, 30.0), (30.0, 0.0)] {
        let scene = scene(vec![spot(lamp, axis, cone, beam)]);
        let (picture, _) = drawn(&maps, &scene, settings());
        let expected = reference(&maps, &scene);
        let wrong = picture
            .samples
            .iter()
            .enumerate()
            .filter(|(i, s)| (f64::from(**s) - expected[i / 3][i % 3]).abs() > 1e-4);
        assert!(wrong.count() <= 9, "but for pixels right on the edge");
    }
}

#[test]
fn directional_lights_and_environments_of_linear_assets_are_one_pass() {
    let maps = asset("sh", 16, Layout::Rgb, Space::Linear, 0);
    let radiance =
        Picture { width: 8, height: 4, channels: 3, samples: (0..96).map(|i| (i % 7) as f32).collect() };
    let up = Direction::new(0.0, 1.0, 0.0).unwrap();
    let environment = Environment::new(radiance, Direction::OUT, up).unwrap();
    let lights = vec![
        light(Lamp::Directional { direction: Direction::OUT }),
        light(Lamp::Environment(Box::new(environment.clone()))),
        Light { color: [0.0, 1.0, 0.0], ..light(Lamp::Directional { direction: Direction::RIGHT }) },
    ];
    let scene = scene(lights);
    let plan = Plan::new(&scene, &maps.model, Accuracy::Exact);
    assert_eq!(plan.uniform.len(), 1);
    assert_eq!(plan.uniform[0].lights, [0, 1, 2]);
    assert!(!plan.reads_positions() && plan.path.is_none());
    let (picture, report) = relight_scene(&maps, None, &scene, &plan, &settings(), Vec::new());
    assert_eq!(report.positions_read, 0);
    // The environment by brute force: each pixel of it cut into 40 x 40 directional lights.
    let mut expected = vec![[0.0; 3]; 40];
    for (pixel, sum) in expected.iter_mut().enumerate() {
        let [a, b] = [Direction::OUT, Direction::RIGHT].map(|d| sample(&maps, pixel, d));
        *sum = [a[0], a[1] + b[1], a[2]];
    }
    for (cell, color) in environment.radiance.samples.chunks(3).enumerate() {
        for i in 0..1600 {
            let azimuth = 2.0 * PI * (((cell % 8) as f64 + ((i % 40) as f64 + 0.5) / 40.0) / 8.0 - 0.5);
            let latitude = PI * (0.5 - ((cell / 8) as f64 + ((i / 40) as f64 + 0.5) / 40.0) / 4.0);
            let area = (2.0 * PI / 320.0) * (PI / 160.0) * libm::cos(latitude);
            // Right is forward x up = z x y = -x.
            let (s, c) = libm::sincos(azimuth);
            let direction =
                Direction::new(-libm::cos(latitude) * s, libm::sin(latitude), libm::cos(latitude) * c)
                    .unwrap();
            for (pixel, sum) in expected.iter_mut().enumerate() {
                let value = sample(&maps, pixel, direction);
                for c in 0..3 {
                    sum[c] += f64::from(color[c]) * area / PI * value[c];
                }
            }
        }
    }
    for (pixel, expected) in expected.iter().enumerate() {
        for (c, expected) in expected.iter().enumerate() {
            let found = f64::from(picture.samples[3 * pixel + c]);
            assert!((found - expected).abs() < 2e-3, "{pixel} {c}: {found} {expected}");
        }
    }
}

/// A sphere far away is a point; of an asset that is linear in direction (SH of order 1) its light is known in
/// closed form near by.
#[test]
fn spheres_have_the_irradiance_of_their_disc() {
    let mut maps = asset("sh", 4, Layout::Grey, Space::Linear, 2);
    // Sample = z of the direction: 1 / 0.4886 times Y_10.
    let factors = [0.0, 0.0, 1.0 / 0.488_602_5, 0.0];
    for (plane, factor) in maps.planes.iter_mut().zip(factors) {
        *plane = RelightingMap { scale: 1.0, bias: factor, texels: Texels::F32(vec![0.0; SIZE.0 * SIZE.1]) };
    }
    let position = [0.3, -0.2, 1.1];
    for (radius, samples, tolerance) in [(0.01, 1, 2e-3), (0.5, 64, 5e-3), (0.9, 256, 5e-3)] {
        let lamp = Lamp::Sphere { position, radius, samples };
        let scene = scene(vec![Light { attenuation: NEAR, intensity: 3.0, ..light(lamp) }]);
        let (picture, _) = drawn(&maps, &scene, settings());
        for (pixel, point) in positions().points.iter().enumerate() {
            let to = [0, 1, 2].map(|i| position[i] - f64::from(point[i]));
            let squared = to.iter().map(|c| c * c).sum::<f64>();
            if squared.is_nan() || squared > 1e10 || squared < radius * radius {
                continue;
            }
            // The integral of z over a disc of radiance I / (pi r^2), over pi: I / d^2 times its middle's z.
            let expected = 3.0 / squared * to[2] / squared.sqrt();
            let found = f64::from(picture.samples[pixel]);
            assert!(
                (found - expected).abs() < tolerance * (3.0 / squared),
                "{radius} {pixel}: {found} {expected}"
            );
        }
    }
    // Inside and at the middle it is as at the sphere's surface: finite.
    let lamp = Lamp::Sphere { position: positions().points[5000].map(f64::from), radius: 0.5, samples: 16 };
    let (picture, _) = drawn(&maps, &scene(vec![Light { attenuation: NEAR, ..light(lamp) }]), settings());
    assert!(picture.samples.iter().all(|s| s.is_finite() && s.abs() <= 8.1));
}

#[test]
fn a_gobo_colours_what_a_spot_lights() {
    let maps = asset("srbf", 9, Layout::Rgb, Space::Linear, 0);
    // Red where x is positive, blue elsewhere, black above.
    let samples = (0..16).flat_map(|i| match (i % 4, i / 4) {
        (_, 0..2) => [0.0; 3],
        (2.., _) => [1.0, 0.0, 0.0],
        _ => [0.0, 0.0, 1.0],
    });
    let picture = Picture { width: 4, height: 4, channels: 3, samples: samples.collect() };
    let up = Direction::new(0.0, 1.0, 0.0).unwrap();
    let with = |on| {
        let mut light = Light { attenuation: NEAR, ..spot([0.0, 0.0, 2.0], [0.0, 0.0, -1.0], 45.0, 45.0) };
        let Lamp::Spot(spot) = &mut light.lamp else { unreachable!() };
        spot.gobo = Some(Gobo { picture: picture.clone(), up, on });
        drawn(&maps, &scene(vec![light]), settings()).0
    };
    let (on, off) = (with(true), with(false));
    // Seen from above with y up the axis points down: right of the lamp's view is x x .. of the world.
    for (pixel, point) in positions().points.iter().enumerate() {
        let inside = |c: f32| c.abs() > 0.7 && c.abs() < 1.0;
        if !(inside(point[0]) && inside(point[1])) || point[2].abs() > 0.3 {
            continue;
        }
        let [r, g, b] = [0, 1, 2].map(|c| (on.samples[3 * pixel + c], off.samples[3 * pixel + c]));
        assert_eq!(g.0, 0.0);
        if point[1] > 0.0 {
            assert_eq!((r.0, b.0), (0.0, 0.0), "black above");
        } else if point[0] > 0.0 {
            assert!((r.0 / r.1 - 1.0).abs() < 1e-5 && b.0 == 0.0, "{point:?}: {r:?} {b:?}");
        } else {
            assert!((b.0 / b.1 - 1.0).abs() < 1e-5 && r.0 == 0.0, "{point:?}: {r:?} {b:?}");
        }
    }
}

/// What is skipped by its bound is less than half a step, and the bound holds for what is not.
#[test]
fn lights_out_of_reach_are_skipped_and_no_pixel_differs_by_half_a_step() {
    let step = 1.0 / (255.0 * 12.92);
    for (family, count, layout, space) in [
        ("srbf", 25, Layout::Rgb, Space::Linear),
        ("sh", 16, Layout::Lrgb, Space::Encoded),
        ("hsh", 16, Layout::Grey, Space::Linear),
        ("ptm", 15, Layout::Rgb, Space::Encoded),
    ] {
        let maps = asset(family, count, layout, space, 0);
        let mut next = random(3);
        let mut lights = vec![
            Light { attenuation: NEAR, ..point([0.0, 0.0, 0.5]) },
            Light { attenuation: NEAR, ..spot([-2.0, 1.0, 1.0], [0.0, 0.0, -1.0], 10.0, 5.0) },
        ];
        for _ in 0..60 {
            let position = [next() * 2000.0 - 1000.0, next() * 2000.0 - 1000.0, 1000.0];
            lights.push(Light { attenuation: NEAR, intensity: next() * 0.2, ..point(position) });
        }
        let scene = scene(lights);
        let (whole, none_skipped) = drawn(&maps, &scene, settings());
        let (picture, report) = drawn(&maps, &scene, Settings { step, ..settings() });
        let worst =
            whole.samples.iter().zip(&picture.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(f64::from(worst) <= 0.5 * step, "{family}: {worst} of {step}");
        assert!(report.local[2..].iter().all(|light| light.evaluated == 0), "{family}");
        assert!(
            report.local[0].skipped == 0 && report.local[1].skipped > 0,
            "{family} {:?}",
            report.local[1]
        );
        let by_reach: usize = none_skipped.local.iter().map(|light| light.skipped).sum();
        assert!(by_reach > 0, "tiles that the spot can't reach");
    }
}

/// Bases ring below zero: such light is kept in the sum and counted.
#[test]
fn negative_light_is_kept_until_the_end_and_counted() {
    let mut maps = asset("sh", 4, Layout::Grey, Space::Linear, 2);
    for (plane, bias) in maps.planes.iter_mut().zip([0.0, 0.0, -1.0, 0.0]) {
        *plane = RelightingMap { scale: 1.0, bias, texels: Texels::F32(vec![0.0; SIZE.0 * SIZE.1]) };
    }
    let above = light(Lamp::Directional { direction: Direction::OUT });
    let (picture, report) = drawn(&maps, &scene(vec![above.clone()]), settings());
    assert_eq!(report.negative, SIZE.0 * SIZE.1);
    assert!(picture.samples.iter().all(|s| (s + 0.488_602_5).abs() < 1e-6));
    // A second light makes up for it: a clamp in between would leave too much.
    let below = Light {
        intensity: 2.0,
        ..light(Lamp::Directional { direction: Direction::new(0.0, 0.0, -1.0).unwrap() })
    };
    let (picture, report) = drawn(&maps, &scene(vec![above, below]), settings());
    assert_eq!(report.negative, 0);
    assert!(picture.samples.iter().all(|s| (s - 0.488_602_5).abs() < 1e-6));
}

#[test]
fn lights_that_do_nothing_are_named() {
    let model = asset("ptm", 6, Layout::Rgb, Space::Encoded, 0).model;
    let dome = Model { lights: fibonacci_in(Cap { axis: Direction::OUT, radius: 1.4 }, 40), ..model };
    let scene = scene(vec![
        Light { intensity: 0.0, ..point([0.0; 3]) },
        Light { color: [0.0; 3], ..light(Lamp::Directional { direction: Direction::OUT }) },
        spot([0.0; 3], [0.0, 0.0, 1.0], 0.0, 0.0),
        light(Lamp::Directional { direction: Direction::new(0.1, 0.0, -1.0).unwrap() }),
        light(Lamp::Directional { direction: Direction::OUT }),
    ]);
    let plan = Plan::new(&scene, &dome, Accuracy::Exact);
    assert_eq!(plan.dark.iter().map(|(index, _)| *index).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(!plan.reads_positions());
    assert_eq!(plan.channels, 3);
}
