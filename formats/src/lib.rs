//! The only code that knows the bytes of files: pictures and light files in, assets out and in.

pub mod asset;
mod cache;
mod camera_file;
mod capture_folder;
mod content;
mod crop;
mod depth_file;
mod describe;
mod error;
mod exr_channels;
mod gain;
pub mod light_file;
mod machine;
pub mod mesh;
mod normal_file;
mod output_file;
mod output_folder;
pub mod picture;
mod picture_output;
mod position_file;
mod positioned;
mod rig_file;
mod samples;
mod scene_file;
mod stack;
mod temporary;

pub use asset::{
    AssetFormat, AssetHeader, AssetPlan, AssetPositions, AssetWriter, Parts, WriteSettings, describe_asset,
    plane_names, read_asset, read_packed, read_positions, summarize_asset, write_function_table,
};
pub use cache::{Cache, FitFolder, Made, MadeFile, Odd, TileGrid, TileStack, TileWriter, Tiles};
pub use camera_file::read_camera_file;
pub use capture_folder::{OpenCapture, open_capture};
pub use content::{
    Stamp, Stamps, bytes_on_disk, content_hash, content_key, hexadecimal, record_key, remove_file, stamp_of,
    tree_hash,
};
pub use crop::Crop;
pub use depth_file::read_depth_file;
pub use describe::describe;
pub use error::FormatError;
pub use light_file::{
    Capture, IntensityFile, LightFile, light_file_in, match_pictures, pictures_in, read_intensity_file,
    read_light_file, unmatched, write_light_file,
};
pub use machine::{create_folder, machine_memory, place_of, read_text};
pub use mesh::{read_mesh, read_mesh_parts};
pub use normal_file::{NormalPicture, read_normal_file, write_normal_file};
pub use output_file::{OutputFile, write_whole};
pub use output_folder::ScratchFolder;
pub use picture::{DecodedPicture, PictureInfo, SampleType, Samples, decode, probe};
pub use picture_output::{PagePicture, PictureDepth, picture_bytes, picture_depths, write_picture};
pub use position_file::{read_position_file, write_position_file};
pub use rig_file::{MeshKey, RigFile, is_rig, read_rig, write_rig};
pub use scene_file::{RigScene, SceneFile, linear_picture, read_scene};
pub use stack::{DECODER_SHARE, PictureStack, RESERVE, StackSettings};
