"""Runs tiles by a runtime on one thread: `aarch64_tiles.py onnxruntime|litert FILE TILES`. Their samples are alike: counts do not depend on them."""
import sys

import numpy as np


def onnxruntime(path):
    """A function that runs a tile and returns its output."""
    import onnxruntime as library

    options = library.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = library.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    tile = {one.name: np.full(one.shape, 0.5, np.float32) for one in session.get_inputs()}
    return lambda: session.run(None, tile)[0]


def litert(path):
    """The same."""
    from ai_edge_litert.interpreter import Interpreter

    network = Interpreter(model_path=path, num_threads=1)
    network.allocate_tensors()
    for one in network.get_input_details():
        network.set_tensor(one["index"], np.full(one["shape"], 0.5, one["dtype"]))

    def run():
        network.invoke()
        return network.get_tensor(network.get_output_details()[0]["index"])

    return run


def main():
    library, path, tiles = sys.argv[1:]
    run = {"onnxruntime": onnxruntime, "litert": litert}[library](path)
    for _ in range(int(tiles)):
        output = run()
    print(f"{path}: {tiles} tiles, mean {output.mean():.3f}")


if __name__ == "__main__":
    main()
