"""The runtimes that are compared: each runs one tile on one thread and says how long that took."""
import copy
import json
import statistics
import struct
import subprocess
import time

import numpy as np
import onnxruntime
import torch


class Ours:
    """The int8 runner in a process of its own (`tile_server.rs`), which measures itself: pipes and start-up do not count."""

    def __init__(self, server, model, kernel=None):
        command = [server, model] + ([kernel] if kernel else [])
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        line = self.process.stdout.readline()
        if not line:
            self.close()
            raise SystemExit(f"ERROR: {server}: expected one line about {model}, found none")
        self.facts = json.loads(line)
        self.label = f"ours, {self.facts['kernel']}"

    def run(self, image, coarse):
        # Ours takes the maps of an image side by side in every pixel.
        self.process.stdin.write(np.moveaxis(image, 1, 3).tobytes() + coarse.tobytes())
        self.process.stdin.flush()
        answer = self.process.stdout.read(8 + coarse.nbytes)
        if len(answer) != 8 + coarse.nbytes:
            raise SystemExit(f"ERROR: {self.label}: expected {8 + coarse.nbytes} bytes, found {len(answer)}")
        return struct.unpack("<d", answer[:8])[0], np.frombuffer(answer[8:], "<f4").reshape(coarse.shape)

    def close(self):
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()


class OnnxRuntime:
    """A session on the CPU with every graph optimisation."""

    def __init__(self, path, label):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        self.label = label

    def run(self, image, coarse):
        feed = {"image": image, "coarse": coarse}
        start = time.perf_counter()
        output = self.session.run(None, feed)[0]
        return time.perf_counter() - start, output


class PyTorch:
    """The network in float, in the memory layout that is faster on `tile`."""

    def __init__(self, network, tile, trials=3):
        torch.set_num_threads(1)
        layouts = {
            "channels first": network,
            "channels last": copy.deepcopy(network).to(memory_format=torch.channels_last),
        }

        def seconds(name):
            self.network = layouts[name]
            return statistics.median(self.run(*tile)[0] for _ in range(trials))

        fastest = min(layouts, key=seconds)
        self.network = layouts[fastest]
        self.label = f"PyTorch float, {fastest}"

    def run(self, image, coarse):
        image, coarse = torch.from_numpy(image), torch.from_numpy(coarse)
        with torch.inference_mode():
            start = time.perf_counter()
            output = self.network(image, coarse)
            return time.perf_counter() - start, output.numpy()
