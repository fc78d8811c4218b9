"""Runs turnlight's own example programs, which hand their numbers over as .npy files."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent


def build(name):
    """Compiles the example in release mode; returns the path of its program."""
    subprocess.run(
        ["cargo", "build", "--release", "--quiet", "--example", name], cwd=ROOT, check=True
    )
    return ROOT / "target" / "release" / "examples" / name


def run(program, *arguments, outputs):
    """Arrays among the arguments are passed as files; returns `outputs` arrays."""
    with tempfile.TemporaryDirectory() as folder:
        words = [str(program)]
        for k, argument in enumerate(arguments):
            if isinstance(argument, np.ndarray):
                path = Path(folder) / f"in{k}.npy"
                np.save(path, np.ascontiguousarray(argument, dtype=np.float32))
                argument = path
            words.append(str(argument))
        results = [Path(folder) / f"out{k}.npy" for k in range(outputs)]
        subprocess.run(words + [str(path) for path in results], check=True)
        return [np.load(path) for path in results]
