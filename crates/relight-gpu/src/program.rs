//! Pipelines that fill a picture of floats from textures and a few numbers.

use crate::{Gpu, GpuError};
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor,
    BindGroupLayoutEntry, BindingResource, BindingType, Buffer, BufferBindingType, BufferDescriptor,
    BufferUsages, Color, CommandEncoder, FragmentState, LoadOp, MultisampleState, Operations,
    PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState, RenderPassColorAttachment,
    RenderPassDescriptor, RenderPipeline, RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource,
    ShaderStages, StoreOp, TextureFormat, TextureSampleType, TextureView, TextureViewDimension, VertexState,
};

/// The vertex shader of every pipeline: one triangle over the whole picture.
const CORNERS: &str = "
@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(i32(i & 1u) * 4 - 1), f32(i32(i >> 1u) * 4 - 1), 0.0, 1.0);
}
";

/// What a pipeline reads at a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Input {
    Numbers,
    Picture,
    Array,
}

/// A pipeline whose bindings are its inputs, in order.
#[derive(Debug)]
pub(crate) struct Program {
    pipeline: RenderPipeline,
    layout: BindGroupLayout,
}

/// A buffer of `bytes` bytes for [`Input::Numbers`].
pub(crate) fn numbers(gpu: &Gpu, bytes: usize) -> Buffer {
    gpu.device.create_buffer(&BufferDescriptor {
        label: Some("numbers"),
        size: bytes as u64,
        usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

impl Program {
    /// Compiles `source`, whose fragment shader is `pixel`.
    pub(crate) fn new(
        gpu: &Gpu,
        source: &str,
        inputs: &[Input],
        target: TextureFormat,
    ) -> Result<Self, GpuError> {
        let textures = inputs.iter().filter(|input| **input != Input::Numbers).count();
        let limit = gpu.device.limits().max_sampled_textures_per_shader_stage as usize;
        if textures > limit {
            return Err(GpuError::TooManyTextures { textures, limit });
        }
        let module = gpu.device.create_shader_module(ShaderModuleDescriptor {
            label: Some("relight"),
            source: ShaderSource::Wgsl(format!("{source}{CORNERS}").into()),
        });
        gpu.check()?;
        let entry = |(input, binding): (&Input, u32)| BindGroupLayoutEntry {
            binding,
            visibility: ShaderStages::FRAGMENT,
            ty: input.binding_type(),
            count: None,
        };
        let entries: Vec<_> = inputs.iter().zip(0..).map(entry).collect();
        let layout = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("relight"),
            entries: &entries,
        });
        let pipeline_layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: Some("relight"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
            label: Some("relight"),
            layout: Some(&pipeline_layout),
            vertex: VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: PrimitiveState::default(),
            depth_stencil: None,
            multisample: MultisampleState::default(),
            fragment: Some(FragmentState {
                module: &module,
                entry_point: Some("pixel"),
                compilation_options: PipelineCompilationOptions::default(),
                targets: &[Some(target.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        gpu.check()?;
        Ok(Self { pipeline, layout })
    }

    /// The inputs of a run, in order.
    pub(crate) fn bind<'a>(
        &self,
        gpu: &Gpu,
        buffers: impl IntoIterator<Item = &'a Buffer>,
        textures: impl IntoIterator<Item = &'a TextureView>,
    ) -> BindGroup {
        let buffers = buffers.into_iter().map(Buffer::as_entire_binding);
        let resources = buffers.chain(textures.into_iter().map(BindingResource::TextureView));
        let entries: Vec<_> =
            resources.zip(0..).map(|(resource, binding)| BindGroupEntry { binding, resource }).collect();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("relight"),
            layout: &self.layout,
            entries: &entries,
        })
    }

    /// Fills `target` by the fragment shader.
    pub(crate) fn run(&self, commands: &mut CommandEncoder, inputs: &BindGroup, target: &TextureView) {
        let mut pass = commands.begin_render_pass(&RenderPassDescriptor {
            label: Some("relight"),
            color_attachments: &[Some(RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: Operations { load: LoadOp::Clear(Color::BLACK), store: StoreOp::Store },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, inputs, &[]);
        pass.draw(0..3, 0..1);
    }
}

impl Input {
    fn binding_type(self) -> BindingType {
        let texture = |sample_type, view_dimension| BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        match self {
            Self::Numbers => BindingType::Buffer {
                ty: BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            Self::Picture => texture(TextureSampleType::Uint, TextureViewDimension::D2),
            Self::Array => {
                texture(TextureSampleType::Float { filterable: false }, TextureViewDimension::D2Array)
            }
        }
    }
}
