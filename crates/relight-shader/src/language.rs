//! Shading languages and their words.

/// A shading language.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Language {
    /// WebGPU's language.
    Wgsl,
    /// OpenGL's language: ES 3.00 and 3.30 upwards.
    Glsl,
    /// Direct3D's language: shader model 5 upwards.
    Hlsl,
}

/// A type of value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Type {
    Int,
    Int2,
    Int4,
    Float,
    Float2,
    Float3,
    Float4,
}

/// A row of the table of languages.
#[derive(Clone, Copy, Debug)]
struct Facts {
    language: Language,
    name: &'static str,
    /// In the order of [`Type`].
    types: [&'static str; 7],
    /// An array texture as a parameter's type.
    texture: &'static str,
    /// A sampler as a parameter's type; `None` where textures bring their own.
    sampler: Option<&'static str>,
    /// What stands before a constant's type.
    constant: &'static str,
    /// Declares a name with a type, or a type before a name.
    typed: Typed,
}

/// Where a declaration has its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Typed {
    /// `float x`, arrays returned through `out` parameters.
    Before,
    /// `x: f32`, arrays returned as values.
    After,
}

/// All languages, in the order of [`Language`].
static FACTS: [Facts; 3] = [
    Facts {
        language: Language::Wgsl,
        name: "wgsl",
        types: ["i32", "vec2i", "vec4i", "f32", "vec2f", "vec3f", "vec4f"],
        texture: "texture_2d_array<f32>",
        sampler: Some("sampler"),
        constant: "const",
        typed: Typed::After,
    },
    Facts {
        language: Language::Glsl,
        name: "glsl",
        types: ["int", "ivec2", "ivec4", "float", "vec2", "vec3", "vec4"],
        texture: "sampler2DArray",
        sampler: None,
        constant: "const",
        typed: Typed::Before,
    },
    Facts {
        language: Language::Hlsl,
        name: "hlsl",
        types: ["int", "int2", "int4", "float", "float2", "float3", "float4"],
        texture: "Texture2DArray<float4>",
        sampler: Some("SamplerState"),
        constant: "static const",
        typed: Typed::Before,
    },
];

impl Language {
    /// All languages, in the order in which they are listed to users.
    pub fn all() -> impl Iterator<Item = Self> {
        FACTS.iter().map(|facts| facts.language)
    }

    /// The language of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        FACTS.iter().find(|facts| facts.name == name).map(|facts| facts.language)
    }

    /// The name on the command line, which is also the usual suffix of files: `wgsl`, `glsl`, `hlsl`.
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    fn facts(self) -> &'static Facts {
        &FACTS[self as usize]
    }

    pub(crate) fn word(self, of: Type) -> &'static str {
        self.facts().types[of as usize]
    }

    pub(crate) fn texture(self) -> &'static str {
        self.facts().texture
    }

    pub(crate) fn sampler(self) -> Option<&'static str> {
        self.facts().sampler
    }

    pub(crate) fn constant(self) -> &'static str {
        self.facts().constant
    }

    pub(crate) fn typed(self) -> Typed {
        self.facts().typed
    }
}
