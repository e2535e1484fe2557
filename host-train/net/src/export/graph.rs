//! The network before quantisation, as a list of operators on maps `[rows, cols, channels]`. Batch norm is folded.

/// Position of a node in [`Graph::nodes`]. A node always comes after its inputs.
pub type NodeId = usize;

/// A map that a convolution reads. Its channels follow those of the previous source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvInput {
    /// The node whose output is read.
    pub node: NodeId,
    /// Whether the map is upsampled twofold first (bilinear, half-pixel centres).
    pub up: bool,
}

/// Function after a convolution's sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// No function.
    None,
    /// max(x, 0).
    Relu,
    /// x Φ(x).
    Gelu,
}

/// Weights of a convolution or linear layer.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerWeights {
    /// Output channels.
    pub output: usize,
    /// Input channels.
    pub input: usize,
    /// Side, pixels.
    pub side: usize,
    /// Weights `[output][side][side][input]`, in the order in which the runner reads them.
    pub weights: Vec<f32>,
    /// Bias `[output]`.
    pub bias: Vec<f32>,
}

/// Computation of a node.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// The image, [0, 1].
    Image,
    /// The normalised coarse DTM, [0, NR].
    Coarse,
    /// Convolution over the channels of all sources, plus another map, then an activation.
    Conv {
        /// Maps that the convolution reads.
        sources: Vec<ConvInput>,
        /// Weights and bias.
        kernel: LayerWeights,
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
        /// Map that the norm reads.
        input: NodeId,
        /// Side of the group of neighbours gathered first: 2 for patch merging, otherwise 1.
        merge: usize,
        /// Gain per channel.
        gain: Vec<f32>,
        /// Bias per channel.
        bias: Vec<f32>,
    },
    /// Attention in shifted windows. The channels of q, k, v follow each other.
    Attention {
        /// Map that the attention reads.
        input: NodeId,
        /// Heads.
        heads: usize,
        /// Window side.
        window: usize,
        /// Cyclic shift in rows and columns.
        shift: (usize, usize),
        /// Relative position bias `[(2w-1)²][heads]`.
        position_bias: Vec<f32>,
        /// Values of q, k, v in the padding: the bias of the preceding projection.
        pad: Vec<f32>,
    },
}

/// One operator and its output map.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Name for reports. Traced maps have the golden files' names (`e1`, `s5`, `fused`, `d1`, `output`, ...).
    pub name: String,
    /// Computation of the node.
    pub operation: Operation,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Channels.
    pub channels: usize,
    /// Whether 8 bits would be visible in the result. Such maps keep 16 bits, unless the export is for the least memory.
    pub precise: bool,
}

impl Node {
    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.rows * self.cols * self.channels
    }

    /// Returns whether the map has no samples. A built graph has no such node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the nodes that this node reads; an added map comes last.
    pub fn inputs(&self) -> Vec<NodeId> {
        match &self.operation {
            Operation::Image | Operation::Coarse => Vec::new(),
            Operation::Conv { sources, add, .. } => sources.iter().map(|s| s.node).chain(*add).collect(),
            Operation::LayerNorm { input, .. } | Operation::Attention { input, .. } => vec![*input],
        }
    }
}

/// A whole network. The last node is its output.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Graph {
    /// The nodes in the order of execution.
    pub nodes: Vec<Node>,
}

impl Graph {
    /// Returns the output node.
    pub fn output(&self) -> NodeId {
        self.nodes.len() - 1
    }

    /// Returns the nodes that read `id`.
    pub fn users(&self, id: NodeId) -> impl Iterator<Item = &Node> {
        self.nodes.iter().filter(move |node| node.inputs().contains(&id))
    }
}
