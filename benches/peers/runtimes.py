"""Ours, ONNX Runtime and PyTorch: each runs one tile on `threads` threads and says how long that took."""
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
    """The int8 runner in processes of its own (`tile_server.rs`), which measure themselves: pipes and start-up do not count. The runner has
    one thread, so several threads run as many tiles at once."""

    def __init__(self, server, model, threads, kernel=None):
        command = [server, model] + ([kernel] if kernel else [])
        self.processes = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) for _ in range(threads)]
        lines = [process.stdout.readline() for process in self.processes]
        if not all(lines):
            self.close()
            raise SystemExit(f"ERROR: {server}: expected one line about {model}, found none")
        self.facts = json.loads(lines[0])
        self.label = f"ours, {self.facts['kernel']}"

    def run(self, image, coarse):
        # Ours takes the maps of an image side by side in every pixel.
        tile = np.moveaxis(image, 1, 3).tobytes() + coarse.tobytes()
        for process in self.processes:
            process.stdin.write(tile)
            process.stdin.flush()
        answers = [process.stdout.read(8 + coarse.nbytes) for process in self.processes]
        for answer in answers:
            if len(answer) != 8 + coarse.nbytes:
                raise SystemExit(f"ERROR: {self.label}: expected {8 + coarse.nbytes} bytes, found {len(answer)}")
        seconds = max(struct.unpack("<d", answer[:8])[0] for answer in answers) / len(answers)
        return seconds, np.frombuffer(answers[0][8:], "<f4").reshape(coarse.shape)

    def close(self):
        for process in self.processes:
            process.stdin.close()
            process.wait()
            process.stdout.close()


class OnnxRuntime:
    """A session on the CPU with every graph optimisation."""

    def __init__(self, path, label, threads):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
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

    def __init__(self, network, tile, threads, trials=3):
        torch.set_num_threads(threads)
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
