"""The network as files of OpenVINO, LiteRT and MNN. Ranges come from `tiles`, pairs of image and coarse DTM, where a file needs them."""
import logging
import subprocess
import sys
from pathlib import Path

import torch


def write_openvino_int8(float_onnx, tiles, path):
    """Quantises by NNCF, because OpenVINO does not run the file of ONNX Runtime. Weights lie beside `path`. With `nano`, these settings
    were the fastest and the most exact of four."""
    import nncf
    import openvino

    logging.getLogger("nncf").setLevel(logging.ERROR)
    feeds = nncf.Dataset([{"image": image, "coarse": coarse} for image, coarse in tiles])
    how = {"subset_size": len(tiles), "preset": nncf.QuantizationPreset.MIXED, "model_type": nncf.ModelType.TRANSFORMER}
    model = nncf.quantize(openvino.Core().read_model(float_onnx), feeds, **how)
    openvino.save_model(model, path, compress_to_fp16=False)


def write_litert_float(network, tile, path):
    """Converts from PyTorch; `tile` is any pair of inputs."""
    import litert_torch

    litert_torch.convert(network, tuple(torch.from_numpy(array) for array in tile)).export(str(path))


def write_litert_int8(float_path, tiles, path, dynamic):
    """Quantises weights, and activations: with fixed ranges, or (`dynamic`) each by its own range when it is computed."""
    from ai_edge_litert.interpreter import Interpreter
    from ai_edge_quantizer import quantizer, recipe

    rules = recipe.dynamic_wi8_afp32() if dynamic else recipe.static_wi8_ai8()
    work = quantizer.Quantizer(str(float_path), rules)
    name, signature = next(iter(Interpreter(str(float_path)).get_signature_list().items()))
    feeds = [dict(zip(sorted(signature["inputs"]), tile)) for tile in tiles]
    ranges = work.calibrate({name: feeds}) if work.need_calibration else None
    Path(path).write_bytes(work.quantize(ranges).quantized_model)


def write_mnn(float_onnx, path, bits=None):
    """Converts from ONNX; `bits` are those of weights, otherwise they stay in float."""
    command = [str(Path(sys.executable).with_name("mnnconvert")), "-f", "ONNX", "--modelFile", str(float_onnx)]
    command += ["--MNNModel", str(path), "--bizCode", "x"] + (["--weightQuantBits", str(bits)] if bits else [])
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode or not Path(path).exists():
        raise RuntimeError(f"mnnconvert: {done.stdout[-200:]}{done.stderr[-200:]}")
