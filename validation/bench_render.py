"""How long do turnlight and Mitsuba 3 take to the same error?

    target/validation/venv/bin/python validation/bench_render.py [--size N] [--only TEXT] [--out FOLDER]

Every case is a shipped scene (and the flight helmet, where the shared data are) with another
roughness, rendered direct only (depth 2) and with interreflection (depth 4), as one frame and as a
turntable of 36. Both renderers run on all cores of this machine, one after the other in this
process:

* turnlight: wall time of the command, with loading, building and writing; 1 frame and 36 frames.
* Mitsuba `llvm_ad_rgb`, with the sampler of the two, multijitter and ldsampler, that does better in
  the case: wall time of `mi.render` with the scene loaded
  and its kernels compiled and warmed up; compilation is counted apart. 36 frames are taken to
  cost 36 times one.

The error is relMSE = mean over object pixels of (image - truth)^2 / (truth^2 + (0.1 mean)^2). The
truth is Mitsuba's, from two independent references A and B: the mean of (image - A)(image - B) is
free of the references' own noise. Of Mitsuba's 64 and 256 samples a pixel each gives an error; the
table says how many times less time turnlight takes to it, by its own curve, log-log.

Writes bench_render.json, bench_render.svg and bench_render.md to FOLDER (target/validation).
"""

import argparse
import json
import os
import platform
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import check_images
import exr_files
from mitsuba_env import load_scene, mi, render

ROOT = Path(__file__).resolve().parent.parent
HELMET = ROOT.parent / "shared" / "data" / "meshes" / "flighthelmet" / "FlightHelmet.gltf"
FRAMES = 36
SCENES = ("sphere-plastic", "suzanne-plastic", "cup", "helmet")
ALPHAS = (0.05, 0.2, 0.5)
DEPTHS = (2, 4)
PEER_SPP = (16, 64, 256)
OWN_SPP = (1, 4, 16, 64)
REFERENCE = (4, 512)  # seeds of each reference and their samples a pixel
REPEATS = 2


def relative_mse(image, a, b):
    """Of one image, from two independent references; see above."""
    truth = 0.5 * (a + b)
    lit = truth.sum(axis=2) > 1e-4
    floor = 0.1 * truth[lit].mean()
    products = (image - a) * (image - b) / (truth**2 + floor**2)
    return float(products[lit].mean())


def timed(action):
    start = time.perf_counter()
    result = action()
    return time.perf_counter() - start, result


def turnlight(scene, spp, depth, seed, frames, out):
    words = [check_images.TURNLIGHT, "--quiet", "render", scene, "--spp", spp, "--max-depth", depth]
    words += ["--seed", seed, "--frames", f"0..{frames}", "--out", out]
    seconds, _ = timed(lambda: subprocess.run([str(w) for w in words], check=True))
    return seconds, exr_files.read_exr(out / "images" / "0000.exr").astype(np.float64)


def own_curve(scene, depth, truth, smallest, folder):
    """(spp, seconds of one frame, seconds of all frames, relMSE) until the error is below `smallest`."""
    points = []
    for spp in OWN_SPP:
        single, errors = [], []
        for seed in range(REPEATS):
            seconds, image = turnlight(scene, spp, depth, seed, 1, folder / f"one-{spp}-{seed}")
            single.append(seconds)
            errors.append(relative_mse(image, *truth))
        every, _ = turnlight(scene, spp, depth, 0, FRAMES, folder / f"all-{spp}")
        points.append((spp, min(single), every, float(np.mean(errors))))
        if points[-1][3] < smallest:
            break
    return points


def peer_curve(xml, depth, truth, sampler):
    """(spp, seconds of one frame, relMSE), and the seconds that compiling took."""
    points = []
    compiling = 0.0
    for spp in PEER_SPP:
        scene = load_scene(xml, 0.0, spp, depth, sampler)
        first, _ = timed(lambda: render(scene, 1))
        runs = [timed(lambda seed=seed: render(scene, seed)) for seed in range(2, 2 + REPEATS)]
        seconds = min(t for t, _ in runs)
        compiling = max(compiling, first - seconds)
        points.append((spp, seconds, float(np.mean([relative_mse(x, *truth) for _, x in runs]))))
    return points, compiling


def seconds_to(error, curve):
    """Time of a curve of (seconds, error), log-log between its points, 1/time beyond its ends."""
    log_error = np.log([e for _, e in curve])
    log_time = np.log([t for t, _ in curve])
    wanted = np.log(error)
    order = np.argsort(log_error)
    inside = np.interp(wanted, log_error[order], log_time[order])
    if wanted < log_error.min():
        inside += log_error.min() - wanted
    return float(np.exp(inside))


def bench_case(name, alpha, depth, size, folder):
    material = {"alpha": alpha, "ndf": "ggx", "rho_s": 2.35}
    changes = {"material": material, "camera": {**check_images.CAMERA, "width": size, "height": size}}
    changes["turntable"] = {"frames": FRAMES}
    source = "suzanne-plastic" if name == "helmet" else name
    if name == "helmet":
        changes["object"] = {"mesh": str(HELMET), "scale": 2.9, "translation": [0.0, -0.95, 0.0]}
    scene = check_images.derive_scene(source, folder / "scene.toml", **changes)
    check_images.turnlight("export", "mitsuba", scene, "--out", folder / "mitsuba")
    xml = folder / "mitsuba" / "scene.xml"

    seeds, spp = REFERENCE
    reference = load_scene(xml, 0.0, spp, depth)
    truth = [
        np.mean([render(reference, 1000 + seeds * half + k) for k in range(seeds)], axis=0) for half in (0, 1)
    ]
    peers = {sampler: peer_curve(xml, depth, truth, sampler) for sampler in ("multijitter", "ldsampler")}
    sampler = min(peers, key=lambda s: peers[s][0][-1][1] * peers[s][0][-1][2])
    peer, compiling = peers[sampler]
    own = own_curve(scene, depth, truth, peer[-1][2], folder)

    row = {"scene": name, "alpha": alpha, "depth": depth, "size": size, "sampler": sampler}
    row.update(compiling=compiling, peer=peer, own=own)
    for which, (samples, seconds, error) in (("64", peer[1]), ("256", peer[2])):
        row[f"single_{which}"] = seconds / seconds_to(error, [(t, e) for _, t, _, e in own])
        row[f"turntable_{which}"] = FRAMES * seconds / seconds_to(error, [(t, e) for _, _, t, e in own])
    return row


def geometric_mean(values):
    return float(np.exp(np.mean(np.log(values)))) if values else float("nan")


def table(rows):
    lines = ["| scene | alpha | depth | 1 frame, to the error at 64 / 256 spp | 36 frames |", "|---|---|---|---|---|"]
    cell = lambda row, kind: f"{row[f'{kind}_64']:.1f} / {row[f'{kind}_256']:.1f}"  # noqa: E731
    for row in rows:
        lines.append(
            f"| {row['scene']} | {row['alpha']} | {row['depth']} | {cell(row, 'single')} | {cell(row, 'turntable')} |"
        )
    for depth in DEPTHS:
        chosen = [row for row in rows if row["depth"] == depth]
        means = {
            f"{kind}_{spp}": geometric_mean([row[f"{kind}_{spp}"] for row in chosen])
            for kind in ("single", "turntable")
            for spp in (64, 256)
        }
        lines.append(
            f"| geometric mean | | {depth} | {cell(means, 'single')} | {cell(means, 'turntable')} |"
        )
    return "\n".join(lines) + "\n"


def plot(rows):
    """One small log-log plot a case: seconds of 36 frames against relMSE."""
    wide, high, columns = 230, 190, 6
    count = max(len(rows), 1)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide * min(columns, count)}" '
        f'height="{high * -(-count // columns) + 24}" font-family="sans-serif" font-size="10">',
        '<rect width="100%" height="100%" fill="white"/>',
        '<text x="8" y="14">relMSE over seconds of 36 frames, both logarithmic: '
        '<tspan fill="#c33">turnlight</tspan>, <tspan fill="#26c">Mitsuba 3</tspan></text>',
    ]
    for number, row in enumerate(rows):
        left, top = wide * (number % columns), high * (number // columns) + 24
        lines = {
            "#c33": [(t, e) for _, _, t, e in row["own"]],
            "#26c": [(FRAMES * t, e) for _, t, e in row["peer"]],
        }
        points = [(np.log10(t), np.log10(max(e, 1e-9))) for line in lines.values() for t, e in line]
        low, top_value = np.floor(np.min(points, axis=0)), np.ceil(np.max(points, axis=0))
        span = np.maximum(top_value - low, 1)

        def place(seconds, error, left=left, top=top, low=low, span=span):
            x, y = (np.log10([seconds, max(error, 1e-9)]) - low) / span
            return left + 40 + x * (wide - 60), top + 20 + (1 - y) * (high - 60)

        title = f"{row['scene']}, alpha {row['alpha']}, depth {row['depth']}"
        parts.append(f'<text x="{left + 40}" y="{top + 12}">{title}</text>')
        parts.append(
            f'<rect x="{left + 40}" y="{top + 20}" width="{wide - 60}" height="{high - 60}" '
            'fill="none" stroke="#999"/>'
        )
        for decade in range(int(span[0]) + 1):
            x, _ = place(10 ** (low[0] + decade), 10 ** low[1])
            parts.append(f'<text x="{x:.0f}" y="{top + high - 28}" text-anchor="middle">1e{low[0] + decade:.0f}</text>')
        for decade in range(int(span[1]) + 1):
            _, y = place(10 ** low[0], 10 ** (low[1] + decade))
            parts.append(f'<text x="{left + 36}" y="{y + 3:.0f}" text-anchor="end">1e{low[1] + decade:.0f}</text>')
        for colour, line in lines.items():
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*p) for p in line))
            parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
    return "\n".join(parts) + "\n</svg>\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=256, help="pixels along either side")
    parser.add_argument("--only", metavar="TEXT", default="", help="only cases whose name contains this")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "validation", metavar="FOLDER")
    options = parser.parse_args()

    rows = []
    for name in SCENES:
        if name == "helmet" and not HELMET.exists():
            print(f"{HELMET}: absent, the helmet is left out")
            continue
        for depth in DEPTHS:
            for alpha in ALPHAS:
                if options.only not in f"{name} alpha {alpha} depth {depth}":
                    continue
                with tempfile.TemporaryDirectory() as folder:
                    row = bench_case(name, alpha, depth, options.size, Path(folder))
                rows.append(row)
                print(
                    f"{name:16} alpha {alpha:4} depth {depth}: 1 frame {row['single_64']:6.1f} {row['single_256']:6.1f}"
                    f"   36 frames {row['turntable_64']:6.1f} {row['turntable_256']:6.1f}   ({row['sampler']})",
                    flush=True,
                )
                options.out.mkdir(parents=True, exist_ok=True)
                machine = {"cores": os.cpu_count(), "machine": platform.machine()}
                result = {"mitsuba": mi.__version__, "frames": FRAMES, **machine, "rows": rows}
                (options.out / "bench_render.json").write_text(json.dumps(result, indent=1) + "\n")
                (options.out / "bench_render.svg").write_text(plot(rows))
                (options.out / "bench_render.md").write_text(table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
