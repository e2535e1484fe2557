//! The forms for processors without vectors and for AVX2 against the portable one.

use super::*;
use crate::nn::tests::Random;

const COLS: usize = 7;
const ROWS: usize = 2;

fn tensor(r: &mut Random, dtype: Dtype, channels: usize, offset: usize) -> Tensor {
    let (zero, lo, hi) = if dtype == Dtype::U8 { (r.within(0, 255) as i32, 0, 255) } else { (0, -32767, 32767) };
    let margin = r.size(0, 2);
    let t = Tensor { zero, lo, hi, margin, offset, ..Tensor::new(dtype, (ROWS, COLS), channels) };
    Tensor { pitch: t.row_bytes() + 5, ..t }
}

/// Returns the bytes and cuts of the form for AVX2; `None` if this processor does not have it.
#[allow(unsafe_code)]
#[cfg(target_arch = "x86_64")]
fn by_avx2(requantise: &Requantise<'_>, acc: &Accumulators, target: &Target, mut bytes: Vec<u8>) -> Option<Vec<u8>> {
    if !std::arch::is_x86_feature_detected!("avx2") {
        return None;
    }
    // SAFETY: the processor has the instructions.
    let cut = unsafe { crate::nn::kernels::x86_avx2::requantise::run(requantise, &mut bytes, acc, target) };
    bytes.extend(cut.expect("the form computes every operator of this test").to_le_bytes());
    Some(bytes)
}

#[test]
fn channel_by_channel_gives_the_portable_bytes_and_cuts() {
    let (mut cuts, mut kinds) = (0, [0; 6]);
    for seed in 0..600 {
        let mut random = Random::new(seed);
        let r = &mut random;
        let width = r.pick(&[8, 16, 32]);
        let channels = r.size(1, width);
        let (out_type, add_type) =
            (r.pick(&[Dtype::U8, Dtype::I16]), r.pick(&[None, Some(Dtype::U8), Some(Dtype::I16)]));
        let out = tensor(r, out_type, channels, 11);
        let add = add_type.map(|dtype| tensor(r, dtype, channels, 4000));
        let shift = if r.one_in(4) { r.size(1, 31) } else { r.size(32, 45) } as u32;
        let table: Option<Vec<u8>> = (out_type == Dtype::U8 && r.one_in(2)).then(|| r.bytes(CODE_TABLE_LEN));
        let list =
            |r: &mut Random, most: i64| -> [i32; PANEL] { core::array::from_fn(|_| r.within(-most, most) as i32) };
        let requantise = Requantise {
            out: &out,
            first: 0,
            channels,
            width,
            bias: list(r, 1 << 20),
            multiplier: list(r, 1 << 28),
            add_multiplier: if add.is_some() { list(r, 1 << 20) } else { [0; PANEL] },
            add,
            add_shift: r.size(0, 8) as u32,
            half: 1 << (shift - 1),
            shift,
            table: table.as_deref(),
            zero: out.zero as i64,
            lo: out.lo as i64,
            hi: out.hi as i64,
            floor: if r.one_in(2) { i64::MIN } else { out.lo as i64 },
            ceiling: if table.is_some() { i64::MAX } else { out.hi as i64 },
            relu: false,
        };
        let acc: Accumulators = core::array::from_fn(|_| r.within(-(1 << 24), 1 << 24) as i32);
        let pixels = r.size(1, 4);
        let target = Target {
            row: r.size(0, 1),
            col: r.size(0, 3 - pixels.min(3)),
            col_step: r.size(1, 2).min(7 / pixels),
            pixels,
        };
        let before = r.bytes(8000);
        #[cfg(target_arch = "x86_64")]
        let by_avx2 = by_avx2(&requantise, &acc, &target, before.clone());
        let (mut portable, mut by_channels) = (before.clone(), before);
        let expected = requantise.portable(&mut portable, &acc, &target);
        assert_eq!(requantise.by_channels(&mut by_channels, &acc, &target), expected, "cuts, seed {seed}");
        assert!(portable == by_channels, "seed {seed}");
        #[cfg(target_arch = "x86_64")]
        if let Some(by_avx2) = by_avx2 {
            portable.extend(expected.to_le_bytes());
            assert!(portable == by_avx2, "AVX2, seed {seed}: shift {shift}, {channels} channels");
        }
        cuts += expected;
        let of = add_type.map_or(0, Dtype::bytes);
        kinds[2 * of + (out_type == Dtype::I16) as usize] += (shift >= 32) as u32;
    }
    assert!(cuts > 0 && kinds.iter().all(|count| *count > 20), "{cuts} cut, {kinds:?} of each kind");
}
