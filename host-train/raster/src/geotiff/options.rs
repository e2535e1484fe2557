//! Options of a file to write.

/// Type of stored samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleType {
    /// Floats without change. The NoData value is [`super::NODATA`].
    F32,
    /// Rounded to 0..=255.
    U8,
    /// Rounded to 0..=65535.
    U16,
}

impl SampleType {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::U16 => 2,
            Self::U8 => 1,
        }
    }

    /// Returns the largest value; `None` for floats.
    pub(super) fn highest(self) -> Option<f32> {
        match self {
            Self::F32 => None,
            Self::U16 => Some(f32::from(u16::MAX)),
            Self::U8 => Some(f32::from(u8::MAX)),
        }
    }
}

/// Compression of blocks. The predictor follows from the samples (3 for floats, 2 for integers).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Compression {
    /// No compression, for programs that map files into memory.
    None,
    /// The Ames Stereo Pipeline's default.
    Lzw,
    /// Smaller than LZW, and supported by all programs.
    #[default]
    Deflate,
    /// Smallest and fastest, but older programs cannot read it.
    Zstd,
}

/// What a file says about a band after the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BandText {
    /// Description.
    pub description: String,
    /// Unit of the samples.
    pub unit: Option<String>,
}

/// Contents of the file besides samples and georeference.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// Type of stored samples.
    pub sample: SampleType,
    /// Compression of blocks.
    pub compression: Compression,
    /// For integer samples: 0 is the NoData value, and valid samples are stored as 1 at least. Otherwise, invalid samples are refused.
    pub zero_is_nodata: bool,
    /// Unit of the samples; `m` for heights.
    pub unit: Option<String>,
    /// Description of the band. For heights: the sphere they are above, and their source.
    pub description: Option<String>,
    /// The bands after the first, which have its type of samples.
    pub more_bands: Vec<BandText>,
    /// Further metadata items, name and text.
    pub items: Vec<(String, String)>,
    /// Whether the file is a BigTIFF at any size, so that a small raster can test it.
    pub(super) force_big: bool,
}

impl WriteOptions {
    /// Options for heights in metres, stored as `f32`.
    #[must_use]
    pub fn heights(description: impl Into<String>) -> Self {
        Self { unit: Some("m".into()), ..Self::image(SampleType::F32, description) }
    }

    /// Options for an image without unit.
    #[must_use]
    pub fn image(sample: SampleType, description: impl Into<String>) -> Self {
        Self {
            sample,
            compression: Compression::default(),
            zero_is_nodata: true,
            unit: None,
            description: Some(description.into()),
            more_bands: vec![],
            items: vec![],
            force_big: false,
        }
    }

    /// Adds a metadata item.
    #[must_use]
    pub fn with_item(mut self, name: impl Into<String>, text: impl Into<String>) -> Self {
        self.items.push((name.into(), text.into()));
        self
    }

    /// Adds a band after the last one.
    #[must_use]
    pub fn with_band(mut self, description: impl Into<String>, unit: Option<&str>) -> Self {
        self.more_bands.push(BandText { description: description.into(), unit: unit.map(Into::into) });
        self
    }

    /// Records the direction to the Sun of an image: azimuth clockwise from the raster's up and elevation above the horizon, degrees, each
    /// if known.
    #[must_use]
    pub fn with_sun(self, azimuth_deg: Option<f64>, elevation_deg: Option<f64>) -> Self {
        let angles = [("SUN_AZIMUTH_DEG", azimuth_deg), ("SUN_ELEVATION_DEG", elevation_deg)];
        angles.into_iter().fold(self, |options, (key, angle)| match angle {
            Some(deg) => options.with_item(key, format!("{deg:.3}")),
            None => options,
        })
    }

    /// Chooses the compression.
    #[must_use]
    pub fn with_compression(mut self, compression: Compression) -> Self {
        self.compression = compression;
        self
    }

    /// States that integer samples have no gaps, so that 0 is an ordinary value.
    #[must_use]
    pub fn without_gaps(mut self) -> Self {
        self.zero_is_nodata = false;
        self
    }
}
