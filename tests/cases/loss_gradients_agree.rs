//! Compares the loss for training (Burn tensors, automatic differentiation) with the reference (`core`, analytic).

use burn::tensor::{Tensor, TensorData};
use elunar_core::loss::Pair;
use elunar_core::loss::hybrid::{ElevationTerm, Terms, Weights, add_gradient};
use elunar_core::tile::Shape;
use elunar_learn::model::backend::Backend;
use elunar_learn::train::loss::{Elevation, LossWeights, terms};
use elunar_net::weights::NetWeights as File;
use elunar_tests::{golden_networks, tolerance};

/// True and predicted tiles of one batch, all of `rows * cols`.
struct Batch {
    truth: Vec<Vec<f32>>,
    predicted: Vec<Vec<f32>>,
    rows: usize,
    cols: usize,
}

/// Returns the mean terms and the gradient of the total over the batch, computed by `core`.
fn by_core(batch: &Batch, term: ElevationTerm, weights: Weights) -> (Terms, Vec<f32>) {
    let share = 1.0 / batch.truth.len() as f64;
    let scaled = Weights {
        elevation: weights.elevation * share,
        gradient: weights.gradient * share,
        normal: weights.normal * share,
    };
    let mut sum = Terms { elevation: 0.0, gradient: 0.0, normal: 0.0 };
    let mut gradient = Vec::new();
    for (truth, predicted) in batch.truth.iter().zip(&batch.predicted) {
        let pair = Pair::new(truth, predicted, None, Shape::new(batch.rows, batch.cols)).unwrap();
        let mut own = vec![0.0; truth.len()];
        let found = add_gradient(&pair, term, scaled, &mut own).unwrap();
        sum.elevation += found.elevation * share;
        sum.gradient += found.gradient * share;
        sum.normal += found.normal * share;
        gradient.extend(own);
    }
    (sum, gradient)
}

/// Returns the same, computed by Burn on the default backend.
fn by_burn(batch: &Batch, term: Elevation, weights: LossWeights) -> (Terms, Vec<f32>) {
    let device = Backend::Flex.device().unwrap().autodiff();
    let tensor = |tiles: &[Vec<f32>]| -> Tensor<4> {
        Tensor::from_data(TensorData::new(tiles.concat(), [tiles.len(), 1, batch.rows, batch.cols]), &device)
    };
    let predicted = tensor(&batch.predicted).require_grad();
    let found = terms(tensor(&batch.truth), predicted.clone(), term, None);
    let number = |t: &Tensor<1>| f64::from(t.clone().into_scalar::<f32>());
    let terms =
        Terms { elevation: number(&found.elevation), gradient: number(&found.gradient), normal: number(&found.normal) };
    let gradients = weights.total(&found).backward();
    let gradient = predicted.grad(&gradients).unwrap().to_data().try_to_vec::<f32>().unwrap();
    (terms, gradient)
}

/// Returns each golden case as a batch of two: the case itself, and the case with truth and prediction exchanged.
fn batches() -> Vec<Batch> {
    let batch = |file: File| {
        let (truth, output) = (&file.tensors["truth"], &file.tensors["output"]);
        Batch {
            rows: truth.shape[2],
            cols: truth.shape[3],
            truth: vec![truth.data.clone(), output.data.clone()],
            predicted: vec![output.data.clone(), truth.data.clone()],
        }
    };
    golden_networks().iter().map(|path| batch(File::read(path).unwrap())).collect()
}

#[test]
fn automatic_differentiation_matches_the_analytic_gradient() {
    let pairs = [(ElevationTerm::MeanNormalised, Elevation::MeanNormalised), (ElevationTerm::L1, Elevation::L1)];
    // Each term alone, then the paper's sum, so that a large term cannot hide an error of another one.
    let weightings = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [10.0, 1.0, 1.0]];
    for batch in batches() {
        for ((core_term, burn_term), [elevation, gradient, normal]) in
            pairs.into_iter().flat_map(|pair| weightings.map(|w| (pair, w)))
        {
            let weights = Weights { elevation, gradient, normal };
            let burn_weights =
                LossWeights { elevation: elevation as f32, gradient: gradient as f32, normal: normal as f32 };
            let (expected, analytic) = by_core(&batch, core_term, weights);
            let (found, automatic) = by_burn(&batch, burn_term, burn_weights);
            for (name, f, e) in [
                ("elevation", found.elevation, expected.elevation),
                ("gradient", found.gradient, expected.gradient),
                ("normal", found.normal, expected.normal),
            ] {
                assert!((f - e).abs() <= tolerance::LOSS_TERM * e, "{name}: {f} instead of {e}");
            }
            let peak = analytic.iter().fold(0.0f32, |m, g| m.max(g.abs()));
            assert_eq!(analytic.len(), automatic.len());
            let worst = analytic.iter().zip(&automatic).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            println!("{core_term:?} {weights:?}: worst difference {:.1e} of the largest derivative", worst / peak);
            assert!(worst <= tolerance::LOSS_GRADIENT * peak, "{core_term:?} {weights:?}: off by {worst} of {peak}");
        }
    }
}
