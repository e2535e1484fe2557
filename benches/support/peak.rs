//! Measures the processor's peak, with loops of one instruction on registers.
//!
//! ```text
//! for a while:  for every accumulator:  sum = instruction(sum, x, w)      independent of each other: throughput, not latency
//! ```
#![allow(unsafe_code)]

use crate::samples::seconds;

/// A loop of one instruction.
#[derive(Debug, Clone, Copy)]
pub struct Peak {
    /// The instruction and its operands.
    pub name: &'static str,
    /// Multiply-accumulates of one run.
    pub macs: u64,
    run: fn(),
}

impl Peak {
    /// Returns the seconds of one run, some tens of microseconds.
    pub fn seconds(&self) -> f64 {
        seconds(self.run)
    }
}

/// Number of rounds of a run.
const ROUNDS: u64 = 8192;

/// Returns the peak for comparison with kernels: that of the best integer dot product of this processor.
pub fn dot_product() -> Option<Peak> {
    available().into_iter().find(|peak| peak.name.starts_with("vpdpbusd") || peak.name.starts_with("vpmaddwd"))
}

/// Returns loops for the instructions of this processor: `vpdpbusd`, `vpmaddwd` and `vfmadd`, in the widest vectors.
#[cfg(target_arch = "x86_64")]
pub fn available() -> Vec<Peak> {
    let avx512 = is_x86_feature_detected!("avx512f");
    let mut found = Vec::new();
    // Every loop is listed only where the processor has its instruction.
    let mut list = |present: bool, name, macs_per_round: u64, run: fn()| {
        if present {
            found.push(Peak { name, macs: ROUNDS * macs_per_round, run });
        }
    };
    // SAFETY: listed only with AVX-512 VNNI.
    list(avx512 && is_x86_feature_detected!("avx512vnni"), "vpdpbusd zmm", 16 * 64, || unsafe { x86::vpdpbusd() });
    // SAFETY: listed only with AVX2.
    list(is_x86_feature_detected!("avx2"), "vpmaddwd ymm", 12 * 16, || unsafe { x86::vpmaddwd() });
    // SAFETY: listed only with AVX-512.
    list(avx512, "vfmadd zmm", 16 * 16, || unsafe { x86::vfmadd_512() });
    // SAFETY: listed only with FMA, which implies AVX.
    list(!avx512 && is_x86_feature_detected!("fma"), "vfmadd ymm", 12 * 8, || unsafe { x86::vfmadd_256() });
    found
}

/// Returns no loops, because they exist for x86-64 only.
#[cfg(not(target_arch = "x86_64"))]
pub fn available() -> Vec<Peak> {
    Vec::new()
}

/// Returns the fraction of peak of `macs` multiply-accumulates in `seconds`, where [`Peak::seconds`] returned `peak_s`.
#[must_use]
pub fn fraction(peak: &Peak, peak_s: f64, macs: u64, seconds: f64) -> f64 {
    (macs as f64 / seconds) / (peak.macs as f64 / peak_s)
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::ROUNDS;
    use core::arch::x86_64::*;
    use std::array::from_fn;
    use std::hint::black_box;

    #[target_feature(enable = "avx512f,avx512vnni")]
    pub(super) fn vpdpbusd() {
        let (x, w) = (black_box(_mm512_set1_epi32(0x0102_0304)), black_box(_mm512_set1_epi32(0x0101_0101)));
        // Different values, so that the compiler cannot do the work only once.
        let mut sums: [__m512i; 16] = from_fn(|i| black_box(_mm512_set1_epi32(i as i32)));
        for _ in 0..ROUNDS {
            sums.iter_mut().for_each(|sum| *sum = _mm512_dpbusd_epi32(*sum, x, w));
        }
        black_box(sums);
    }

    /// The product itself depends on the last one, because a product of constants would be computed only once.
    #[target_feature(enable = "avx2")]
    pub(super) fn vpmaddwd() {
        let w = black_box(_mm256_set1_epi16(3));
        let mut sums: [__m256i; 12] = from_fn(|i| black_box(_mm256_set1_epi32(i as i32)));
        for _ in 0..ROUNDS {
            sums.iter_mut().for_each(|sum| *sum = _mm256_madd_epi16(*sum, w));
        }
        black_box(sums);
    }

    #[target_feature(enable = "avx512f")]
    pub(super) fn vfmadd_512() {
        let (x, w) = (black_box(_mm512_set1_ps(0.5)), black_box(_mm512_set1_ps(0.25)));
        let mut sums: [__m512; 16] = from_fn(|i| black_box(_mm512_set1_ps(i as f32)));
        for _ in 0..ROUNDS {
            sums.iter_mut().for_each(|sum| *sum = _mm512_fmadd_ps(x, w, *sum));
        }
        black_box(sums);
    }

    #[target_feature(enable = "avx,fma")]
    pub(super) fn vfmadd_256() {
        let (x, w) = (black_box(_mm256_set1_ps(0.5)), black_box(_mm256_set1_ps(0.25)));
        let mut sums: [__m256; 12] = from_fn(|i| black_box(_mm256_set1_ps(i as f32)));
        for _ in 0..ROUNDS {
            sums.iter_mut().for_each(|sum| *sum = _mm256_fmadd_ps(x, w, *sum));
        }
        black_box(sums);
    }
}
