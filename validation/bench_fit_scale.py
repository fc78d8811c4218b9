"""What do size and number cost: time and peak memory of `turnlight fit`.

    target/validation/venv/bin/python validation/bench_fit_scale.py [--quick] [--out FOLDER]
    target/validation/venv/bin/python validation/bench_fit_scale.py --suzanne FRAMES [--rival PROGRAM]

A sphere without texture coordinates, rendered by turnlight under the interior probe, fitted in texels. One
thing grows at a time: texels, frames, triangles, threads. Time is the command's wall time, with loading
and writing; memory its peak resident set.

Writes bench_fit_scale.json, .svg and .md to FOLDER (target/validation).

With --suzanne, one fit instead: Suzanne's triangles cut in four, 29,846 vertices, in FRAMES of 512² with a
sensor's noise, and the same by another build of turnlight.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from bench_scale import measured, write_mesh
from check_images import ROOT, TURNLIGHT, derive_scene, turnlight
from log_plots import page, panel

CAMERA = {"fov_x_deg": 32.0, "position": [0.0, 1.37, 3.76], "look_at": [0.0, 0.0, 0.0]}
PROBE = ROOT / "scenes" / "probes" / "interior.exr"
# What grows, from the first entry of each: texels along a side, frames, triangles, threads.
GROWTH = {
    "texels": (32, 64, 128, 256),
    "frames": (9, 18, 36, 72),
    "triangles": (5_000, 20_000, 80_000, 320_000),
    "threads": (1, 2),
}
BASE = {"texels": 64, "frames": 18, "triangles": 20_000, "threads": os.cpu_count()}


def fit(capture, out, *options, program=TURNLIGHT):
    """Wall seconds and peak MiB of a fit, and what it says of its own time."""
    stats = out.with_suffix(".json")
    words = [program, "--quiet", "--stats", stats, "fit", capture, "--out", out, *options]
    seconds, mebibytes = measured(words)
    return seconds, mebibytes, json.loads(stats.read_text())["timings"]


def growth(quick):
    """Rows of a sphere without texture coordinates, rendered by turnlight at 128²."""
    rows = []
    for what, steps in GROWTH.items():
        for step in steps[:2] if quick else steps:
            plan = {**BASE, what: step}
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary)
                write_mesh(folder / "mesh.ply", plan["triangles"], bumps=0.0)
                scene = derive_scene(
                    "sphere-plastic",
                    folder / "scene.toml",
                    object={"mesh": "mesh.ply"},
                    material={"ndf": "beckmann", "alpha": 0.2, "rho_d": [0.4, 0.3, 0.2], "rho_s": 1.0},
                    probe={"image": str(PROBE)},
                    camera={"width": 128, "height": 128, **CAMERA},
                    turntable={"frames": plan["frames"]},
                )
                capture = folder / "capture"
                turnlight("render", scene, "--spp", 16, "--max-depth", 2, "--out", capture)
                words = ("--points", f"texels={plan['texels']}", "--ndf", "beckmann")
                seconds, mebibytes, timings = fit(
                    capture, folder / "fit", *words, "--threads", plan["threads"]
                )
                with np.load(folder / "fit" / "points.npz") as points:
                    count, seen = len(points["frames"]), int((points["frames"] > 0).sum())
            row = {"grows": what, **plan, "points": count, "seen": seen, "seconds": seconds}
            rows.append(row | {"mebibytes": mebibytes, "timings": timings})
            told = ", ".join(f"{key} {value:.2f}" for key, value in timings.items())
            print(f"{what:10} {step:7}: {count:7} points, {seconds:6.2f} s ({told}), {mebibytes:.0f} MiB", flush=True)
    return rows


def suzanne(frames, programs):
    """Prints what the fit of the divided Suzanne takes of each program."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        coarse = trimesh.load(ROOT / "scenes" / "meshes" / "suzanne.ply", process=False)
        attributes = {"normal": np.array(coarse.vertex_normals)}
        vertices, faces, attributes = trimesh.remesh.subdivide(
            coarse.vertices, coarse.faces, vertex_attributes=attributes
        )[:3]
        normals = attributes["normal"] / np.linalg.norm(attributes["normal"], axis=1, keepdims=True)
        fine = trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False)
        fine.export(folder / "mesh.ply", vertex_normal=True)
        scene = derive_scene(
            "suzanne-plastic",
            folder / "scene.toml",
            object={"mesh": "mesh.ply"},
            camera={"width": 512, "height": 512, "fov_x_deg": 40.0},
            turntable={"frames": frames},
            sensor={"full_well_electrons": 30000.0, "read_noise_electrons": 5.0, "bits": 14, "exposure": 1.0},
        )
        capture = folder / "capture"
        turnlight("render", scene, "--spp", 64, "--max-depth", 4, "--out", capture)
        for number, program in enumerate(programs):
            seconds, mebibytes, timings = fit(capture, folder / str(number), program=program)
            parts = ", ".join(f"{key} {value:.1f}" for key, value in timings.items())
            print(f"{program}: {len(vertices)} vertices, {frames} frames of 512²: {seconds:.1f} s ({parts}), {mebibytes:.0f} MiB")


def table(rows):
    lines = ["| what grows | points | seconds: all / load / traces / fit | MiB |", "|---|---|---|---|"]
    for row in rows:
        parts = " / ".join(f"{row['timings'][key]:.2f}" for key in ("load", "traces", "fit"))
        lines.append(
            f"| {row[row['grows']]} {row['grows']} | {row['points']} | {row['seconds']:.2f} / {parts} | {row['mebibytes']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def plot(rows):
    wide, high = 250, 210
    parts = []
    for j, what in enumerate(GROWTH):
        chosen = [row for row in rows if row["grows"] == what]
        across = "points" if what == "texels" else what
        lines = [
            ("#c33", True, [(row[across], row["seconds"]) for row in chosen]),
            ("#26c", True, [(row[across], max(row["timings"]["fit"], 1e-3)) for row in chosen]),
        ]
        parts += panel(wide * j, 20, wide, high, f"over {across}", lines)
    heading = "turnlight fit, seconds: <tspan fill='#c33'>the command</tspan>, <tspan fill='#26c'>the estimation</tspan>"
    return page(wide * len(GROWTH), 20 + high, heading, parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the first two steps of each")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "validation", metavar="FOLDER")
    parser.add_argument("--suzanne", type=int, metavar="FRAMES", help="one fit of Suzanne instead")
    parser.add_argument("--rival", type=Path, action="append", default=[], metavar="PROGRAM", help="and by this build")
    options = parser.parse_args()
    if options.suzanne:
        suzanne(options.suzanne, [TURNLIGHT, *options.rival])
        return
    options.out.mkdir(parents=True, exist_ok=True)
    rows = growth(options.quick)
    machine = {"cores": os.cpu_count()}
    (options.out / "bench_fit_scale.json").write_text(json.dumps({**machine, "rows": rows}, indent=1) + "\n")
    (options.out / "bench_fit_scale.svg").write_text(plot(rows))
    (options.out / "bench_fit_scale.md").write_text(table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
