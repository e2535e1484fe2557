//! Compares every term with a simple implementation, and every gradient with finite differences of its value.

use super::hybrid::{ElevationTerm, Weights};
use super::*;
use proptest::prelude::*;

type Value = fn(&Pair<'_>) -> Result<f64, LossError>;
type AddGradient = fn(&Pair<'_>, f64, &mut [f32]) -> Result<f64, LossError>;

const TERMS: [(&str, Value, AddGradient); 4] = [
    ("l1", |p| Ok(l1::value(p)), l1::add_gradient),
    ("mean_elevation", mean_elevation::value, mean_elevation::add_gradient),
    ("gradient", gradient::value, gradient::add_gradient),
    ("normal", normal::value, normal::add_gradient),
];

/// Step of the finite differences; a power of two, so that values on a grid of 1/64 shift exactly in `f32`.
const STEP: f32 = 1.0 / 1024.0;

/// Returns truth, prediction and mask of a tile. Values are on a grid of 1/64, so that kinks (truth equal to prediction) occur.
fn tile(rows: usize, cols: usize) -> impl Strategy<Value = (Vec<f32>, Vec<f32>, Vec<bool>)> {
    let values = || proptest::collection::vec(0i32..3000, rows * cols);
    let mask = proptest::collection::vec(proptest::bool::weighted(0.9), rows * cols);
    (values(), values(), mask).prop_map(|(t, p, m)| {
        (t.iter().map(|v| *v as f32 / 64.0).collect(), p.iter().map(|v| *v as f32 / 64.0).collect(), m)
    })
}

fn shifted(pair: &Pair<'_>, value: Value, at: usize, by: f32) -> f64 {
    let mut moved = pair.predicted.to_vec();
    moved[at] += by;
    value(&Pair { predicted: &moved, ..*pair }).unwrap()
}

/// Returns the derivatives from the right and from the left, which agree except at a kink.
fn one_sided(pair: &Pair<'_>, value: Value, at: usize) -> (f64, f64) {
    let here = value(pair).unwrap();
    let step = f64::from(STEP);
    ((shifted(pair, value, at, STEP) - here) / step, (here - shifted(pair, value, at, -STEP)) / step)
}

fn check_gradients(pair: &Pair<'_>) -> Result<(), TestCaseError> {
    for (name, value, add_gradient) in TERMS {
        let mut found = vec![0.0f32; pair.truth.len()];
        let Ok(loss) = value(pair) else { continue };
        prop_assert!((add_gradient(pair, 1.0, &mut found).unwrap() - loss).abs() <= 1e-12 * loss.abs());
        let largest = found.iter().fold(0.0f64, |a, g| a.max(f64::from(g.abs())));
        for (at, found) in found.iter().enumerate() {
            let (right, left) = one_sided(pair, value, at);
            // If a kink is inside the step, any value between the two is right; otherwise they agree up to the curvature.
            let slack = 2e-3 * largest + 1e-9;
            let inside = left.min(right) - slack..=left.max(right) + slack;
            prop_assert!(inside.contains(&f64::from(*found)), "{name} at {at}: {found} not within {inside:?}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn gradients_match_finite_differences((truth, predicted, _) in tile(5, 6)) {
        check_gradients(&Pair::new(&truth, &predicted, None, Shape::new(5, 6)).unwrap())?;
    }

    #[test]
    fn gradients_match_finite_differences_under_a_mask((truth, predicted, valid) in tile(6, 7)) {
        prop_assume!(valid.contains(&true));
        let pair = Pair::new(&truth, &predicted, Some(&valid), Shape::new(6, 7)).unwrap();
        check_gradients(&pair)?;
        let mut gradient = vec![0.0; 42];
        l1::add_gradient(&pair, 1.0, &mut gradient).unwrap();
        prop_assert!(gradient.iter().zip(&valid).all(|(g, v)| *v || *g == 0.0));
    }

    #[test]
    fn terms_match_their_definitions((truth, predicted, _) in tile(4, 5)) {
        let pair = Pair::new(&truth, &predicted, None, Shape::new(4, 5)).unwrap();
        let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / 20.0 + 1e-3;
        let (tm, pm) = (mean(&truth), mean(&predicted));
        let elevation: f64 =
            truth.iter().zip(&predicted).map(|(t, p)| (f64::from(*t) / tm - f64::from(*p) / pm).abs()).sum::<f64>() / 20.0;
        // The padded tile is built, so that the border is replicated without clamped indices.
        let padded = |v: &[f32]| {
            let row = |r: usize| {
                let line = &v[r * 5..r * 5 + 5];
                let mut wide = vec![f64::from(line[0])];
                wide.extend(line.iter().map(|v| f64::from(*v)));
                wide.push(f64::from(line[4]));
                wide
            };
            [0, 0, 1, 2, 3, 3].map(row)
        };
        let (t, p) = (padded(&truth), padded(&predicted));
        let sobel = |z: &[Vec<f64>; 6], r: usize, c: usize| {
            let side = |c: usize| z[r][c] + 2.0 * z[r + 1][c] + z[r + 2][c];
            let end = |r: usize| z[r][c] + 2.0 * z[r][c + 1] + z[r][c + 2];
            ((side(c + 2) - side(c)) / 8.0, (end(r + 2) - end(r)) / 8.0)
        };
        let (mut grad, mut norm) = (0.0, 0.0);
        for r in 0..4 {
            for c in 0..5 {
                let ((tx, ty), (px, py)) = (sobel(&t, r, c), sobel(&p, r, c));
                grad += ((tx - px).abs() + (ty - py).abs()) / 20.0;
                let dot = tx * px + ty * py + 1.0;
                norm += (1.0 - dot / (tx * tx + ty * ty + 1.0).sqrt() / (px * px + py * py + 1.0).sqrt()) / 20.0;
            }
        }
        let found = hybrid::terms(&pair, ElevationTerm::MeanNormalised).unwrap();
        prop_assert!((found.elevation - elevation).abs() < 1e-12 * (1.0 + elevation));
        prop_assert!((found.gradient - grad).abs() < 1e-12 * (1.0 + grad));
        prop_assert!((found.normal - norm).abs() < 1e-12);
    }

    #[test]
    fn hybrid_is_the_weighted_sum_of_its_terms((truth, predicted, _) in tile(4, 4), a in 0f64..10.0, b in 0f64..3.0) {
        let pair = Pair::new(&truth, &predicted, None, Shape::new(4, 4)).unwrap();
        let weights = Weights { elevation: a, gradient: b, normal: 1.0 };
        for term in [ElevationTerm::MeanNormalised, ElevationTerm::L1] {
            let (mut sum, mut parts) = (vec![0.0f32; 16], vec![0.0f32; 16]);
            let terms = hybrid::add_gradient(&pair, term, weights, &mut sum).unwrap();
            prop_assert_eq!(terms, hybrid::terms(&pair, term).unwrap());
            match term {
                ElevationTerm::MeanNormalised => mean_elevation::add_gradient(&pair, a, &mut parts).unwrap(),
                ElevationTerm::L1 => l1::add_gradient(&pair, a, &mut parts).unwrap(),
            };
            gradient::add_gradient(&pair, b, &mut parts).unwrap();
            normal::add_gradient(&pair, 1.0, &mut parts).unwrap();
            prop_assert_eq!(sum, parts);
            prop_assert_eq!(terms.total(weights), a * terms.elevation + b * terms.gradient + terms.normal);
        }
    }

    #[test]
    fn mean_elevation_ignores_the_scale_of_the_prediction((truth, predicted, _) in tile(4, 4), k in 1u32..5) {
        // Invariant up to the offset ε on the mean, whose share of the loss is ε / z̄.
        prop_assume!(predicted.iter().sum::<f32>() > 16.0);
        let scaled: Vec<f32> = predicted.iter().map(|p| p * k as f32).collect();
        let one = mean_elevation::value(&Pair::new(&truth, &predicted, None, Shape::new(4, 4)).unwrap()).unwrap();
        let other = mean_elevation::value(&Pair::new(&truth, &scaled, None, Shape::new(4, 4)).unwrap()).unwrap();
        prop_assert!((one - other).abs() < 2e-3);
    }
}

#[test]
fn perfect_predictions_cost_nothing_and_pull_nowhere() {
    let tile: Vec<f32> = (0..20).map(|i| (i * i % 7) as f32).collect();
    let pair = Pair::new(&tile, &tile, None, Shape::new(4, 5)).unwrap();
    for (name, value, add_gradient) in TERMS {
        let mut gradient = vec![0.0; 20];
        assert!(value(&pair).unwrap().abs() < 1e-15, "{name}");
        add_gradient(&pair, 1.0, &mut gradient).unwrap();
        assert!(gradient.iter().all(|g| g.abs() < 1e-12), "{name}: {gradient:?}");
    }
}

#[test]
fn an_offset_costs_no_gradient_and_no_normal_term() {
    let truth: Vec<f32> = (0..30).map(|i| (i * i % 11) as f32).collect();
    let offset: Vec<f32> = truth.iter().map(|t| t + 5.0).collect();
    let pair = Pair::new(&truth, &offset, None, Shape::new(5, 6)).unwrap();
    assert_eq!(gradient::value(&pair), Ok(0.0));
    assert!(normal::value(&pair).unwrap().abs() < 1e-15);
}

#[test]
fn refuses_what_has_no_mean() {
    let err = |t: &[f32], p: &[f32], m: Option<&[bool]>| Pair::new(t, p, m, Shape::new(1, 2)).err();
    assert!(matches!(err(&[1.0], &[1.0, 2.0], None), Some(LossError::Length(_))));
    assert!(matches!(err(&[1.0, 2.0], &[1.0], None), Some(LossError::Length(_))));
    assert!(matches!(err(&[1.0, 2.0], &[1.0, 2.0], Some(&[true])), Some(LossError::Length(_))));
    assert_eq!(err(&[1.0, 2.0], &[f32::NAN, 2.0], Some(&[true, false])), Some(LossError::NothingValid));
    assert_eq!(Pair::new(&[], &[], None, Shape::new(0, 5)).err(), Some(LossError::NothingValid));

    let valid = [true, false];
    let pair = Pair::new(&[1.0, 2.0], &[1.0, 2.0], Some(&valid), Shape::new(1, 2)).unwrap();
    assert_eq!(gradient::value(&pair), Err(LossError::NothingValid));
    assert_eq!(normal::value(&pair), Err(LossError::NothingValid));
    for (_, _, add_gradient) in TERMS {
        assert!(matches!(add_gradient(&pair, 1.0, &mut [0.0]), Err(LossError::Length(_))));
    }
    // Three floats that add up to the double -0.004, so that the mean of the four values plus the offset is zero.
    let mut rest = -0.004f64;
    let zero: [f32; 4] = [0, 1, 2, 3].map(|_| {
        let part = rest as f32;
        rest -= f64::from(part);
        part
    });
    let one = [1.0f32; 4];
    for (truth, predicted) in [(&zero, &one), (&one, &zero)] {
        let pair = Pair::new(truth, predicted, None, Shape::new(2, 2)).unwrap();
        assert_eq!(mean_elevation::value(&pair), Err(LossError::ZeroMean));
        assert_eq!(mean_elevation::add_gradient(&pair, 1.0, &mut [0.0; 4]), Err(LossError::ZeroMean));
    }
}
