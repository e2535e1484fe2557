"""Makes and finds the files that a comparison needs: weights, the runner's model file, ONNX files. Up-to-date ones are kept."""
import hashlib
import json
import subprocess
import sys
from pathlib import Path

from safetensors import SafetensorError

import network
import onnx_files
import other_files
import tiles

HERE = Path(__file__).resolve().parent
MADE = HERE / "made"
MANIFEST = HERE.parents[1] / "Cargo.toml"
PRESETS = ("nano", "tiny", "small", "paper")
CALIBRATION_TILES = 4


def say(text):
    print(text, file=sys.stderr, flush=True)


def run(*command):
    """Runs a program of ours, its report on standard error."""
    command = [str(word) for word in command]
    say(f"$ {' '.join(command)}")
    if subprocess.run(command, stdout=sys.stderr).returncode:
        raise SystemExit(f"ERROR: expected success of `{' '.join(command)}`, found failure")


def programs(folder, server="tile_server"):
    """`host-train` and a server: those in `folder`, or freshly built ones of this source tree."""
    if folder is None:
        packages = ["-p", "host-train", "-p", "elunar-benches", "--bin", "host-train", "--example", server]
        run("cargo", "build", "--release", "--locked", *packages, "--manifest-path", MANIFEST)
        metadata = ["cargo", "metadata", "--no-deps", "--format-version", "1", "--manifest-path", MANIFEST]
        folder = Path(json.loads(subprocess.check_output(metadata))["target_directory"]) / "release"
    found = folder / "host-train", folder / "examples" / server
    for program in found:
        if not program.exists():
            raise SystemExit(f"ERROR: --binaries {folder}: expected {program}, found none")
    return found


def digest(path):
    """Eight hexadecimal digits of the file's SHA-256."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:8]


def make(target, sources, write):
    """Has `write(path)` make `target` where it is absent or older than a source; an interrupted one leaves no half of it."""
    if target.exists() and all(source.stat().st_mtime <= target.stat().st_mtime for source in sources):
        return
    say(f"writing {target.relative_to(HERE)}")
    partial = MADE / "partial" / target.name
    partial.parent.mkdir(parents=True, exist_ok=True)
    write(partial)
    partial.replace(target)


def weights(name, head, host_train):
    """The weight file called so: a preset, for random weights, or the file itself."""
    if name in PRESETS:
        path = MADE / f"{name}-{head}.safetensors"
        paper = ["target_range=own", "illumination=any", "detail=0", "bn_momentum=0.1", f"head={head}"]
        init = [host_train, "init", "--preset", name, "--seed", 1, "--set", *(f"network.{key}" for key in paper), "-o"]
        make(path, [host_train], lambda path: run(*init, path))
        return path
    if not Path(name).is_file():
        raise SystemExit(f"ERROR: {name}: expected one of {', '.join(PRESETS)} or a weight file, found neither")
    return Path(name)


class Network:
    """One network and its files. `name` is a preset, for random weights, or a weight file."""

    def __init__(self, name, head, precision, host_train):
        self.weights, self.name = weights(name, head, host_train), Path(name).stem
        try:
            self.module, self.config = network.load(self.weights, tiles.ROWS, tiles.COLS)
        except (ValueError, RuntimeError, SafetensorError) as misfit:
            raise SystemExit(f"ERROR: {self.weights}: {misfit}") from None
        self.tile = tiles.tile(0, self.config)
        stem = MADE / f"{self.name}-{digest(self.weights)}"
        self.model = Path(f"{stem}-{precision}.eld")
        self.float_onnx, self.int8_onnx = Path(f"{stem}-float.onnx"), Path(f"{stem}-int8.onnx")
        export = [host_train, "export", "--weights", self.weights, "--precision", precision]
        export += ["--tiles", CALIBRATION_TILES, "--compare", 0, "-o"]
        make(self.model, [host_train], lambda path: run(*export, path))
        code = [HERE / f"{module}.py" for module in ("network", "onnx_files", "tiles")]
        make(self.float_onnx, code, lambda path: onnx_files.write_float(self.module, self.tile, path))
        make(self.int8_onnx, [self.float_onnx], lambda path: onnx_files.write_int8(self.float_onnx, self.calibration(), path))
        self.stem = stem

    def openvino_int8(self):
        """Returns the file of NNCF's network, made if need be."""
        target, code = Path(f"{self.stem}-nncf.xml"), [HERE / "other_files.py"]

        def write(path):
            other_files.write_openvino_int8(self.float_onnx, self.calibration(), path)
            path.with_suffix(".bin").replace(target.with_suffix(".bin"))

        make(target, [self.float_onnx, *code], write)
        return target

    def litert(self, kind):
        """Returns the network's file of LiteRT, made if need be: `float`, `static` or `dynamic`."""
        target = Path(f"{self.stem}-{kind}.tflite")
        if kind == "float":
            make(target, [self.float_onnx], lambda path: other_files.write_litert_float(self.module, self.tile, path))
        else:
            source, dynamic = self.litert("float"), kind == "dynamic"
            make(target, [source], lambda path: other_files.write_litert_int8(source, self.calibration(), path, dynamic))
        return target

    def mnn(self, bits=None):
        """Returns the network's file of MNN, made if need be; `bits` are those of weights, otherwise they stay in float."""
        target = Path(f"{self.stem}-{bits or 32}.mnn")
        make(target, [self.float_onnx], lambda path: other_files.write_mnn(self.float_onnx, path, bits))
        return target

    def calibration(self):
        """Tiles other than the one that is timed."""
        return [tiles.tile(1 + i, self.config) for i in range(CALIBRATION_TILES)]
