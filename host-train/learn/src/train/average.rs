//! The running mean of a run's weights. Near the end of a cosine it hardly differs from the weights; before that it is better than they are,
//! because the noise of single steps is averaged out. So a long run can be stopped anywhere.

use crate::model::elunar::ELunarDtmNet;
use crate::model::store;
use elunar_net::config::NetConfig;
use elunar_net::weights::NetWeights;

/// Number of steps between two weights that are averaged: reading weights from a device takes time.
const EVERY: usize = 16;

/// Mean of the weights after every 16th step.
#[derive(Debug, Clone, PartialEq)]
pub struct Average {
    /// The mean, with the configuration in its metadata.
    pub weights: NetWeights,
    /// Number of steps over which the mean goes. Older weights fade exponentially.
    span: usize,
}

impl Average {
    /// Begins with these weights. A mean over too great a part of a short run would lag behind what it learns, so the span is at most a
    /// quarter of the run; `None` if fewer than two weights are left to average (our choice).
    pub fn new(weights: NetWeights, span: usize, steps: usize) -> Option<Self> {
        let span = span.min(steps / 4);
        (span >= 2 * EVERY).then_some(Self { weights, span })
    }

    /// Adds the weights after step `done` (from 1), if it is one that counts. Until the span is filled, all weights count alike.
    pub fn add(&mut self, done: usize, config: &NetConfig, net: &ELunarDtmNet) {
        if !done.is_multiple_of(EVERY) {
            return;
        }
        let share = (1.0 / (done / EVERY + 1) as f64).max(EVERY as f64 / self.span as f64);
        let new = store::save(config, net);
        for (name, array) in &mut self.weights.tensors {
            // Both are weights of the same network.
            if let Some(new) = new.tensors.get(name) {
                for (mean, new) in array.data.iter_mut().zip(&new.data) {
                    *mean += (share * (f64::from(*new) - f64::from(*mean))) as f32;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::init::initial_weights;
    use burn::tensor::Device;
    use elunar_net::config::miniature_network;
    use std::path::Path;

    #[test]
    fn a_short_run_has_a_short_mean_or_none() {
        let span = |span, steps| Average::new(initial_weights(&miniature_network(), 0), span, steps).map(|a| a.span);
        let expected = [Some(1_000), Some(300), Some(2 * EVERY), None, None, None];
        let of = [(1_000, 12_000), (1_000, 1_200), (1_000, 128), (1_000, 127), (31, 12_000), (0, 12_000)];
        assert_eq!(of.map(|(average, steps)| span(average, steps)), expected);
    }

    #[test]
    fn all_weights_count_alike_until_older_ones_fade() {
        let config = miniature_network();
        let of = |seed: u64| initial_weights(&config, seed);
        let net = |seed: u64| store::load(&config, &of(seed), Path::new("w"), &Device::flex()).unwrap();
        let name = "fusion.conv.weight";
        let value = |weights: &NetWeights| f64::from(weights.tensors[name].data[5]);
        let mut average = Average::new(of(0), 3 * EVERY, 1_000).unwrap();
        average.add(EVERY - 1, &config, &net(9));
        assert_eq!(average.weights.tensors, of(0).tensors);
        let mut expected = value(&of(0));
        for (done, share) in [(1, 1.0 / 2.0), (2, 1.0 / 3.0), (3, 1.0 / 3.0), (4, 1.0 / 3.0)] {
            average.add(done * EVERY, &config, &net(done as u64));
            expected += share * (value(&of(done as u64)) - expected);
            assert!((value(&average.weights) - expected).abs() < 1e-7, "after {done}");
        }
    }
}
