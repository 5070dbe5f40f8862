//! A compute shader on the machine's GPU, or the CPU that stands in for one.

use wgpu::util::DeviceExt as _;

/// A device.
pub(crate) struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
}

/// An array texture of four floats a texel.
pub(crate) struct Texture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// By level, then layer, then row.
    pub(crate) levels: Vec<Vec<[f32; 4]>>,
}

impl Gpu {
    /// The adapter that there is; says so where there is none.
    ///
    /// # Panics
    /// Where there is none although RELIGHT_REQUIRE_GPU is 1.
    pub(crate) fn for_tests() -> Option<Self> {
        let gpu = pollster::block_on(Self::open());
        if gpu.is_none() {
            let required = std::env::var("RELIGHT_REQUIRE_GPU").is_ok_and(|value| value == "1");
            assert!(!required, "RELIGHT_REQUIRE_GPU=1 but there is no adapter");
            println!("skipped: no GPU adapter (Debian: mesa-vulkan-drivers)");
        }
        gpu
    }

    async fn open() -> Option<Self> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await.ok()?;
        let descriptor = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = adapter.request_device(&descriptor).await.ok()?;
        Some(Self { device, queue })
    }

    /// Runs `main` of `source` in `groups` groups: binding 0 is `input`, 1 takes `output` floats, the
    /// textures follow, and a sampler of nearest texels comes last.
    pub(crate) fn compute(
        &self,
        source: &str,
        input: &[[f32; 4]],
        textures: &[Texture],
        output: usize,
        groups: usize,
    ) -> Vec<f32> {
        let device = &self.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let visibility = wgpu::ShaderStages::COMPUTE;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
        let buffer = |read_only| wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let maps = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        let mut entries = vec![entry(0, buffer(true)), entry(1, buffer(false))];
        entries.extend((2..).zip(textures).map(|(binding, _)| entry(binding, maps)));
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::NonFiltering);
        entries.push(entry(entries.len() as u32, sampler));
        let layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries });
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let contents = bytemuck::cast_slice(input);
        let input =
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage });
        let size = 4 * output as u64;
        let made = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let (output, read) = (made(usage), made(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST));
        let views: Vec<wgpu::TextureView> = textures.iter().map(|texture| self.upload(texture)).collect();
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor::default());
        let mut resources = vec![input.as_entire_binding(), output.as_entire_binding()];
        resources.extend(views.iter().map(wgpu::BindingResource::TextureView));
        resources.push(wgpu::BindingResource::Sampler(&sampler));
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(groups as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&output, 0, &read, 0, size);
        self.queue.submit([encoder.finish()]);
        read.slice(..).map_async(wgpu::MapMode::Read, |mapped| mapped.unwrap());
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let range = read.slice(..).get_mapped_range().unwrap();
        bytemuck::cast_slice(&range).to_vec()
    }

    fn upload(&self, texture: &Texture) -> wgpu::TextureView {
        let (width, height) = (texture.width as u32, texture.height as u32);
        let layers = texture.levels[0].len() as u32 / (width * height);
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: layers };
        let made = self.device.create_texture_with_data(
            &self.queue,
            &wgpu::TextureDescriptor {
                label: None,
                size,
                mip_level_count: texture.levels.len() as u32,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba32Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::MipMajor,
            bytemuck::cast_slice(&texture.levels.concat()),
        );
        made.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        })
    }
}
