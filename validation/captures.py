"""Scenes for the checks: derived from the shipped ones, rendered by turnlight and by Mitsuba."""

import subprocess
import tomllib
from pathlib import Path

import numpy as np

from exr_files import read_exr
from mitsuba_env import load_scene, render

ROOT = Path(__file__).resolve().parent.parent
TURNLIGHT = ROOT / "target" / "release" / "turnlight"


def turnlight(*words):
    """Runs the release build of turnlight; its standard output."""
    command = [str(TURNLIGHT), "--quiet", *(str(w) for w in words)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def toml_value(value):
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return repr(value)


def derive(scene, folder, **changes):
    """Writes folder/scene.toml: a shipped scene with `section__key=value` changes; None removes."""
    source = ROOT / "scenes" / scene / "scene.toml"
    tables = tomllib.loads(source.read_text())
    for section, key in [("object", "mesh"), ("probe", "image")]:
        tables[section][key] = str((source.parent / tables[section][key]).resolve())
    for name, value in changes.items():
        section, key = name.split("__")
        table = tables.setdefault(section, {})
        if value is None:
            table.pop(key, None)
        else:
            table[key] = value
    lines = []
    for section, table in tables.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {toml_value(value)}" for key, value in table.items()]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scene.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def by_turnlight(scene_toml, folder, spp, max_depth, seed, frame=0):
    """One frame as turnlight renders it, float64 [height, width, 3]."""
    turnlight("render", scene_toml, "--out", folder, "--spp", spp, "--max-depth", max_depth,
              "--seed", seed, "--frames", f"{frame}..{frame + 1}")
    return read_exr(folder / "images" / f"{frame:04d}.exr").astype(np.float64)


def by_mitsuba(xml, angle_deg, spp, max_depth, seed):
    """One frame as Mitsuba renders turnlight's export."""
    return render(load_scene(xml, angle_deg=angle_deg, spp=spp, max_depth=max_depth), seed)
