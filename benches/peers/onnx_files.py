"""The network as ONNX files for ONNX Runtime: in float, and statically quantised."""
import onnx
import torch
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

OPSET = 20  # the first with GELU as one operator

# What works on int8. Layer norm, GELU and softmax stay in float: ONNX Runtime has no int8 kernel for the first two, and that of
# softmax was slower. Of the sets tried with `nano` (matrix products alone, with additions, with everything) this was fastest.
INT8 = ["Conv", "MatMul", "Gemm", "Add", "Concat", "Resize", "Relu", "Transpose", "Reshape", "Slice", "Squeeze", "Pad"]


class Tiles(CalibrationDataReader):
    """Feeds tiles, pairs of image and coarse DTM, one by one."""

    def __init__(self, tiles):
        self.feeds = iter([{"image": image, "coarse": coarse} for image, coarse in tiles])

    def get_next(self):
        return next(self.feeds, None)


def write_float(network, tile, path):
    """Exports `network` to `path`; `tile` is any pair of inputs."""
    inputs = tuple(torch.from_numpy(array) for array in tile)
    torch.onnx.export(
        network,
        inputs,
        path,
        input_names=["image", "coarse"],
        output_names=["dtm"],
        opset_version=OPSET,
        dynamo=True,
        external_data=False,
        verbose=False,
    )


def kept_in_float(graph):
    """Names of nodes that lose too much in int8: the head, whose steps would be terraces, and the -100 of shift masks."""
    makers = {name: node for node in graph.node for name in node.output}
    masked = [makers[node.input[0]].name for node in graph.node if node.op_type == "Softmax"]
    head, at = [], makers[graph.output[0].name]
    while at.op_type != "Conv":
        head.append(at.name)
        at = makers[at.input[0]]
    return [*masked, *head, at.name]


def write_int8(float_path, tiles, path):
    """Quantises to u8 activations and s8 weights per output channel, the form of x86's VNNI, with ranges from `tiles`."""
    prepared = path.with_suffix(".prepared")
    quant_pre_process(float_path, prepared, skip_symbolic_shape=True)
    graph = onnx.load(prepared, load_external_data=False).graph
    quantize_static(
        prepared,
        path,
        Tiles(tiles),
        quant_format=QuantFormat.QDQ,
        op_types_to_quantize=INT8,
        nodes_to_exclude=kept_in_float(graph),
        per_channel=True,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
    )
    prepared.unlink()
