//! `relight preview`: an asset in a window, lit by dragging.

mod views;

use crate::failure::{Exit, Failure};
use crate::interrupt;
use crate::options::{Machine, MachineOptions};
use crate::say::say;
use crate::verify::backend_of;
use clap::Args;
use relight_core::{Direction, RelightingMaps};
use relight_formats::{PictureDepth, read_asset, read_packed, write_picture};
use relight_gpu::{Backend, GpuMaps, GpuPicture, GpuWindow, Showing, TextureMode};
use relight_texture::{PackedMaps, level_size};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use views::{View, Viewed};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, KeyEvent, MouseButton, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window, WindowId};

/// What to show.
#[derive(Args, Debug)]
#[group(id = "preview")]
pub(crate) struct PreviewArguments {
    /// The asset: .ktx2 or .dds, or the .json beside textures; .exr, .ptm and .rti too
    asset: PathBuf,
    /// The light to begin with: the vector towards it (x right, y up, z to the camera)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0,0,1",
        value_parser = direction_of)]
    light: Direction,
    /// The window's size in pixels; by default as the picture, within 512 to 1024
    #[arg(long, value_name = "WxH", value_parser = size_of)]
    size: Option<PhysicalSize<u32>>,
    /// How to reach the GPU: any, vulkan or gl
    #[arg(long, value_name = "BACKEND", default_value = "any", value_parser = backend_of)]
    backend: Backend,
    #[command(flatten)]
    machine: MachineOptions,
}

/// The keys, as the title says them.
const KEYS: &str =
    "drag: light, Space or 1 2 3: view, Left/Right: map, F: filter, S: save, R: reset, Esc: quit";

fn direction_of(text: &str) -> Result<Direction, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) => Direction::new(x, y, z).map_err(|error| error.to_string()),
        _ => Err(format!("'{text}' is not three numbers such as 0.3,-0.2,0.9")),
    }
}

fn size_of(text: &str) -> Result<PhysicalSize<u32>, String> {
    let side = |text: &str| text.trim().parse::<u32>().ok().filter(|side| (16..=16384).contains(side));
    let sides = text.split_once(['x', 'X']).and_then(|(width, height)| side(width).zip(side(height)));
    sides
        .map(PhysicalSize::from)
        .ok_or_else(|| format!("'{text}' is not a size within 16..16384 such as 800x600"))
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &PreviewArguments) -> Result<(), Failure> {
    let machine = arguments.machine.machine()?;
    let packed = read_packed(&arguments.asset, machine.memory)?;
    let taken: u64 = packed.texels.iter().flatten().map(|level| level.len() as u64).sum();
    let maps = read_asset(&arguments.asset, machine.memory.saturating_sub(taken))?;
    let no_windows = |error: winit::error::EventLoopError| {
        let message =
            format!("no window system to open a window in ({error}); relight render writes pictures without");
        Failure::new(Exit::Unsupported, message)
    };
    let events = EventLoop::new().map_err(no_windows)?;
    let mut preview = Preview {
        asset: &arguments.asset,
        size: arguments.size.unwrap_or_else(|| window_size(packed.width, packed.height)),
        backend: arguments.backend,
        packed,
        maps,
        machine,
        initial_light: arguments.light,
        light: arguments.light,
        view: View::Relit,
        smooth: true,
        help: false,
        pointer: PhysicalPosition::new(0.0, 0.0),
        dragging: false,
        shown: None,
        ended: Ok(()),
    };
    events.run_app(&mut preview).map_err(no_windows)?;
    preview.ended
}

/// The window for a picture: its larger side between 512 and 1024.
fn window_size(width: usize, height: usize) -> PhysicalSize<u32> {
    let larger = width.max(height);
    let scaled = |side: usize| (side * larger.clamp(512, 1024)).div_ceil(larger).max(16) as u32;
    PhysicalSize::new(scaled(width), scaled(height))
}

/// The window and what the GPU holds for it.
struct Shown {
    window: Arc<Window>,
    target: GpuWindow,
    maps: GpuMaps,
    /// What is shown, until light or view change.
    picture: Option<(GpuPicture, Showing)>,
    /// How long the last one took.
    took: Duration,
}

struct Preview<'a> {
    asset: &'a Path,
    size: PhysicalSize<u32>,
    backend: Backend,
    packed: PackedMaps,
    maps: RelightingMaps,
    machine: Machine,
    initial_light: Direction,
    light: Direction,
    view: View,
    smooth: bool,
    help: bool,
    pointer: PhysicalPosition<f64>,
    dragging: bool,
    shown: Option<Shown>,
    ended: Result<(), Failure>,
}

impl Preview<'_> {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), Failure> {
        let attributes = Window::default_attributes().with_inner_size(self.size).with_title("relight");
        let window = events.create_window(attributes).map_err(|error| {
            Failure::new(Exit::Unsupported, format!("the window system opens no window: {error}"))
        })?;
        let window = Arc::new(window);
        let size = window.inner_size();
        let target = GpuWindow::open(self.backend, &window, (size.width, size.height))?;
        // A program on the CPU decodes blocks anew for each texel it reads: thirty times as slow.
        let mode = if target.gpu.is_software() { TextureMode::Decoded } else { TextureMode::Native };
        let maps = GpuMaps::upload(&target.gpu, &self.packed, mode, None)?;
        say!("{}: {}; {KEYS}", self.asset.display(), target.gpu.name());
        self.shown = Some(Shown { window, target, maps, picture: None, took: Duration::ZERO });
        self.changed();
        Ok(())
    }

    /// Light or view changed: what is shown is made anew.
    fn changed(&mut self) {
        if let Some(shown) = &mut self.shown {
            shown.picture = None;
            shown.window.request_redraw();
        }
    }

    /// The mip level that suits the window.
    fn level(&self) -> usize {
        let size = self.size;
        let enough = |level: &usize| {
            level_size(self.packed.width, *level) >= size.width as usize
                && level_size(self.packed.height, *level) >= size.height as usize
        };
        (0..self.packed.packing.levels).take_while(enough).last().unwrap_or(0)
    }

    fn redraw(&mut self) -> Result<(), Failure> {
        let level = self.level();
        let viewed = Viewed { maps: &self.maps, light: self.light, cpu: self.machine.level };
        let Some(shown) = &mut self.shown else { return Ok(()) };
        let (picture, mut showing) = match shown.picture.take() {
            Some(drawn) => drawn,
            None => {
                let start = Instant::now();
                let drawn = viewed.draw(self.view, &shown.target.gpu, &mut shown.maps, level)?;
                shown.took = start.elapsed();
                drawn
            }
        };
        showing.smooth = self.smooth;
        shown.target.show(&picture, showing)?;
        shown.picture = Some((picture, showing));
        let [x, y, z] = self.light.components();
        let title = match self.help {
            true => KEYS.to_owned(),
            false => format!(
                "{} | light {x:.3}, {y:.3}, {z:.3} | {} | {:.1} ms | H: keys",
                self.asset.file_name().unwrap_or_default().to_string_lossy(),
                self.view.name(&self.maps),
                shown.took.as_secs_f64() * 1e3,
            ),
        };
        shown.window.set_title(&title);
        Ok(())
    }

    /// Writes what is shown, at full size, beside the asset under a name that is free.
    fn save(&mut self) -> Result<(), Failure> {
        let viewed = Viewed { maps: &self.maps, light: self.light, cpu: self.machine.level };
        let Some(shown) = &mut self.shown else { return Ok(()) };
        let picture = viewed.picture(self.view, &mut shown.maps)?;
        let stem = self.asset.file_stem().unwrap_or_default().to_string_lossy();
        let [x, y, z] = self.light.components();
        let name = format!("{stem}_{}_{x:.3}_{y:.3}_{z:.3}", self.view.file_word());
        let names = (1..).map(|n| if n == 1 { format!("{name}.png") } else { format!("{name}_{n}.png") });
        let mut paths = names.map(|name| self.asset.with_file_name(name));
        if let Some(path) = paths.find(|path| !path.exists()) {
            write_picture(&path, &picture, PictureDepth::U8)?;
            say!("saved {} (--light {x},{y},{z})", path.display());
        }
        Ok(())
    }

    fn key(&mut self, events: &ActiveEventLoop, key: &Key) -> Result<(), Failure> {
        let views = View::count(&self.maps);
        match key {
            Key::Named(NamedKey::Escape) => events.exit(),
            Key::Named(NamedKey::Space) => self.view = self.view.next(),
            Key::Named(NamedKey::ArrowRight) => self.view = self.view.step(views, 1),
            Key::Named(NamedKey::ArrowLeft) => self.view = self.view.step(views, views - 1),
            Key::Character(character) => match character.to_lowercase().as_str() {
                "1" => self.view = View::Relit,
                "2" => self.view = View::Map(0),
                "3" => self.view = View::Difference,
                "f" => self.smooth = !self.smooth,
                "h" => self.help = !self.help,
                "r" => (self.light, self.view) = (self.initial_light, View::Relit),
                "s" => self.save()?,
                _ => return Ok(()),
            },
            _ => return Ok(()),
        }
        self.changed();
        Ok(())
    }

    /// Puts the light where the pointer is on the hemisphere over the picture.
    fn drag(&mut self) {
        let (width, height) = (f64::from(self.size.width), f64::from(self.size.height));
        let light = light_at(self.pointer.x, self.pointer.y, width, height);
        if light != self.light {
            self.light = light;
            self.changed();
        }
    }

    fn handle(&mut self, events: &ActiveEventLoop, event: &WindowEvent) -> Result<(), Failure> {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => {
                self.size = *size;
                if let Some(shown) = &mut self.shown {
                    shown.target.resize(size.width, size.height)?;
                }
                self.changed();
            }
            WindowEvent::RedrawRequested => self.redraw()?,
            WindowEvent::CursorMoved { position, .. } => {
                self.pointer = *position;
                if self.dragging {
                    self.drag();
                }
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                self.dragging = *state == ElementState::Pressed;
                if self.dragging {
                    self.drag();
                }
            }
            WindowEvent::KeyboardInput {
                event: KeyEvent { logical_key, state: ElementState::Pressed, .. },
                is_synthetic: false,
                ..
            } => self.key(events, logical_key)?,
            _ => {}
        }
        Ok(())
    }

    /// Ends the preview at the first failure.
    fn keep(&mut self, events: &ActiveEventLoop, result: Result<(), Failure>) {
        if result.is_err() && self.ended.is_ok() {
            self.ended = result;
            events.exit();
        }
    }
}

/// The light over the point of a window of that size: straight above in the middle, level at a
/// circle that touches the nearer sides.
fn light_at(x: f64, y: f64, width: f64, height: f64) -> Direction {
    let radius = width.min(height).max(1.0) * 0.5;
    let (u, v) = ((x - width * 0.5) / radius, (height * 0.5 - y) / radius);
    let up = (1.0 - u * u - v * v).max(0.0).sqrt();
    Direction::new(u, v, up).unwrap_or(Direction::OUT)
}

impl ApplicationHandler for Preview<'_> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.shown.is_none() {
            let opened = self.open(events);
            self.keep(events, opened);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let handled = self.handle(events, &event);
        self.keep(events, handled);
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        // Signals only set a flag, which has to be looked at.
        events.set_control_flow(ControlFlow::WaitUntil(Instant::now() + Duration::from_millis(100)));
        self.keep(events, interrupt::check().map_err(Failure::from));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pointer_is_the_lights_shadow_on_the_picture() {
        assert_eq!(light_at(200.0, 100.0, 400.0, 200.0), Direction::OUT);
        // 60 right and 80 up of a radius of 100: level with the picture.
        let level = light_at(260.0, 20.0, 400.0, 200.0).components();
        assert!(level.iter().zip([0.6, 0.8, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{level:?}");
        let left_below = light_at(140.0, 100.0 + 48.0, 400.0, 200.0).components();
        let expected = [-0.6, -0.48, 0.64];
        assert!(left_below.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{left_below:?}");
        // Beyond the circle it stays level.
        assert_eq!(light_at(500.0, 100.0, 400.0, 200.0).components(), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn windows_keep_the_pictures_shape() {
        assert_eq!(window_size(6000, 4000), PhysicalSize::new(1024, 683));
        assert_eq!(window_size(64, 128), PhysicalSize::new(256, 512));
        assert_eq!(window_size(800, 600), PhysicalSize::new(800, 600));
        assert_eq!(window_size(4097, 1), PhysicalSize::new(1024, 16));
    }
}
