//! The network as a list of operators on maps `[rows, cols, channels]`, batch norm folded, before quantisation.

/// Position of a node in [`Graph::nodes`]; inputs always lie before their users.
pub type NodeId = usize;

/// A map read by a convolution, its channels behind those of the source before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source {
    /// Whose output.
    pub node: NodeId,
    /// Whether it is upsampled twofold (bilinear, half-pixel centres) on the way.
    pub up: bool,
}

/// What follows a convolution's sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    None,
    /// max(x, 0).
    Relu,
    /// x Φ(x).
    Gelu,
}

/// Weights of a convolution or linear layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    /// Output channels.
    pub output: usize,
    /// Input channels.
    pub input: usize,
    /// Side, pixels.
    pub side: usize,
    /// `[output][side][side][input]`: the order in which the runner meets them.
    pub weights: Vec<f32>,
    /// `[output]`.
    pub bias: Vec<f32>,
}

/// What a node computes.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// The image, [0, 1].
    Image,
    /// The normalised coarse DTM, [0, NR].
    Coarse,
    /// Convolution over the sources side by side, plus another map, then an activation.
    Conv {
        /// What it reads.
        sources: Vec<Source>,
        /// Weights and bias.
        kernel: Kernel,
        /// Stride.
        stride: usize,
        /// Zero padding on every side.
        pad: usize,
        /// Map added before the activation.
        add: Option<NodeId>,
        /// Activation.
        activation: Activation,
    },
    /// Layer norm over channels.
    LayerNorm {
        /// What it reads.
        input: NodeId,
        /// 2 gathers 2x2 neighbours first (patch merging), else 1.
        merge: usize,
        /// Gain per channel.
        gain: Vec<f32>,
        /// Bias per channel.
        bias: Vec<f32>,
    },
    /// Attention in shifted windows on q, k, v side by side.
    Attention {
        /// What it reads.
        input: NodeId,
        /// Heads.
        heads: usize,
        /// Window side.
        window: usize,
        /// Cyclic shift in rows and columns.
        shift: (usize, usize),
        /// Relative position bias `[(2w-1)²][heads]`.
        position_bias: Vec<f32>,
        /// q, k, v in the padding: the bias of the projection before.
        pad: Vec<f32>,
    },
}

/// One operator and its output map.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Name for reports; traced maps carry the golden files' names (`e1`, `s5`, `fused`, `d1`, `output`, ...).
    pub name: String,
    /// What it computes.
    pub operation: Operation,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Channels.
    pub channels: usize,
    /// Whether 8 bits would be seen in the result: such maps keep 16 unless the export asks for the least memory.
    pub precise: bool,
}

impl Node {
    /// Samples.
    pub fn len(&self) -> usize {
        self.rows * self.cols * self.channels
    }

    /// Whether the map has no samples (never in a built graph).
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The nodes it reads; an added map last.
    pub fn inputs(&self) -> Vec<NodeId> {
        match &self.operation {
            Operation::Image | Operation::Coarse => Vec::new(),
            Operation::Conv { sources, add, .. } => sources.iter().map(|s| s.node).chain(*add).collect(),
            Operation::LayerNorm { input, .. } | Operation::Attention { input, .. } => vec![*input],
        }
    }
}

/// A whole network; the last node is its output.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Graph {
    /// In the order of execution.
    pub nodes: Vec<Node>,
}

impl Graph {
    /// The output node.
    pub fn output(&self) -> NodeId {
        self.nodes.len() - 1
    }

    /// The nodes that read `id`.
    pub fn users(&self, id: NodeId) -> impl Iterator<Item = &Node> {
        self.nodes.iter().filter(move |node| node.inputs().contains(&id))
    }
}
