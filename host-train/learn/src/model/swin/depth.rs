//! Stochastic depth: in training, residual branches of the Swin blocks are left out at random, sample by sample.
//!
//! As in Swin's published code, the share left out grows linearly from 0 in the first block to the recipe's rate in the last, and a branch that
//! stays is divided by the share that stays, so that its mean is that of the whole network. Nothing is left out outside training.

use burn::tensor::{Tensor, TensorData};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// Separates these random choices from those of crops and Suns.
const DEPTH_STREAM: u64 = 0x3u64 << 60;

/// Factors of one block's two residual branches, attention and perceptron, for every sample of a micro-batch.
pub type BlockFactors = [Vec<f32>; 2];

/// Returns the factors of `blocks` blocks for the samples at places `samples` of a step's batch: 0 for a branch that is left out, else one over
/// the share that stays. `None` at a rate of 0. Only rate, seed, step and a sample's place decide, so that a resumed run, several devices and
/// parts of a batch leave out the same branches.
#[must_use]
pub fn factors(rate: f64, blocks: usize, seed: u64, step: usize, samples: Range<usize>) -> Option<Vec<BlockFactors>> {
    if rate <= 0.0 || blocks == 0 {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ DEPTH_STREAM);
    rng.set_stream(step as u64);
    let mut made = vec![BlockFactors::default(); blocks];
    for sample in 0..samples.end {
        for (block, branches) in made.iter_mut().enumerate() {
            let dropped = rate * block as f64 / (blocks - 1).max(1) as f64;
            for branch in branches {
                let stays = rng.random::<f64>() >= dropped;
                if samples.contains(&sample) {
                    branch.push(if stays { (1.0 / (1.0 - dropped)) as f32 } else { 0.0 });
                }
            }
        }
    }
    Some(made)
}

/// Multiplies a branch `[B, H, W, C]` by its samples' factors.
pub(super) fn scaled(branch: Tensor<4>, factors: &[f32]) -> Tensor<4> {
    let data = TensorData::new(factors.to_vec(), [factors.len(), 1, 1, 1]);
    let factors: Tensor<4> = Tensor::from_data(data, &branch.device());
    let dtype = branch.dtype();
    branch.mul(crate::model::cast::cast(factors, dtype))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::backend::Backend;
    use crate::model::swin::block::Block;

    #[test]
    fn the_share_left_out_grows_linearly_and_means_stay() {
        let (rate, blocks) = (0.2, 5);
        let mut sums = vec![[0.0, 0.0]; blocks];
        let (steps, batch) = (500, 8);
        for step in 0..steps {
            for (sum, branches) in sums.iter_mut().zip(factors(rate, blocks, 7, step, 0..batch).unwrap()) {
                for factor in branches.concat() {
                    sum[0] += f64::from(factor);
                    sum[1] += f64::from(u8::from(factor == 0.0));
                }
            }
        }
        let count = (2 * steps * batch) as f64;
        for (block, [sum, dropped]) in sums.into_iter().enumerate() {
            let expected = rate * block as f64 / 4.0;
            // Four standard deviations of a share of 8,000 draws at 0.2 are 0.018.
            assert!((dropped / count - expected).abs() < 0.018, "{block}: {}", dropped / count);
            assert!((sum / count - 1.0).abs() < 0.025, "{block}: {}", sum / count);
        }
        assert!(factors(0.0, 5, 7, 0, 0..8).is_none());
    }

    #[test]
    fn parts_of_a_batch_leave_out_what_the_whole_does() {
        let whole = factors(0.5, 3, 1, 9, 0..6).unwrap();
        let parts = [0..2, 2..6].map(|part| factors(0.5, 3, 1, 9, part).unwrap());
        for (block, all) in whole.iter().enumerate() {
            for (branch, all) in all.iter().enumerate() {
                assert_eq!(all, &[parts[0][block][branch].clone(), parts[1][block][branch].clone()].concat());
            }
        }
        assert!(whole != factors(0.5, 3, 1, 10, 0..6).unwrap() && whole != factors(0.5, 3, 2, 9, 0..6).unwrap());
    }

    /// A branch that is left out at a share p and divided by 1 - p otherwise has the mean of the whole block.
    #[test]
    fn the_expectation_of_a_branch_is_the_whole_pass() {
        let device = Backend::Flex.device().unwrap();
        let block = Block::new(8, 4, 2, 2, &device);
        let wave = |i: usize| (i as f32 * 0.37).sin();
        let one = TensorData::new((0..8 * 8 * 8).map(wave).collect::<Vec<f32>>(), [1, 8, 8, 8]);
        let x: Tensor<4> = Tensor::from_data(one, &device).repeat_dim(0, 2);
        let run = |factors: Option<BlockFactors>| {
            block.forward(x.clone(), factors.as_ref()).into_data().try_to_vec::<f32>().unwrap()
        };
        let half = 8 * 8 * 8;
        for (branch, other) in [(0, 1), (1, 0)] {
            let with = |factor: Vec<f32>| -> Vec<f32> {
                let mut factors = [vec![0.0; 2], vec![0.0; 2]];
                factors[branch] = factor;
                factors[other] = vec![0.0; 2];
                run(Some(factors))
            };
            let drawn = with(vec![0.0, 1.25]);
            let whole = with(vec![1.0, 1.0]);
            let mut moved = 0.0_f32;
            for i in 0..half {
                let mean = 0.2 * drawn[i] + 0.8 * drawn[half + i];
                assert!((mean - whole[i]).abs() < 1e-5, "{mean} {}", whole[i]);
                moved = moved.max((drawn[i] - whole[i]).abs());
            }
            assert!(moved > 1e-3, "the branch adds nothing");
        }
        // A factor of 1 changes no bit.
        assert!(run(None) == run(Some([vec![1.0; 2], vec![1.0; 2]])));
    }
}
