//! Rasters that a caller in this process holds. A command finds them by their names, before it looks for files.

use elunar_base::{Result, say};
use elunar_core::tile::Window;
use elunar_raster::source::{self, Info, Source};
use elunar_raster::{Raster, heights};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rasters by name. Heights are metres above the sphere.
#[derive(Clone, Default)]
pub struct Held(HashMap<PathBuf, Arc<dyn Source>>);

impl Held {
    /// Adds a raster, in place of a file of this name.
    pub fn add(&mut self, name: impl Into<PathBuf>, source: Arc<dyn Source>) {
        self.0.insert(name.into(), source);
    }

    /// Returns the raster that is held under a name.
    #[must_use]
    pub fn find(&self, name: &Path) -> Option<Arc<dyn Source>> {
        self.0.get(name).cloned()
    }

    /// Returns heights that are held, or opens a file of heights and says what was passed over in it.
    ///
    /// # Errors
    /// As [`heights::open`].
    pub fn heights(&self, path: &Path) -> Result<Box<dyn Source>> {
        if let Some(held) = self.find(path) {
            return Ok(Box::new(Shared(held)));
        }
        let heights = heights::open(path)?;
        heights.info().warnings.iter().for_each(|warning| say::warning(&format!("{}: {warning}", path.display())));
        Ok(heights)
    }

    /// Returns heights that are held, or reads a file of heights, as [`Self::heights`] does.
    ///
    /// # Errors
    /// As [`Self::heights`] and [`Source::read`].
    pub fn read_heights(&self, path: &Path) -> Result<Raster> {
        source::read_all(&*self.heights(path)?)
    }

    /// Returns those of the paths that are files.
    #[must_use]
    pub fn files<'p>(&self, paths: impl IntoIterator<Item = &'p Path>) -> Vec<&'p Path> {
        paths.into_iter().filter(|path| !self.0.contains_key(*path)).collect()
    }
}

/// A source that others use, too.
struct Shared(Arc<dyn Source>);

impl Source for Shared {
    fn info(&self) -> &Info {
        self.0.info()
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        self.0.read(window)
    }
}
