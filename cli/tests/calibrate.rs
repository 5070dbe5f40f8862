//! Lamps from their highlights on chrome spheres, which the tests render themselves.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::vectors::{difference, dot, length, scaled, unit};
use relight_formats::read_light_file;
use scene::pictures::encoded;
use scene::relight;
use std::fs;
use std::path::Path;

const SIZE: (usize, usize) = (960, 720);

/// Rays across and down a pixel of a sphere.
const FINE: usize = 4;

/// Radiance of a lamp: its highlight is clipped at a little more than half of it.
const LAMP: f64 = 3.0;

/// A sphere resting on the plane z = 0: x, y of its middle from the middle of the picture, y up, and its radius.
type Sphere = [f64; 3];

#[derive(Clone, Copy)]
enum Lamp {
    /// A disc of 2 degrees' radius.
    Far([f64; 3]),
    /// A ball of 45 pixels' radius.
    Near([f64; 3]),
    Off,
}

/// What a camera sees: chrome spheres on a matte, stained plane.
struct Room {
    spheres: Vec<Sphere>,
    /// Height of the eye.
    eye: Option<f64>,
}

/// The way to the nearer of the points in which a ray meets a sphere.
fn meets(origin: [f64; 3], direction: [f64; 3], centre: [f64; 3], radius: f64) -> Option<f64> {
    let from = difference(origin, centre);
    let half = dot(from, direction);
    let rest = half * half - dot(from, from) + radius * radius;
    let way = -half - rest.max(0.0).sqrt();
    (rest > 0.0 && way > 1e-6).then_some(way)
}

impl Room {
    fn ray(&self, x: f64, y: f64) -> ([f64; 3], [f64; 3]) {
        match self.eye {
            None => ([x, y, 1e4], [0.0, 0.0, -1.0]),
            Some(eye) => ([0.0, 0.0, eye], unit([x, y, -eye]).unwrap()),
        }
    }

    fn first_hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let hits = self.spheres.iter().filter_map(|&[x, y, radius]| {
            Some((meets(origin, direction, [x, y, radius], radius)?, [x, y, radius]))
        });
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Radiance along a ray.
    fn seen(&self, origin: [f64; 3], direction: [f64; 3], lamp: Lamp, bounces: usize) -> f64 {
        if let Some((way, centre)) = self.first_hit(origin, direction) {
            if bounces == 3 {
                return 0.0;
            }
            let at: [f64; 3] = std::array::from_fn(|c| origin[c] + way * direction[c]);
            let normal = unit(difference(at, centre)).unwrap();
            let mirrored = difference(direction, scaled(normal, 2.0 * dot(direction, normal)));
            return 0.6 * self.seen(at, mirrored, lamp, bounces + 1);
        }
        if direction[2] < -1e-9 {
            let way = -origin[2] / direction[2];
            return self.plane(std::array::from_fn(|c| origin[c] + way * direction[c]), lamp);
        }
        let room = 0.02 + 0.03 * (0.5 + 0.5 * direction[0]);
        let lit = match lamp {
            Lamp::Far(to) => dot(direction, to) > libm::cos(2.0f64.to_radians()),
            Lamp::Near(at) => meets(origin, direction, at, 45.0).is_some(),
            Lamp::Off => false,
        };
        if lit { LAMP } else { room }
    }

    fn plane(&self, at: [f64; 3], lamp: Lamp) -> f64 {
        let stain = 0.45 + 0.1 * libm::sin(0.05 * at[0] + 0.02 * at[1]) + 0.05 * libm::sin(0.31 * at[1]);
        let (to, strength) = match lamp {
            Lamp::Far(to) => (to, 0.8),
            Lamp::Near(lamp) => {
                let way = difference(lamp, at);
                (unit(way).unwrap(), (750.0 / length(way)).powi(2))
            }
            Lamp::Off => return 0.05 * stain,
        };
        let lit = if self.first_hit(at, to).is_none() { strength * to[2].max(0.0) } else { 0.0 };
        stain * (0.05 + lit)
    }

    /// Writes an 8-bit PNG with some noise.
    fn photograph(&self, path: &Path, lamp: Lamp) {
        let mut seed = 0x2545_f491_4f6c_dd1du64;
        let picture = image::RgbImage::from_fn(SIZE.0 as u32, SIZE.1 as u32, |column, row| {
            let at = |right: f64, down: f64| {
                self.ray(
                    f64::from(column) + right - 0.5 * SIZE.0 as f64,
                    0.5 * SIZE.1 as f64 - f64::from(row) - down,
                )
            };
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
            let is_mirror = corners.iter().any(|&(right, down)| {
                let (origin, direction) = at(right, down);
                self.first_hit(origin, direction).is_some()
            });
            let fine = if is_mirror { FINE } else { 1 };
            let mut sum = 0.0;
            for ray in 0..fine * fine {
                let part = |at: usize| (at as f64 + 0.5) / fine as f64;
                let (origin, direction) = at(part(ray % fine), part(ray / fine));
                sum += self.seen(origin, direction, lamp, 0) / (fine * fine) as f64;
            }
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = 0.006 * ((seed >> 33) as f64 / f64::from(u32::MAX / 2) - 1.0);
            let code = (255.0 * encoded((sum + noise).clamp(0.0, 1.0)) + 0.5) as u8;
            image::Rgb([code, code, code.saturating_sub(2)])
        });
        picture.save(path).unwrap();
    }

    /// Photographs named p1.png, p2.png .. in `folder`/set.
    fn photographs(&self, folder: &Path, lamps: &[Lamp]) {
        fs::create_dir(folder.join("set")).unwrap();
        std::thread::scope(|scope| {
            for (i, lamp) in lamps.iter().enumerate() {
                scope.spawn(move || self.photograph(&folder.join(format!("set/p{}.png", i + 1)), *lamp));
            }
        });
    }

    /// The option that names a sphere by its outline, which is found by probing for its edge.
    fn option(&self, sphere: Sphere) -> String {
        let [cx, cy, radius] = sphere;
        let hit = |x: f64, y: f64| {
            let (origin, direction) = self.ray(x, y);
            meets(origin, direction, [cx, cy, radius], radius).is_some()
        };
        let start = self.eye.map_or([cx, cy], |eye| [cx * eye / (eye - radius), cy * eye / (eye - radius)]);
        let edge: Vec<[f64; 2]> = (0..720)
            .map(|i| {
                let (sine, cosine) = libm::sincos(f64::from(i) * std::f64::consts::TAU / 720.0);
                let (mut near, mut far) = (0.0, 3.0 * radius);
                for _ in 0..50 {
                    let way = 0.5 * (near + far);
                    if hit(start[0] + way * cosine, start[1] + way * sine) { near = way } else { far = way }
                }
                [start[0] + near * cosine, start[1] + near * sine]
            })
            .collect();
        let bounds = |c: usize| {
            let values = edge.iter().map(|point| point[c]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let ((left, right), (bottom, top)) = (bounds(0), bounds(1));
        // The half extents of an ellipse have the squares of its half axes as their sum of squares.
        let mean = ((0.25 * (right - left).powi(2) + 0.25 * (top - bottom).powi(2)) / 2.0).sqrt();
        let (x, y) = (0.5 * (left + right) + 0.5 * SIZE.0 as f64, 0.5 * SIZE.1 as f64 - 0.5 * (bottom + top));
        format!("--sphere {x:.3},{y:.3},{mean:.3}")
    }
}

/// Directions all around, from 75 degrees above the plane down to the lowest.
fn directions(count: usize, lowest_deg: f64) -> Vec<[f64; 3]> {
    let direction = |i: usize| {
        let elevation = (75.0 - (75.0 - lowest_deg) * i as f64 / (count - 1) as f64).to_radians();
        let (sine, cosine) = libm::sincos(2.4 * i as f64 + 0.3);
        [libm::cos(elevation) * cosine, libm::cos(elevation) * sine, libm::sin(elevation)]
    };
    (0..count).map(direction).collect()
}

fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    let difference = length(difference(unit(a).unwrap(), unit(b).unwrap()));
    (2.0 * libm::asin(0.5 * difference)).to_degrees()
}

/// Vectors of a light file, whose lines must name p1.png, p2.png .. in that order.
#[track_caller]
fn vectors(path: &Path) -> Vec<[f64; 3]> {
    let file = read_light_file(path).unwrap();
    for (i, entry) in file.entries.iter().enumerate() {
        assert_eq!(entry.name, format!("p{}.png", i + 1));
    }
    assert_eq!(file.declared, Some(file.entries.len()));
    file.entries.iter().map(|entry| entry.vector).collect()
}

/// The largest angle in degrees between found and true directions.
#[track_caller]
fn worst_deg(found: &[[f64; 3]], expected: &[[f64; 3]]) -> f64 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(a, b)| angle_deg(*a, *b)).fold(0.0, f64::max)
}

#[test]
fn far_lamps_are_found_to_three_tenths_of_a_degree() {
    let directions = directions(10, 12.0);
    for (what, eye, fov) in [
        ("orthographic", None, String::new()),
        ("perspective", Some(1350.0), {
            format!(" --fov {:.6}", 2.0 * libm::atan(480.0f64 / 1350.0).to_degrees())
        }),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let room = Room { spheres: vec![[-230.3, 62.7, 138.6]], eye };
        let lamps: Vec<Lamp> = directions.iter().map(|d| Lamp::Far(*d)).collect();
        room.photographs(folder.path(), &lamps);
        let option = room.option(room.spheres[0]);
        relight(folder.path(), &format!("calibrate set {option}{fov} -o a.lp")).ok();
        let worst = worst_deg(&vectors(&folder.path().join("a.lp")), &directions);
        println!("{what}: worst {worst:.3} deg");
        assert!(worst < 0.3, "{what}: {worst}");
        if eye.is_some() {
            // Taken for orthographic the same pictures say something else.
            relight(folder.path(), &format!("calibrate set {option} -o b.lp")).ok();
            let found = vectors(&folder.path().join("b.lp"));
            let wrong = worst_deg(&found, &directions[..found.len()]);
            assert!(wrong > 2.0, "{wrong}");
            continue;
        }
        // Looking for the sphere gives the same.
        let run = relight(folder.path(), "calibrate set --sphere auto -o c.lp").ok();
        assert!(run.stdout.contains("sphere found at 249."), "{}", run.stdout);
        let worst = worst_deg(&vectors(&folder.path().join("c.lp")), &directions);
        println!("auto: worst {worst:.3} deg, {}", run.stdout.lines().next().unwrap());
        assert!(worst < 1.0, "{worst}");
        // With any number of threads the same bytes.
        relight(folder.path(), "calibrate set --sphere auto -o d.lp -j 1").ok();
        let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
        assert_eq!(bytes("c.lp"), bytes("d.lp"));
    }
}

#[test]
fn near_lamps_are_found_to_a_hundredth_of_their_distance() {
    let places: Vec<[f64; 3]> =
        directions(6, 22.0).iter().map(|d| scaled(*d, 1150.0 + 250.0 * d[0])).collect();
    for (what, eye, fov) in [("orthographic", None, ""), ("perspective", Some(2250.0), " --fov 24.0850")] {
        let folder = tempfile::tempdir().unwrap();
        let room = Room {
            spheres: vec![[-331.2, 210.7, 132.3], [323.4, -196.1, 138.7], [-315.5, -203.2, 126.4]],
            eye,
        };
        let lamps: Vec<Lamp> = places.iter().map(|p| Lamp::Near(*p)).collect();
        room.photographs(folder.path(), &lamps);
        let options: Vec<String> = room.spheres.iter().map(|sphere| room.option(*sphere)).collect();
        for count in [3, 2] {
            let options = options[..count].join(" ");
            let line = format!("calibrate set {options}{fov} -o a.lp --positions p.txt --scale 0.5");
            relight(folder.path(), &line).ok();
            let found = vectors(&folder.path().join("p.txt"));
            assert_eq!(found.len(), places.len());
            let misses = found
                .iter()
                .zip(&places)
                .map(|(found, place)| length(difference(scaled(*found, 2.0), *place)) / length(*place));
            let worst = misses.fold(0.0, f64::max);
            println!("{what}, {count} spheres: worst {:.2} % of the distance", 100.0 * worst);
            assert!(worst < 0.01, "{what}, {count} spheres: {worst}");
            // Directions are those from the middle of the picture.
            let worst = worst_deg(&vectors(&folder.path().join("a.lp")), &places);
            assert!(worst < 0.3, "{what}, {count} spheres: {worst}");
        }
    }
}

#[test]
fn dark_pictures_are_left_out_and_what_is_no_sphere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let room = Room { spheres: vec![[-90.3, 31.2, 128.1]], eye: None };
    let directions = directions(4, 30.0);
    let mut lamps: Vec<Lamp> = directions.iter().map(|d| Lamp::Far(*d)).collect();
    lamps.push(Lamp::Off);
    room.photographs(folder.path(), &lamps);
    let option = room.option(room.spheres[0]);
    let run = relight(folder.path(), &format!("calibrate set {option} -o a.lp")).ok();
    assert!(run.stderr.contains("p5.png shows no highlight and is left out"), "{}", run.stderr);
    assert!(worst_deg(&vectors(&folder.path().join("a.lp")), &directions) < 0.3);

    // Two spheres far from each other see a far lamp in one direction.
    let two = format!("calibrate set {option} {option} -o b.lp --positions p.txt");
    relight(folder.path(), &two).assert_refused(3, &["no lamp has a position"]);
    relight(folder.path(), &format!("calibrate set {option} -o b.lp --positions p.txt"))
        .assert_refused(2, &["two or more spheres"]);
    relight(folder.path(), "calibrate set --sphere 860,60,50 -o b.lp")
        .assert_refused(3, &["no picture", "--sphere"]);
    for (sphere, words) in [
        ("970,20,30", "outside the pictures"),
        ("100,20,0.5", "radius of 0.5"),
        ("1,2", "write auto"),
        ("1,2,x", "write auto"),
    ] {
        relight(folder.path(), &format!("calibrate set --sphere {sphere} -o b.lp"))
            .assert_refused(2, &[words]);
    }
    relight(folder.path(), "calibrate set --sphere 480,360,350 --fov 120 -o b.lp")
        .assert_refused(2, &["--fov"]);
    relight(folder.path(), &format!("calibrate nowhere {option} -o b.lp")).assert_refused(4, &["nowhere"]);
    relight(folder.path(), &format!("calibrate set {option} -o set/p1.png"))
        .assert_refused(2, &["another file"]);
    // Without a sphere none is found.
    let bare = tempfile::tempdir().unwrap();
    Room { spheres: Vec::new(), eye: None }.photographs(bare.path(), &lamps[..3]);
    relight(bare.path(), "calibrate set --sphere auto -o b.lp")
        .assert_refused(3, &["0 of 1 spheres", "--sphere X,Y,R"]);
    assert!(!folder.path().join("b.lp").exists() && !bare.path().join("b.lp").exists());
}
