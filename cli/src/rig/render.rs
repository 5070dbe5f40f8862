//! `relight rig render`.

use super::bake::positive;
use super::digits;
use super::mesh::PartMeshes;
use super::scene::{Moment, Moments, moments};
use super::window::{WindowChoice, ringing_words};
use crate::failure::{Exit, Failure};
use crate::options::{Machine, MachineOptions, check_apart, check_sequence_folder, check_writable};
use crate::render::frame_paths;
use crate::say::say;
use crate::view::{color_of, size_of, three_of};
use crate::{interrupt, progress};
use clap::{Args, ValueEnum};
use relight_core::relighter::Picture;
use relight_core::vectors::{difference, length, scaled, unit};
use relight_core::{Camera, Projection, Space, srgb_from_linear};
use relight_formats::{
    PictureDepth, RigFile, create_folder, picture_depths, read_camera_file, read_rig, write_picture,
};
use relight_rig::{Bands, LightPlan, Pixels, PlacedPart, Plan, Reflected, Ringing, Window, plan};
use relight_surface::{Fragment, Mesh, rasterize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What to draw.
#[derive(Args, Debug)]
#[group(id = "rig_render")]
pub(super) struct RenderArguments {
    /// The rig: .rig
    rig: PathBuf,
    /// The mesh that it was baked from
    #[arg(long, value_name = "MESH")]
    mesh: PathBuf,
    /// The scene: lights, how the mesh moves, a sequence
    #[arg(long, value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The picture to write (.png or .exr); for a sequence a folder of them
    #[arg(short, long, value_name = "FILE|FOLDER")]
    output: PathBuf,
    /// brute-force: every light at every pixel; rig: all through the rig; plan: each as `relight rig plan` says
    #[arg(long, value_name = "WAY", value_enum, default_value = "plan")]
    by: Way,
    /// Largest error in grey levels that the plan may make
    #[arg(long, value_name = "GREY", default_value = "1", allow_negative_numbers = true, value_parser = positive)]
    tolerance: f64,
    /// Also draw by brute force, say how the two differ in grey levels and time, and write the difference: mid-grey where they
    /// agree, 16 levels for each level of difference
    #[arg(long, value_name = "FILE.png|FOLDER")]
    difference: Option<PathBuf>,
    /// Weigh bands of the rig's harmonics so that light does not ring below 0, and say what that costs: the difference to brute force
    /// with and without
    #[arg(long, value_name = "WINDOW", value_enum)]
    window: Option<WindowChoice>,
    /// How the mesh is seen: a camera file, or one that looks at it from the front (-y) and above
    #[arg(long, value_name = "CAMERA.json")]
    camera: Option<PathBuf>,
    /// Direction from which it is seen without a camera file
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of, default_value = "0.6,-1,0.4")]
    from: [f64; 3],
    /// What is up in the picture without a camera file
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three_of, default_value = "0,0,1")]
    up: [f64; 3],
    /// Pixels of the picture without a camera file
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size_of)]
    size: (usize, usize),
    /// Linear colour where the mesh is not
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = color_of)]
    background: [f32; 3],
    /// Linear colour of the mesh
    #[arg(long, value_name = "R,G,B", default_value = "1,1,1", value_parser = color_of)]
    albedo: [f32; 3],
    /// Samples along a pixel's side
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u8).range(1..=8))]
    samples: u8,
    #[command(flatten)]
    machine: MachineOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Way {
    BruteForce,
    Rig,
    Plan,
}

/// Bytes of a sample of a picture on its way: what it sees, what it gets, two pictures.
const BYTES_OF_SAMPLE: u64 = 120;

/// Grey levels of the difference picture for one of difference.
const MAGNIFIED: f32 = 16.0;

/// Most pictures that a window is fitted to.
const MOST_PICTURES: usize = 64;

/// How far two ways to draw are apart, and what they take.
#[derive(Default)]
struct Tally {
    largest_grey: f64,
    /// Without the window, if there is one.
    largest_grey_without: f64,
    /// By part, of pixels.
    ringing: Vec<Ringing>,
    ringing_without: Vec<Ringing>,
    seconds: f64,
    brute_force_seconds: f64,
    pixels: usize,
    pictures: usize,
}

/// Runs the subcommand.
pub(super) fn run(arguments: &RenderArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    if arguments.window.is_some() && arguments.by == Way::BruteForce {
        return Err(Failure::usage(
            "--window weighs bands, which brute force has not; give --by rig or plan",
        ));
    }
    let file = read_rig(&arguments.rig, machine.memory)?;
    let meshes = PartMeshes::of_rig(&arguments.mesh, &file, &arguments.rig, machine.memory)?;
    let moments = moments(&arguments.scene, &file, &machine)?;
    let is_sequence = moments.is_sequence;
    let paths = |output: &Path| match is_sequence {
        true => frame_paths(output, moments.list.len(), "png").collect(),
        false => vec![output.to_owned()],
    };
    if is_sequence {
        [&arguments.output]
            .into_iter()
            .chain(&arguments.difference)
            .try_for_each(|path| check_sequence_folder(path))?;
    }
    let outputs = paths(&arguments.output);
    let differences = arguments.difference.as_ref().map(|output| paths(output));
    let depth = picture_depths(&outputs[0]).map_err(Failure::of_output)?[0];
    if let Some(path) = differences.iter().flatten().next()
        && picture_depths(path).map_err(Failure::of_output)?[0] != PictureDepth::U8
    {
        return Err(Failure::usage(format!("{}: a difference is a .png", path.display())));
    }
    let inputs = moments.inputs.iter().chain([&arguments.rig, &arguments.mesh]).chain(&arguments.camera);
    check_apart(outputs.iter().chain(differences.iter().flatten()), inputs)?;
    let camera = arguments.camera(&file, &moments.list[0])?;
    check_size(&camera, arguments.samples, machine.memory)?;
    for folder in [&arguments.output].into_iter().chain(&arguments.difference) {
        if is_sequence { create_folder(folder)? } else { check_writable(folder)? }
    }
    let pictures = moments.pictures(&file);
    let plan = (arguments.by == Way::Plan)
        .then(|| plan(&pictures, file.rig.bands, arguments.tolerance, machine.level));
    let bands = arguments.bands(&file, &moments, plan.as_ref(), &machine);
    let plain = vec![Bands::from(file.rig.bands); bands.len()];
    let mut tally = Tally {
        ringing: vec![Ringing::default(); bands.len()],
        ringing_without: vec![Ringing::default(); bands.len()],
        ..Tally::default()
    };
    let bar = progress::bar("rendering", moments.list.len());
    for (frame, moment) in moments.list.iter().enumerate() {
        interrupt::check()?;
        let drawing = Drawing { arguments, file: &file, meshes: &meshes, camera, moment, machine };
        let seen = drawing.seen()?;
        let start = Instant::now();
        let plans = plan.as_ref().map(|plan| &plan.pictures[frame].parts[..]);
        let lit = drawing.lit(&seen, arguments.by, plans, &bands);
        tally.seconds += start.elapsed().as_secs_f64();
        add_ringing(&mut tally.ringing, &lit);
        let picture = drawing.picture(&seen, &lit);
        if differences.is_some() || arguments.window.is_some() {
            let start = Instant::now();
            let exact = drawing.lit(&seen, Way::BruteForce, None, &plain);
            tally.brute_force_seconds += start.elapsed().as_secs_f64();
            let exact = drawing.picture(&seen, &exact);
            let (difference, largest) = difference_of(&picture, &exact);
            tally.largest_grey = tally.largest_grey.max(largest);
            if let Some(differences) = &differences {
                write_picture(&differences[frame], &difference, PictureDepth::U8)?;
            }
            if arguments.window.is_some() {
                let without = drawing.lit(&seen, arguments.by, plans, &plain);
                add_ringing(&mut tally.ringing_without, &without);
                let (_, largest) = difference_of(&drawing.picture(&seen, &without), &exact);
                tally.largest_grey_without = tally.largest_grey_without.max(largest);
            }
        }
        let picture = if depth.is_linear() { picture } else { picture.encoded_from(Space::Linear) };
        write_picture(&outputs[frame], &picture, depth)?;
        tally.pixels += seen.pixels.iter().map(Pixels::len).sum::<usize>();
        tally.pictures += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    tally.print(arguments, &file, &bands);
    Ok(())
}

impl Tally {
    fn print(&self, arguments: &RenderArguments, file: &RigFile, bands: &[Bands]) {
        let milliseconds = |seconds: f64| digits(1e3 * seconds / self.pictures as f64);
        say!("{} ms a picture of {} lit pixels", milliseconds(self.seconds), self.pixels / self.pictures);
        if arguments.difference.is_some() || arguments.window.is_some() {
            say!(
                "by brute force {} ms, {} times as long; largest difference {} grey levels",
                milliseconds(self.brute_force_seconds),
                digits(self.brute_force_seconds / self.seconds),
                digits(self.largest_grey)
            );
        }
        if arguments.by == Way::BruteForce {
            return;
        }
        for (part, ringing) in file.rig.parts.iter().zip(&self.ringing) {
            say!("{}", ringing_words(&part.name, ringing, "pixels"));
        }
        if arguments.window.is_some() {
            say!("without the window: largest difference {} grey levels", digits(self.largest_grey_without));
            for ((part, ringing), bands) in file.rig.parts.iter().zip(&self.ringing_without).zip(bands) {
                let factors = bands.window.factors[..bands.count].iter().map(|factor| digits(*factor));
                let factors = factors.collect::<Vec<_>>().join(" ");
                say!("{}; bands count {factors}", ringing_words(&part.name, ringing, "pixels"));
            }
        }
    }
}

fn check_size(camera: &Camera, samples: u8, memory: u64) -> Result<(), Failure> {
    let samples = u64::from(samples) * u64::from(samples);
    let bytes = (camera.width as u64 * camera.height as u64).saturating_mul(samples * BYTES_OF_SAMPLE);
    if bytes <= memory {
        return Ok(());
    }
    let words = format!(
        "a picture of {} x {} pixels and {samples} samples each takes {} MiB, more than the {} MiB allowed; give a smaller one or \
         raise --memory",
        camera.width,
        camera.height,
        bytes >> 20,
        memory >> 20
    );
    Err(Failure::new(Exit::OverBudget, words))
}

fn add_ringing(ringing: &mut [Ringing], lit: &[Reflected]) {
    for (ringing, [r, g, b]) in ringing.iter_mut().zip(lit) {
        let values = r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b].map(f64::from));
        *ringing = ringing.and(Ringing::of(values));
    }
}

impl RenderArguments {
    /// By part, one for all pictures: nothing pops.
    fn bands(&self, file: &RigFile, moments: &Moments, plan: Option<&Plan>, machine: &Machine) -> Vec<Bands> {
        let count = file.rig.bands;
        let step = moments.list.len().div_ceil(MOST_PICTURES).max(1);
        let window = |part: usize| {
            let of_moment = |(picture, moment): (usize, &Moment)| {
                let placed = PlacedPart { part: &file.rig.parts[part], placement: moment.placements[part] };
                let plans = plan.map(|plan| &plan.pictures[picture].parts[part][..]);
                placed.reflectance_by_band(&moment.lights, plans, count, machine.level)
            };
            let points = || moments.list.iter().enumerate().step_by(step).flat_map(of_moment).collect();
            self.window.map_or(Window::NONE, |choice| choice.window(count, points))
        };
        (0..file.rig.parts.len()).map(|part| Bands { count, window: window(part) }).collect()
    }

    fn camera(&self, file: &RigFile, first: &Moment) -> Result<Camera, Failure> {
        if let Some(path) = &self.camera {
            return Ok(read_camera_file(path)?);
        }
        let middles = file
            .rig
            .parts
            .iter()
            .zip(&first.placements)
            .map(|(part, placement)| (placement.point(part.frame.centre), part.frame.radius));
        let middles: Vec<_> = middles.collect();
        let centre = [0, 1, 2]
            .map(|i| middles.iter().map(|(middle, _)| middle[i]).sum::<f64>() / middles.len() as f64);
        let reach = middles.iter().map(|&(middle, radius)| length(difference(middle, centre)) + radius);
        let radius = reach.fold(0.0, f64::max);
        let from = unit(self.from).ok_or_else(|| {
            Failure::usage("--from 0,0,0 is no direction; give where the mesh is seen from")
        })?;
        let (width, height) = self.size;
        /// Angle of the view, radians.
        const FOV: f64 = 0.6;
        // The sphere fills the shorter side.
        let half = 0.5 * FOV;
        let share = (height as f64 / width as f64).min(1.0);
        let distance = radius / libm::sin(libm::atan(libm::tan(half) * share));
        let eye = scaled(from, distance);
        let eye = [0, 1, 2].map(|i| centre[i] + eye[i]);
        Camera::new(Projection::Perspective { fov_x: FOV }, (width, height), eye, centre, self.up)
            .map_err(|error| Failure::usage(format!("--from and --up: {error}")))
    }
}

/// A picture about to be drawn.
struct Drawing<'a> {
    arguments: &'a RenderArguments,
    file: &'a RigFile,
    meshes: &'a PartMeshes,
    camera: Camera,
    moment: &'a Moment,
    machine: Machine,
}

/// What a picture sees: by part its pixels, and which samples of the picture they are.
struct Seen {
    pixels: Vec<Pixels>,
    places: Vec<Vec<usize>>,
    width: usize,
    height: usize,
}

impl<'a> Drawing<'a> {
    fn placed(&self, part: usize) -> PlacedPart<'a> {
        PlacedPart { part: &self.file.rig.parts[part], placement: self.moment.placements[part] }
    }

    fn seen(&self) -> Result<Seen, Failure> {
        let samples = usize::from(self.arguments.samples);
        let camera = Camera {
            width: self.camera.width * samples,
            height: self.camera.height * samples,
            ..self.camera
        };
        let mut scene = Mesh::default();
        let mut owners = Vec::new();
        for (part, (_, mesh)) in self.meshes.parts.iter().enumerate() {
            let first = scene.positions.len() as u32;
            let placement = self.moment.placements[part];
            // From the eye, so that places far from the origin keep their digits.
            scene.positions.extend(mesh.positions.iter().map(|&position| {
                difference(placement.point(position.map(f64::from)), camera.eye).map(|c| c as f32)
            }));
            scene.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|vertex| first + vertex)));
            owners.extend(mesh.triangles.iter().enumerate().map(|(triangle, _)| (part, triangle)));
        }
        let (width, height) = (camera.width, camera.height);
        let mut seen = Seen {
            pixels: vec![Pixels::default(); self.meshes.parts.len()],
            places: vec![Vec::new(); self.meshes.parts.len()],
            width,
            height,
        };
        if scene.triangles.is_empty() {
            return Ok(seen);
        }
        let fragments = rasterize(&scene, &Camera { eye: [0.0; 3], ..camera }).map_err(|error| {
            Failure::new(Exit::BadInput, format!("{}: {error}", self.arguments.mesh.display()))
        })?;
        for (place, fragment) in fragments.fragments.iter().enumerate() {
            if fragment.triangle == Fragment::NOTHING {
                continue;
            }
            let (part, triangle) = owners[fragment.triangle as usize];
            let mesh = &self.meshes.parts[part].1;
            let corners = mesh.triangles[triangle];
            let blend = |values: &[[f32; 3]]| {
                [0, 1, 2].map(|axis| {
                    (0..3).fold(0.0, |sum, corner| {
                        sum + f64::from(fragment.weights[corner])
                            * f64::from(values[corners[corner] as usize][axis])
                    })
                })
            };
            seen.pixels[part].push(&self.placed(part), blend(&mesh.positions), blend(&mesh.normals));
            seen.places[part].push(place);
        }
        Ok(seen)
    }

    /// The light that each part's pixels reflect.
    fn lit(
        &self,
        seen: &Seen,
        way: Way,
        plans: Option<&[Vec<LightPlan>]>,
        bands: &[Bands],
    ) -> Vec<Reflected> {
        let (level, lights) = (self.machine.level, &self.moment.lights);
        let parts = seen.pixels.iter().enumerate().map(|(part, pixels)| {
            let placed = self.placed(part);
            match (way, plans) {
                _ if pixels.is_empty() => Reflected::default(),
                (Way::Rig, _) => pixels.by_rig(&placed, lights, bands[part], level),
                (Way::Plan, Some(plans)) => pixels.by_plan(&placed, lights, &plans[part], bands[part], level),
                _ => pixels.by_brute_force(&placed, lights, level),
            }
        });
        parts.collect()
    }

    /// The picture in linear light, each pixel the mean of its samples.
    fn picture(&self, seen: &Seen, lit: &[Reflected]) -> Picture {
        let samples = usize::from(self.arguments.samples);
        let (width, height) = (self.camera.width, self.camera.height);
        let share = 1.0 / (samples * samples) as f32;
        let mut out = vec![0.0f32; width * height * 3];
        let mut covered = vec![0.0f32; width * height];
        for (places, values) in seen.places.iter().zip(lit) {
            for (i, &place) in places.iter().enumerate() {
                let pixel = place / seen.width / samples * width + place % seen.width / samples;
                covered[pixel] += share;
                for c in 0..3 {
                    out[3 * pixel + c] += share * self.arguments.albedo[c] * values[c][i];
                }
            }
        }
        for (pixel, covered) in out.chunks_exact_mut(3).zip(covered) {
            for (value, background) in pixel.iter_mut().zip(self.arguments.background) {
                *value += (1.0 - covered).max(0.0) * background;
            }
        }
        debug_assert_eq!(seen.height, height * samples);
        Picture { width, height, channels: 3, samples: out }
    }
}

/// The difference of two linear pictures as an encoded one, and its largest value in grey levels of 8-bit pictures.
fn difference_of(picture: &Picture, exact: &Picture) -> (Picture, f64) {
    let mut largest = 0.0f64;
    let samples = picture.samples.iter().zip(&exact.samples).map(|(&a, &b)| {
        let difference = srgb_from_linear(a.clamp(0.0, 1.0)) - srgb_from_linear(b.clamp(0.0, 1.0));
        largest = largest.max(255.0 * f64::from(difference.abs()));
        (0.5 + MAGNIFIED * difference).clamp(0.0, 1.0)
    });
    let samples = samples.collect();
    (Picture { width: exact.width, height: exact.height, channels: exact.channels, samples }, largest)
}
