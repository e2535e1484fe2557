//! Heights in another unit than their file admits.

use super::source::{Info, Source};
use crate::Result;
use elunar_core::tile::Window;

/// Unit of heights, as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum HeightUnit {
    /// Metres.
    M,
    /// Kilometres.
    Km,
}

impl HeightUnit {
    /// Metres per unit.
    #[must_use]
    pub fn metres(self) -> f32 {
        match self {
            Self::M => 1.0,
            Self::Km => 1000.0,
        }
    }

    /// `source` with its samples, which are in this unit, in metres.
    #[must_use]
    pub fn in_metres(self, source: Box<dyn Source>) -> Box<dyn Source> {
        match self {
            Self::M => source,
            Self::Km => {
                let info = Info { unit: Some("m".into()), ..source.info().clone() };
                Box::new(Scaled { info, source, factor: self.metres() })
            }
        }
    }
}

struct Scaled {
    info: Info,
    source: Box<dyn Source>,
    factor: f32,
}

impl Source for Scaled {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let mut samples = self.source.read(window)?;
        samples.iter_mut().for_each(|v| *v *= self.factor);
        Ok(samples)
    }
}
