//! The adapter and its device.

use crate::GpuError;
use std::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use wgpu::rwh::{HasDisplayHandle, HasWindowHandle};
use wgpu::{
    Adapter, Backends, CommandBuffer, Device, DeviceDescriptor, DeviceType, Features, Instance,
    InstanceDescriptor, InstanceFlags, PollType, Queue, Surface,
};

/// The interface through which an adapter is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// The platform's own, OpenGL where there is no other.
    #[default]
    Any,
    /// Vulkan.
    Vulkan,
    /// OpenGL ES 3, on Linux through EGL.
    Gl,
}

impl Backend {
    /// The name on the command line: `any`, `vulkan` or `gl`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::Vulkan => "vulkan",
            Self::Gl => "gl",
        }
    }

    /// What is tried, in this order: looking for OpenGL takes a context, so it comes last.
    fn attempts(self) -> &'static [Backends] {
        match self {
            Self::Any => &[Backends::PRIMARY, Backends::GL],
            Self::Vulkan => &[Backends::VULKAN],
            Self::Gl => &[Backends::GL],
        }
    }
}

/// An adapter with its device. Clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub(crate) adapter: Adapter,
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    /// What went wrong since it was last asked for: wgpu says so by callbacks.
    trouble: Arc<Mutex<Option<GpuError>>>,
}

impl Gpu {
    /// Opens the fastest adapter of `backend`; software counts.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`], and [`GpuError::Refused`] when the driver fails.
    pub fn open(backend: Backend) -> Result<Self, GpuError> {
        for &backends in backend.attempts() {
            let instance = Instance::new(descriptor(backends));
            if let Some(adapter) = best_adapter(&instance, backends, None) {
                return Self::of_adapter(adapter);
            }
        }
        Err(GpuError::NoAdapter { backend, window: false })
    }

    /// Opens the fastest adapter of `backend` that draws into `window`.
    ///
    /// # Errors
    /// As [`Gpu::open`], and [`GpuError::Window`] when the window has no surface.
    pub(crate) fn open_for_window<W>(
        backend: Backend,
        window: &Arc<W>,
    ) -> Result<(Self, Surface<'static>), GpuError>
    where
        W: HasWindowHandle + HasDisplayHandle + Debug + Send + Sync + 'static,
    {
        let mut refused = GpuError::NoAdapter { backend, window: true };
        for &backends in backend.attempts() {
            let instance =
                Instance::new(descriptor(backends).with_display_handle(Box::new(Arc::clone(window))));
            match instance.create_surface(Arc::clone(window)) {
                Err(error) => refused = GpuError::Window { reason: error.to_string() },
                Ok(surface) => {
                    if let Some(adapter) = best_adapter(&instance, backends, Some(&surface)) {
                        return Ok((Self::of_adapter(adapter)?, surface));
                    }
                    refused = GpuError::NoAdapter { backend, window: true };
                }
            }
        }
        Err(refused)
    }

    fn of_adapter(adapter: Adapter) -> Result<Self, GpuError> {
        let opened = pollster::block_on(adapter.request_device(&DeviceDescriptor {
            required_features: adapter.features() & Features::TEXTURE_COMPRESSION_BC,
            // Everything the adapter has: pictures beyond wgpu's portable 8192 and 256 layers.
            required_limits: adapter.limits(),
            ..DeviceDescriptor::default()
        }));
        let (device, queue) = opened.map_err(|error| GpuError::Refused { reason: error.to_string() })?;
        let trouble = Arc::new(Mutex::new(None));
        let keep = |error: GpuError, slot: &Mutex<Option<GpuError>>| {
            // The first error is the cause, what follows its consequences.
            slot.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        };
        let slot = Arc::clone(&trouble);
        device.on_uncaptured_error(Arc::new(move |error| {
            let error = match error {
                wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory,
                error => GpuError::Refused { reason: one_line(&error.to_string()) },
            };
            keep(error, &slot);
        }));
        let slot = Arc::clone(&trouble);
        device.set_device_lost_callback(move |_, reason| {
            keep(GpuError::Lost { reason: one_line(&reason) }, &slot);
        });
        Ok(Self { adapter, device, queue, trouble })
    }

    /// The adapter's name and the interface through which it is reached, such as
    /// `llvmpipe (LLVM 15.0.6, 256 bits), vulkan`.
    pub fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{}, {}", info.name, info.backend)
    }

    /// Whether the adapter is a program on the CPU.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == DeviceType::Cpu
    }

    /// Fails with what went wrong since the last call.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        match self.trouble.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Hands `commands` to the GPU and waits for them.
    pub(crate) fn finish(&self, commands: CommandBuffer) -> Result<(), GpuError> {
        self.queue.submit([commands]);
        self.check()?;
        // wgpu 30 panics when the device is lost while it is waited for.
        let wait = catch_unwind(AssertUnwindSafe(|| self.device.poll(PollType::wait_indefinitely())));
        self.check()?;
        match wait {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(GpuError::Lost { reason: error.to_string() }),
            Err(_) => Err(GpuError::Lost { reason: "waiting for it failed".to_owned() }),
        }
    }
}

fn descriptor(backends: Backends) -> InstanceDescriptor {
    // Builds with and without debug assertions behave alike: validation layers are wgpu's own tests.
    InstanceDescriptor {
        backends,
        flags: InstanceFlags::empty(),
        ..InstanceDescriptor::new_without_display_handle()
    }
}

/// The fastest kind of adapter, the first of its kind.
fn best_adapter(instance: &Instance, backends: Backends, surface: Option<&Surface<'_>>) -> Option<Adapter> {
    let adapters = pollster::block_on(instance.enumerate_adapters(backends));
    let suited =
        adapters.into_iter().filter(|a| surface.is_none_or(|surface| a.is_surface_supported(surface)));
    suited.min_by_key(|adapter| match adapter.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    })
}

/// wgpu's reports run over many lines; ours are one sentence.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
