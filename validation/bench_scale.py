"""What do size and number cost: time and peak memory of `turnlight render`.

    target/validation/venv/bin/python validation/bench_scale.py [--quick] [--out FOLDER]

A bumpy sphere under the city probe, GGX alpha 0.2, direct light and one interreflection, 4 paths a
pixel. One thing grows at a time: triangles to a million, the probe to 4096 x 2048, pixels to 2048²,
frames to 360. Time is the command's wall time, with loading and writing; memory its peak resident set.

Writes bench_scale.json, bench_scale.svg and a table.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import exr_files

ROOT = Path(__file__).resolve().parent.parent
TURNLIGHT = Path(os.environ.get("TURNLIGHT", ROOT / "target" / "release" / "turnlight"))

BASE = {"triangles": 20_000, "probe": 512, "pixels": 128, "frames": 4}
GROWTH = {
    "triangles": (20_000, 100_000, 400_000, 1_000_000),
    "probe": (512, 1024, 2048, 4096),
    "pixels": (128, 512, 1024, 2048),
    "frames": (4, 36, 360),
}
QUICK = {"triangles": (20_000, 100_000), "probe": (512, 1024), "pixels": (128, 256), "frames": (4, 12)}


def write_mesh(path, triangles, bumps=0.08):
    """A sphere with bumps, of about so many triangles: rows of quads, cut."""
    rows = max(int(np.sqrt(triangles / 4)), 4)
    columns = 2 * rows
    theta = np.linspace(1e-3, np.pi - 1e-3, rows + 1)[:, None]
    phi = np.arange(columns)[None, :] * (2 * np.pi / columns)
    radius = 1 + bumps * np.sin(9 * theta) * np.sin(11 * phi)
    points = np.stack(
        [radius * np.sin(theta) * np.sin(phi), radius * np.cos(theta) + 0 * phi, radius * np.sin(theta) * np.cos(phi)],
        axis=-1,
    ).astype("<f4")
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    faces = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)])
    packed = np.zeros(len(faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    packed["n"], packed["v"] = 3, faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {points.reshape(-1, 3).shape[0]}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + points.tobytes() + packed.tobytes())


def write_probe(path, width):
    """The city probe, its texels divided."""
    image = exr_files.read_exr(ROOT / "scenes" / "probes" / "city.exr")
    times = width / image.shape[1]
    rows, columns = ((np.arange(n) / times).astype(int) for n in (width // 2, width))
    exr_files.write_exr(path, image[rows][:, columns].astype(np.float32))


def run(plan, folder):
    """Seconds and MiB of one render."""
    write_mesh(folder / "mesh.ply", plan["triangles"])
    write_probe(folder / "probe.exr", plan["probe"])
    (folder / "scene.toml").write_text(
        "[object]\nmesh = 'mesh.ply'\n[material]\nndf = 'ggx'\nalpha = 0.2\nrho_d = [0.4, 0.3, 0.2]\n"
        "rho_s = 2.35\n[probe]\nimage = 'probe.exr'\n"
        f"[camera]\nwidth = {plan['pixels']}\nheight = {plan['pixels']}\nfov_x_deg = 35.0\n"
        "position = [0.0, 1.4, 3.7]\nlook_at = [0.0, 0.0, 0.0]\n"
        f"[turntable]\nframes = {plan['frames']}\n"
    )
    words = [TURNLIGHT, "--quiet", "render", folder / "scene.toml", "--spp", 4, "--max-depth", 3]
    return measured([*words, "--out", folder / "out"])


def measured(words):
    """Wall seconds and peak MiB of a command."""
    start = time.perf_counter()
    process = subprocess.Popen([str(word) for word in words])
    # Asked while it runs: what wait4 tells begins with this program's own memory.
    peak = 0
    while process.poll() is None:
        for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                peak = max(peak, int(line.split()[1]))
        time.sleep(0.005)
    seconds = time.perf_counter() - start
    if process.returncode != 0:
        raise RuntimeError(f"turnlight ended with {process.returncode}")
    return seconds, peak / 1024


def plot(rows):
    """Seconds and MiB over what grew, all logarithmic."""
    wide, high = 240, 200
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide * len(GROWTH)}" height="{high + 24}" '
        'font-family="sans-serif" font-size="10"><rect width="100%" height="100%" fill="white"/>',
        '<text x="8" y="14">turnlight render, logarithmic: <tspan fill="#c33">seconds</tspan>, '
        '<tspan fill="#26c">peak MiB</tspan></text>',
    ]
    for number, what in enumerate(GROWTH):
        chosen = [row for row in rows if row["grows"] == what]
        x = np.log10([row[what] for row in chosen])
        left, top = wide * number + 34, 34
        parts.append(f'<rect x="{left}" y="{top}" width="{wide - 50}" height="{high - 50}" fill="none" stroke="#999"/>')
        parts.append(f'<text x="{left}" y="{top + high - 34}">{what}: {chosen[0][what]} to {chosen[-1][what]}</text>')
        for key, colour in (("seconds", "#c33"), ("mebibytes", "#26c")):
            y = np.log10([row[key] for row in chosen]) + 1
            place = [
                (left + (a - x[0]) / max(x[-1] - x[0], 1e-9) * (wide - 50), top + (1 - b / 5) * (high - 50))
                for a, b in zip(x, y, strict=True)
            ]
            line = " ".join(f"{a:.1f},{b:.1f}" for a, b in place)
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
            for (a, b), row in zip(place, chosen, strict=True):
                parts.append(f'<text x="{a:.1f}" y="{b - 3:.1f}" fill="{colour}">{row[key]:.3g}</text>')
    return "\n".join(parts) + "\n</svg>\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="only small steps")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "validation", metavar="FOLDER")
    options = parser.parse_args()

    rows = []
    print(f"{'grows':12}{'triangles':>10}{'probe':>7}{'pixels':>8}{'frames':>8}{'seconds':>9}{'MiB':>8}")
    for what, steps in (QUICK if options.quick else GROWTH).items():
        for step in steps:
            plan = {**BASE, what: step}
            with tempfile.TemporaryDirectory() as folder:
                seconds, mebibytes = run(plan, Path(folder))
            rows.append({"grows": what, **plan, "seconds": seconds, "mebibytes": mebibytes})
            print(
                f"{what:12}{plan['triangles']:10}{plan['probe']:7}{plan['pixels']:7}²{plan['frames']:8}"
                f"{seconds:9.2f}{mebibytes:8.0f}",
                flush=True,
            )
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "bench_scale.json").write_text(json.dumps({"cores": os.cpu_count(), "rows": rows}, indent=1) + "\n")
    (options.out / "bench_scale.svg").write_text(plot(rows))


if __name__ == "__main__":
    main()
