"""What is left of the fit's error when the images have hardly any noise?

    target/validation/venv/bin/python validation/check_converged.py [--quick] [--json FILE] [--only TEXT]

turnlight's path tracer renders a turntable sequence with so many paths that noise is small, and
`turnlight fit` is given it. The two share the BRDF, but neither the light's sums nor visibility nor
pixels: what is found is the error of the forward model. The sphere is open everywhere; Suzanne and the
cup shade and light themselves, and may have twice the sphere's error.

A row has the medians over the points that enough frames see, and the noise of the images as the fit
found it. With --json it goes on where an interrupted run stopped.
"""

import argparse
import hashlib
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from check_images import ROOT, TURNLIGHT, derive_scene, turnlight

PROBES = ("interior", "courtyard", "studio", "city")
TRUTH = {"rho_d": [0.4, 0.3, 0.2], "rho_s": 2.35, "eta": 1.3}
# Largest medians on an open surface; twice as much where a surface sees itself.
BARS = {"ln_alpha": 0.01, "rho_d": 0.005, "rho_s": 0.02}
SEEN = 6  # frames that must see a point
FULL = {"frames": 24, "size": 128, "spp": {"sphere-plastic": 8192, "suzanne-plastic": 4096, "cup": 4096}}
QUICK = {"frames": 24, "size": 48, "spp": {"sphere-plastic": 2048, "suzanne-plastic": 512, "cup": 512}}
FULL_CASES = [
    {"scene": "sphere-plastic", "probe": probe, "alpha": alpha, "ndf": ndf}
    for probe in PROBES
    for alpha in (0.05, 0.1, 0.2, 0.35, 0.5)
    for ndf in ("ggx", "beckmann")
] + [
    {"scene": scene, "probe": probe, "alpha": alpha, "ndf": "ggx"}
    for scene in ("suzanne-plastic", "cup")
    for probe in ("interior", "courtyard")
    for alpha in (0.1, 0.3)
]
QUICK_CASES = [{"scene": "sphere-plastic", "probe": "interior", "alpha": 0.2, "ndf": "ggx"}]


def name_of(case):
    return f"{case['scene']} {case['probe']} {case['ndf']} alpha {case['alpha']}"


def check_case(case, plan, folder):
    start = time.perf_counter()
    scene = derive_scene(
        case["scene"],
        folder / "scene.toml",
        material={"alpha": case["alpha"], "ndf": case["ndf"], **TRUTH},
        camera={"width": plan["size"], "height": plan["size"]},
        turntable={"frames": plan["frames"]},
        probe={"image": str(ROOT / "scenes" / "probes" / f"{case['probe']}.exr")},
    )
    capture, fit = folder / "capture", folder / "fit"
    # Light arrives at a sphere from outside only; elsewhere in all orders that the fit counts.
    depth = 2 if case["scene"] == "sphere-plastic" else 8
    turnlight("render", scene, "--spp", plan["spp"][case["scene"]], "--max-depth", depth, "--out", capture)
    turnlight("fit", capture, "--out", fit)
    with np.load(fit / "points.npz") as file:
        points = {name: file[name] for name in file.files}
    used = points["frames"] >= SEEN
    converged = used & (points["status"] == 0)
    ln_alpha = np.log(points["alpha"][converged].astype(float) / case["alpha"])
    rho_d = points["rho_d"][used] / np.array(TRUTH["rho_d"]) - 1
    rho_s = points["rho_s"][converged, 0] / TRUTH["rho_s"] - 1
    row = {
        "points": int(used.sum()),
        "converged": float(converged.sum() / max(used.sum(), 1)),
        "ln_alpha": float(np.median(np.abs(ln_alpha))),
        "ln_alpha_bias": float(np.median(ln_alpha)),
        "rho_d": float(np.nanmedian(np.abs(rho_d))),
        "rho_s": float(np.median(np.abs(rho_s))),
        "right_ndf": float(np.mean(points["ndf"][converged] == (case["ndf"] == "ggx"))),
        "residual": float(np.median(points["residual"][converged])),
        "sigma_ln_alpha": float(np.median((points["sigma_alpha"] / points["alpha"])[converged])),
        "seconds": time.perf_counter() - start,
    }
    factor = 1 if case["scene"] == "sphere-plastic" else 2
    row["missed"] = [name for name, bar in BARS.items() if not row[name] <= factor * bar]
    return row


def print_row(name, row):
    print(
        f"{name:46} {row['points']:5} points, {row['converged']:4.0%} converged; median error of alpha"
        f" {row['ln_alpha']:.2%} (bias {row['ln_alpha_bias']:+.2%}, sigma {row['sigma_ln_alpha']:.2%}), rho_d"
        f" {row['rho_d']:.2%}, rho_s {row['rho_s']:.2%}; lobe right {row['right_ndf']:.0%}; residual"
        f" {row['residual']:.2%}; {row['seconds']:.0f} s{'  FAIL: ' if row['missed'] else ''}"
        f"{', '.join(row['missed'])}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one small case")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the table as JSON, and go on from it")
    parser.add_argument("--only", metavar="TEXT", default="", help="only cases whose name contains this")
    options = parser.parse_args()

    plan, cases = (QUICK, QUICK_CASES) if options.quick else (FULL, FULL_CASES)
    # A row is taken from the file only if it is of this program and plan.
    program = hashlib.sha256(TURNLIGHT.read_bytes() + repr(plan).encode()).hexdigest()
    table = {"program": program, "plan": plan, "bars": BARS, "cases": {}}
    if options.json and options.json.exists():
        kept = json.loads(options.json.read_text())
        if kept.get("program") == program:
            table = kept
    for case in cases:
        name = name_of(case)
        if options.only not in name:
            continue
        if name not in table["cases"]:
            with tempfile.TemporaryDirectory() as folder:
                table["cases"][name] = check_case(case, plan, Path(folder))
            if options.json:
                partial = options.json.with_suffix(f".{os.getpid()}.partial")
                partial.write_text(json.dumps(table, indent=1))
                partial.rename(options.json)
        print_row(name, table["cases"][name])
    chosen = [row for name, row in table["cases"].items() if options.only in name]
    failed = sum(bool(row["missed"]) for row in chosen)
    print(f"{len(chosen) - failed} cases passed, {failed} failed")
    return 1 if failed or not chosen else 0


if __name__ == "__main__":
    raise SystemExit(main())
