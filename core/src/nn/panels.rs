//! The order of weights: panels of output channels, and groups of four samples.

/// Width of the widest panel, channels.
pub const PANEL: usize = 32;

/// Divides `channels` output channels into panels: (first channel, width). The last panel is filled up with zeros.
pub fn panels(channels: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..panel_count(channels)).map(move |index| panel(channels, index))
}

/// Number of panels.
pub const fn panel_count(channels: usize) -> usize {
    channels / PANEL
        + match channels % PANEL {
            0 => 0,
            17..=24 => 2,
            _ => 1,
        }
}

/// Returns first channel and width of panel `index`.
#[inline]
pub const fn panel(channels: usize, index: usize) -> (usize, usize) {
    let (whole, rest) = (channels / PANEL, channels % PANEL);
    if index < whole {
        return (index * PANEL, PANEL);
    }
    let first = whole * PANEL;
    match rest {
        0..=8 => (first, 8),
        9..=16 => (first, 16),
        17..=24 if index == whole => (first, 16),
        17..=24 => (first + 16, 8),
        _ => (first, 32),
    }
}

/// Returns `channels` filled up to whole panels.
pub const fn panelled(channels: usize) -> usize {
    let (first, width) = panel(channels, panel_count(channels).saturating_sub(1));
    first + width
}

/// Number of four-byte groups of `samples` consecutive samples.
pub const fn groups(samples: usize) -> usize {
    samples.div_ceil(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_cover_every_channel_once() {
        for channels in 1..300 {
            let panels: Vec<(usize, usize)> = panels(channels).collect();
            assert_eq!(panels.len(), panel_count(channels));
            let mut next = 0;
            for (index, &(first, width)) in panels.iter().enumerate() {
                assert_eq!(panel(channels, index), (first, width));
                assert!(first == next && first < channels && [8, 16, 32].contains(&width), "{channels}: {panels:?}");
                next = first + width;
            }
            assert_eq!(next, panelled(channels));
            // There is no more filling than with panels of 8 alone.
            assert!(next >= channels && next - channels < 8, "{channels}: {panels:?}");
        }
        assert_eq!((panel_count(0), panels(0).count()), (0, 0));
    }
}
