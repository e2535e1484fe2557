//! The operator graph, from configuration and weights. Batch norm becomes part of the convolution before it.

use super::graph::{Activation, ConvInput, Graph, LayerWeights, Node, NodeId, Operation};
use crate::config::{DTM_KERNELS, DecoderKind, ImageEncoderKind, NetConfig, OutputHead, RESNET_BLOCKS};
use crate::fit::check_fit;
use crate::weights::NetWeights;
use elunar_base::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Batch and layer norm epsilon (PyTorch's default).
pub const NORM_EPSILON: f64 = 1e-5;

/// Builds the graph for tiles of `rows` by `cols`. Messages call the weights `path`.
///
/// # Errors
/// [`Error::Input`] for a tile that is no multiple of 32, [`Error::Unsupported`] for a single-branch network or a U-Net, [`Error::Broken`] if weights
/// do not fit the configuration: all misfits in one line, each with expected and found shape.
pub fn build(config: &NetConfig, weights: &NetWeights, path: &Path, (rows, cols): (usize, usize)) -> Result<Graph> {
    config.check().map_err(|what| Error::broken(path, what))?;
    if rows == 0 || cols == 0 || rows % 32 != 0 || cols % 32 != 0 {
        return Err(Error::input(format!("tile: expected multiples of 32, found {rows} x {cols}")));
    }
    if config.coarse_channel {
        return Err(Error::unsupported(
            path,
            "expected a network with a branch for the coarse DTM; it is a channel of the image here",
        ));
    }
    if !config.unet.is_empty() {
        return Err(Error::unsupported(
            path,
            "expected the paper's network; a plain U-Net is for comparisons on the ground",
        ));
    }
    let mut builder = Builder::new(config, weights);
    builder.network(rows, cols);
    check_fit(&builder.reader.asked, weights, path)?;
    Ok(builder.graph)
}

/// Returns the name and shape of every tensor that a configuration's weights hold.
///
/// # Errors
/// [`Error::Input`] if the configuration contradicts itself.
pub fn manifest(config: &NetConfig) -> Result<BTreeMap<String, Vec<usize>>> {
    config.check().map_err(Error::input)?;
    let none = NetWeights::default();
    let mut builder = Builder::new(config, &none);
    builder.network(32, 32);
    Ok(builder.reader.asked)
}

/// Returns tensors and records which were requested.
struct Reader<'a> {
    weights: &'a NetWeights,
    asked: BTreeMap<String, Vec<usize>>,
}

impl Reader<'_> {
    /// Returns the tensor, or zeros if there is none of that shape. The caller must pass all requested tensors to [`check_fit`].
    fn get(&mut self, name: &str, shape: &[usize]) -> Vec<f32> {
        self.asked.insert(name.into(), shape.to_vec());
        let found = self.weights.tensors.get(name).filter(|array| array.shape == shape);
        found.map_or_else(|| vec![0.0; shape.iter().product()], |array| array.data.clone())
    }
}

/// Reorders `[out, in, k, k]` to `[out, k, k, in]`.
fn interleave(weights: &[f32], input: usize, side: usize) -> Vec<f32> {
    let area = side * side;
    let filter = |w: &[f32]| -> Vec<f32> { (0..area * input).map(|i| w[i % input * area + i / input]).collect() };
    weights.chunks_exact(area * input).flat_map(filter).collect()
}

struct Builder<'a> {
    config: &'a NetConfig,
    reader: Reader<'a>,
    graph: Graph,
}

/// Shape of a convolution to add.
#[derive(Clone, Copy)]
struct Spec {
    output: usize,
    side: usize,
    stride: usize,
    activation: Activation,
    precise: bool,
}

impl<'a> Builder<'a> {
    fn new(config: &'a NetConfig, weights: &'a NetWeights) -> Self {
        let reader = Reader { weights, asked: BTreeMap::new() };
        Self { config, reader, graph: Graph::default() }
    }

    fn network(&mut self, rows: usize, cols: usize) {
        let image = self.push("image", Operation::Image, (rows, cols, self.config.encoder_channels()), true);
        let needs_coarse = self.config.use_coarse || self.config.head == OutputHead::Residual;
        let coarse = needs_coarse.then(|| self.push("coarse", Operation::Coarse, (rows, cols, 1), true));
        let e = self.image_encoder(image);
        let mut deepest = vec![plain(e[4])];
        if let (true, Some(coarse)) = (self.config.use_coarse, coarse) {
            let mut s = coarse;
            for (i, side) in DTM_KERNELS.into_iter().enumerate() {
                let spec =
                    Spec { output: self.config.dtm[i], side, stride: 2, activation: Activation::Relu, precise: false };
                s = self.conv_bn(&format!("dtm_encoder.{i}"), &[plain(s)], spec, None);
            }
            self.rename(s, "s5");
            deepest.push(plain(s));
        }
        // Eq. 3: concatenation, 3x3 convolution, batch norm, no ReLU.
        let spec =
            Spec { output: 8 * self.config.embed, side: 3, stride: 1, activation: Activation::None, precise: false };
        let mut d = self.conv_bn("fusion", &deepest, spec, None);
        self.rename(d, "fused");
        for u in 0..5 {
            d = self.decoder_block(u, d, (u > 0).then(|| e[4 - u]));
        }
        if self.config.detail > 0 {
            d = self.detail(image, d);
        }
        self.head(d, coarse);
    }

    /// Adds the detail stage: a convolution of the decoder's last map and the image's maps, then residual blocks.
    fn detail(&mut self, image: NodeId, d: NodeId) -> NodeId {
        let (channels, inner) = (self.config.detail, self.config.detail_inner);
        // As in the decoder: the steps of an 8-bit map before the head would be terraces.
        let mut x = self.join(image, d);
        for block in 0..self.config.detail_blocks {
            let within = self.biased(&format!("detail.blocks.{block}.0"), x, inner, None, false);
            x = self.biased(&format!("detail.blocks.{block}.1"), within, channels, Some(x), true);
        }
        x
    }

    /// Adds the convolution of the decoder's last map and the image's maps, as the sum of two: a weight has eight bits relative to the largest
    /// product of weight and step, and the image's steps are a hundred times those of the decoder's map.
    fn join(&mut self, image: NodeId, d: NodeId) -> NodeId {
        let (name, output) = ("detail.join", self.config.detail);
        let [first, second] = [d, image].map(|node| self.graph.nodes[node].channels);
        let whole = self.kernel(name, first + second, output, 3, true);
        let part = |from: usize, input: usize, bias: Vec<f32>| {
            let pixels = whole.weights.chunks_exact(first + second);
            LayerWeights {
                input,
                bias,
                weights: pixels.flat_map(|w| &w[from..from + input]).copied().collect(),
                ..whole
            }
        };
        let [of_d, of_image] = [part(0, first, whole.bias.clone()), part(first, second, vec![0.0; output])];
        let fine = self.conv("detail.image", &[plain(image)], of_image, (1, 1), Activation::None, None, true);
        self.conv(name, &[plain(d)], of_d, (1, 1), Activation::Relu, Some(fine), true)
    }

    /// Adds a 3x3 convolution with bias and ReLU.
    fn biased(&mut self, name: &str, input: NodeId, output: usize, add: Option<NodeId>, precise: bool) -> NodeId {
        let kernel = self.kernel(name, self.graph.nodes[input].channels, output, 3, true);
        self.conv(name, &[plain(input)], kernel, (1, 1), Activation::Relu, add, precise)
    }

    fn image_encoder(&mut self, image: NodeId) -> [NodeId; 5] {
        let spec = Spec { output: self.config.stem, side: 7, stride: 2, activation: Activation::Relu, precise: false };
        let stem = self.conv_bn("image_encoder.stem", &[plain(image)], spec, None);
        self.rename(stem, "e1");
        let deeper = match self.config.image_encoder {
            ImageEncoderKind::Swin => self.swin(image),
            ImageEncoderKind::Resnet => self.resnet(stem),
        };
        [stem, deeper[0], deeper[1], deeper[2], deeper[3]]
    }

    fn resnet(&mut self, stem: NodeId) -> [NodeId; 4] {
        let mut x = stem;
        std::array::from_fn(|i| {
            let output = self.config.embed << i;
            for j in 0..RESNET_BLOCKS {
                let prefix = format!("image_encoder.resnet.stages.{i}.{j}");
                let stride = if j == 0 { 2 } else { 1 };
                let spec = |side, stride, activation| Spec { output, side, stride, activation, precise: false };
                let first = spec(3, stride, Activation::Relu);
                let main = self.conv_bn(&format!("{prefix}.conv1"), &[plain(x)], first, None);
                let same = stride == 1 && self.graph.nodes[x].channels == output;
                let short = if same {
                    x
                } else {
                    let spec = Spec { precise: true, ..spec(1, stride, Activation::None) };
                    self.conv_bn(&format!("{prefix}.shortcut"), &[plain(x)], spec, None)
                };
                x = self.conv_bn(&format!("{prefix}.conv2"), &[plain(main)], spec(3, 1, Activation::Relu), Some(short));
            }
            self.rename(x, &format!("e{}", i + 2));
            x
        })
    }

    fn swin(&mut self, image: NodeId) -> [NodeId; 4] {
        let embed = self.config.embed;
        let name = "image_encoder.swin.patch_embed";
        let kernel = self.kernel(&format!("{name}.proj"), self.config.encoder_channels(), embed, 4, true);
        let patches = self.conv(&format!("{name}.proj"), &[plain(image)], kernel, (4, 0), Activation::None, None, true);
        let mut x = self.layer_norm(&format!("{name}.norm"), patches, 1, true);
        std::array::from_fn(|i| {
            let stage = format!("image_encoder.swin.layers.{i}");
            if i > 0 {
                let merged = self.layer_norm(&format!("{stage}.downsample.norm"), x, 2, false);
                x = self.linear(
                    &format!("{stage}.downsample.reduction"),
                    merged,
                    embed << i,
                    None,
                    Activation::None,
                    true,
                );
            }
            for j in 0..self.config.depths[i] {
                x = self.swin_block(&format!("{stage}.blocks.{j}"), x, self.config.heads[i], j % 2 == 1);
            }
            let e = self.layer_norm(&format!("image_encoder.swin.norm{i}"), x, 1, false);
            self.rename(e, &format!("e{}", i + 2));
            e
        })
    }

    fn swin_block(&mut self, name: &str, x: NodeId, heads: usize, shifted: bool) -> NodeId {
        let (rows, cols, channels) = self.size(x);
        let window = self.config.window;
        let shift = if shifted { window / 2 } else { 0 };
        // If one window covers an axis, the shift along it is 0.
        let along = |len: usize| if len > window { shift } else { 0 };
        let normed = self.layer_norm(&format!("{name}.norm1"), x, 1, false);
        let qkv = self.linear(&format!("{name}.attn.qkv"), normed, 3 * channels, None, Activation::None, false);
        let table = (2 * window - 1) * (2 * window - 1);
        let position_bias = self.reader.get(&format!("{name}.attn.relative_position_bias_table"), &[table, heads]);
        let pad = self.reader.get(&format!("{name}.attn.qkv.bias"), &[3 * channels]);
        let operation =
            Operation::Attention { input: qkv, heads, window, shift: (along(rows), along(cols)), position_bias, pad };
        let attended = self.push(&format!("{name}.attn"), operation, (rows, cols, channels), false);
        let x = self.linear(&format!("{name}.attn.proj"), attended, channels, Some(x), Activation::None, true);
        let normed = self.layer_norm(&format!("{name}.norm2"), x, 1, false);
        let hidden = self.linear(&format!("{name}.mlp.fc1"), normed, 4 * channels, None, Activation::Gelu, false);
        self.linear(&format!("{name}.mlp.fc2"), hidden, channels, Some(x), Activation::None, true)
    }

    fn decoder_block(&mut self, u: usize, d: NodeId, e: Option<NodeId>) -> NodeId {
        let (output, name) = (self.config.decoder[u], format!("decoder.{u}"));
        let up = |node| ConvInput { node, up: true };
        let all: Vec<ConvInput> = e.into_iter().chain([d]).map(up).collect();
        let short = if self.config.decoder_kind == DecoderKind::Upb { all.clone() } else { vec![up(d)] };
        // The steps of an 8-bit map before the head would be terraces in the DTM. Earlier maps are smoothed by later layers.
        let precise = u == 4;
        let spec = |side, activation, precise| Spec { output, side, stride: 1, activation, precise };
        let main = self.conv_bn(&format!("{name}.main.0"), &all, spec(5, Activation::Relu, false), None);
        let short = self.conv_bn(&format!("{name}.shortcut"), &short, spec(5, Activation::None, true), None);
        let sum = spec(3, Activation::Relu, precise);
        let d = self.conv_bn(&format!("{name}.main.1"), &[plain(main)], sum, Some(short));
        self.rename(d, &format!("d{}", u + 1));
        d
    }

    fn head(&mut self, d: NodeId, coarse: Option<NodeId>) {
        let residual = self.config.head == OutputHead::Residual;
        let kernel = self.kernel("head", self.config.head_channels(), 1, 3, true);
        let activation = if residual { Activation::None } else { Activation::Relu };
        let add = coarse.filter(|_| residual);
        let head = self.conv("head", &[plain(d)], kernel, (1, 1), activation, add, true);
        self.rename(head, "output");
    }

    // ---- one node ------------------------------------------------------------------------------------------------

    fn push(&mut self, name: &str, operation: Operation, size: (usize, usize, usize), precise: bool) -> NodeId {
        let (rows, cols, channels) = size;
        self.graph.nodes.push(Node { name: name.into(), operation, rows, cols, channels, precise });
        self.graph.nodes.len() - 1
    }

    fn rename(&mut self, node: NodeId, name: &str) {
        self.graph.nodes[node].name = name.into();
    }

    fn size(&self, node: NodeId) -> (usize, usize, usize) {
        let n = &self.graph.nodes[node];
        (n.rows, n.cols, n.channels)
    }

    fn kernel(&mut self, name: &str, input: usize, output: usize, side: usize, bias: bool) -> LayerWeights {
        let weights = self.reader.get(&format!("{name}.weight"), &[output, input, side, side]);
        let bias = if bias { self.reader.get(&format!("{name}.bias"), &[output]) } else { vec![0.0; output] };
        LayerWeights { output, input, side, weights: interleave(&weights, input, side), bias }
    }

    fn linear(
        &mut self,
        name: &str,
        input: NodeId,
        output: usize,
        add: Option<NodeId>,
        activation: Activation,
        precise: bool,
    ) -> NodeId {
        let channels = self.graph.nodes[input].channels;
        let weights = self.reader.get(&format!("{name}.weight"), &[output, channels]);
        let bias = if name.ends_with("reduction") {
            vec![0.0; output]
        } else {
            self.reader.get(&format!("{name}.bias"), &[output])
        };
        let kernel = LayerWeights { output, input: channels, side: 1, weights, bias };
        self.conv(name, &[plain(input)], kernel, (1, 0), activation, add, precise)
    }

    /// Combines convolution and batch norm: w' = w γ/√(σ²+ε), b' = β − μ γ/√(σ²+ε).
    fn conv_bn(&mut self, name: &str, sources: &[ConvInput], spec: Spec, add: Option<NodeId>) -> NodeId {
        let input = sources.iter().map(|s| self.graph.nodes[s.node].channels).sum();
        let mut kernel = self.kernel(&format!("{name}.conv"), input, spec.output, spec.side, false);
        let mut statistic = |part: &str| self.reader.get(&format!("{name}.bn.{part}"), &[spec.output]);
        let (gain, bias) = (statistic("weight"), statistic("bias"));
        let (mean, variance) = (statistic("running_mean"), statistic("running_var"));
        let taps = input * spec.side * spec.side;
        for (o, filter) in kernel.weights.chunks_exact_mut(taps).enumerate() {
            let factor = gain[o] as f64 / (variance[o] as f64 + NORM_EPSILON).sqrt();
            filter.iter_mut().for_each(|w| *w = (*w as f64 * factor) as f32);
            kernel.bias[o] = (bias[o] as f64 - mean[o] as f64 * factor) as f32;
        }
        self.conv(name, sources, kernel, (spec.stride, spec.side / 2), spec.activation, add, spec.precise)
    }

    #[expect(clippy::too_many_arguments, reason = "one private place where every convolution is put together")]
    fn conv(
        &mut self,
        name: &str,
        sources: &[ConvInput],
        kernel: LayerWeights,
        (stride, pad): (usize, usize),
        activation: Activation,
        add: Option<NodeId>,
        precise: bool,
    ) -> NodeId {
        let (rows, cols, _) = self.size(sources[0].node);
        let factor = if sources[0].up { 2 } else { 1 };
        let extent = |len: usize| (len * factor + 2 * pad - kernel.side) / stride + 1;
        let size = (extent(rows), extent(cols), kernel.output);
        let operation = Operation::Conv { sources: sources.to_vec(), kernel, stride, pad, add, activation };
        self.push(name, operation, size, precise)
    }

    fn layer_norm(&mut self, name: &str, input: NodeId, merge: usize, precise: bool) -> NodeId {
        let (rows, cols, channels) = self.size(input);
        let channels = channels * merge * merge;
        let gain = self.reader.get(&format!("{name}.weight"), &[channels]);
        let bias = self.reader.get(&format!("{name}.bias"), &[channels]);
        let operation = Operation::LayerNorm { input, merge, gain, bias };
        self.push(name, operation, (rows / merge, cols / merge, channels), precise)
    }
}

fn plain(node: NodeId) -> ConvInput {
    ConvInput { node, up: false }
}
