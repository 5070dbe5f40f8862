//! Where fits are kept for later bakes.

use crate::failure::Failure;
use crate::notes;
use crate::options::ByteCount;
use clap::Args;
use relight_formats::Cache;
use std::path::PathBuf;

/// A folder for what later bakes can take up.
#[derive(Args, Debug)]
pub(super) struct CacheOptions {
    /// Keep coefficients in this folder: bakes of the same pictures take them up where only --block, --quality, --mips and
    /// the like differ, or where a bake was interrupted, and do nothing where nothing differs
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// With --cache: what it may hold; what was not used for longest goes first
    #[arg(long, value_name = "SIZE", default_value = "20G", requires = "cache")]
    cache_size: ByteCount,
}

impl CacheOptions {
    /// The cache, where one is asked for; a note where its folder can't be made or written to.
    pub(super) fn open(&self) -> Option<Cache> {
        let opened = Cache::open(self.cache.as_ref()?, self.cache_size.0);
        opened
            .map_err(|error| {
                notes::print(&[format!("the cache is not used: {}", Failure::from(error).words())])
            })
            .ok()
    }
}
