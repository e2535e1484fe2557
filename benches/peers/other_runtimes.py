"""OpenVINO, LiteRT, MNN and tract: each runs one tile on `threads` threads and says how long that took."""
import time

import numpy as np


def timed(work):
    """Seconds and output of `work`."""
    start = time.perf_counter()
    output = work()
    return time.perf_counter() - start, np.asarray(output)


class OpenVino:
    """`precision` is the one that the runtime may use for operators in float."""

    def __init__(self, path, label, threads, precision="f32"):
        import openvino

        settings = {"INFERENCE_NUM_THREADS": threads, "PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": precision}
        self.request = openvino.Core().compile_model(path, "CPU", settings).create_infer_request()
        self.label = label

    def run(self, image, coarse):
        return timed(lambda: next(iter(self.request.infer([image, coarse]).values())))


class LiteRt:
    """The interpreter of TensorFlow Lite with XNNPACK, which is its default on a CPU."""

    def __init__(self, path, label, threads):
        from ai_edge_litert.interpreter import Interpreter

        self.interpreter = Interpreter(str(path), num_threads=threads)
        self.interpreter.allocate_tensors()
        self.inputs = sorted(self.interpreter.get_input_details(), key=lambda one: one["name"])
        (self.output,) = self.interpreter.get_output_details()
        self.label = label

    def work(self, tile):
        for one, array in zip(self.inputs, tile):
            if one["dtype"] == np.int8:
                scale, zero = one["quantization"]
                array = np.clip(np.rint(array / scale + zero), -128, 127).astype(np.int8)
            self.interpreter.set_tensor(one["index"], array)
        self.interpreter.invoke()
        output = self.interpreter.get_tensor(self.output["index"])
        if output.dtype == np.int8:
            scale, zero = self.output["quantization"]
            output = (output.astype(np.float32) - zero) * np.float32(scale)
        return output

    def run(self, image, coarse):
        return timed(lambda: self.work((image, coarse)))


class Mnn:
    """A module of MNN. `memory="low"` computes products of int8 weights in int8."""

    def __init__(self, path, label, threads, **settings):
        import MNN

        self.mnn = MNN
        manager = MNN.nn.create_runtime_manager(({"backend": 0, "numThread": threads, **settings},))
        self.module = MNN.nn.load_module_from_file(str(path), ["image", "coarse"], ["dtm"], runtime_manager=manager)
        self.label = label

    def work(self, tile):
        expr = self.mnn.expr
        found = self.module.forward([expr.const(array, list(array.shape)) for array in tile])
        return np.array(expr.convert(found[0] if isinstance(found, (list, tuple)) else found, expr.NCHW).read())

    def run(self, image, coarse):
        return timed(lambda: self.work((image, coarse)))


class Tract:
    """A runtime in Rust. It has one thread."""

    def __init__(self, path, label):
        import tract

        self.model = tract.onnx().load(str(path)).into_model().into_runnable()
        self.label = label

    def run(self, image, coarse):
        return timed(lambda: self.model.run([image, coarse])[0].to_numpy())
