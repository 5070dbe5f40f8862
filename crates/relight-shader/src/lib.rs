//! Shader source that lights a packed asset.
