"""What knowing the light is worth: the same capture by `full`, `gradient` and `unknown-light`.

    target/validation/venv/bin/python validation/check_unknown_light.py [--size N] [--frames N] [--json FILE]

turnlight renders scenes/sphere-plastic and suzanne-plastic with sensor noise of about 1 %; each is fitted
three times. Errors are medians over the points that at least eight frames see and that came out with a
lobe; albedos of `unknown-light` are also given after the one factor that nothing tells. The only bars: all
three give finite numbers, and `full` is the best of them.
"""

import argparse
import json
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np

from check_images import derive_scene, turnlight

SCENES = ("sphere-plastic", "suzanne-plastic")
TRUTH = {"ndf": "ggx", "alpha": 0.2, "rho_d": [0.4, 0.3, 0.2], "rho_s": 2.35, "eta": 1.3}
SENSOR = {"full_well_electrons": 30000.0, "read_noise_electrons": 5.0, "bits": 14, "exposure": 1.0}
ESTIMATORS = ("full", "gradient", "unknown-light")
SEEN = 8


def figures(fit):
    with np.load(fit / "points.npz") as points:
        points = {name: points[name].astype(np.float64) for name in points.files}
    record = tomllib.loads((fit / "fit.toml").read_text())
    kept = (points["frames"] >= SEEN) & (points["status"] == 0)
    seen = int((points["frames"] >= SEEN).sum())
    alpha = np.log(points["alpha"][kept] / TRUTH["alpha"])
    rho_d = points["rho_d"][kept] / np.array(TRUTH["rho_d"])
    rho_s = points["rho_s"][kept, 1] / TRUTH["rho_s"]
    scale = np.median(rho_d)
    row = {
        "points": int(kept.sum()),
        "seen": seen,
        "seconds": record["timings"]["fit"],
        "alpha": float(np.median(np.abs(alpha))),
        "alpha_bias": float(np.median(alpha)),
        "rho_d": float(np.median(np.abs(rho_d - 1))),
        "rho_s": float(np.median(np.abs(rho_s - 1))),
        "rho_d_scaled": float(np.median(np.abs(rho_d / scale - 1))),
        "rho_s_scaled": float(np.median(np.abs(rho_s / scale - 1))),
    }
    return row | {key: record["light"][key] for key in ("rounds", "change") if "light" in record}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=128, metavar="N", help="pixels across")
    parser.add_argument("--frames", type=int, default=36, metavar="N")
    parser.add_argument("--spp", type=int, default=256, metavar="N")
    parser.add_argument("--only", metavar="TEXT", help="only the scenes whose name has this in it")
    parser.add_argument("--json", metavar="FILE", help="write the table as JSON")
    options = parser.parse_args()
    start = time.perf_counter()
    rows, failed = [], 0
    for name in SCENES:
        if options.only and options.only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            scene = derive_scene(
                name,
                folder / "scene.toml",
                material=TRUTH,
                sensor=SENSOR,
                camera={"width": options.size, "height": options.size},
                turntable={"frames": options.frames},
            )
            capture = folder / "capture"
            turnlight("render", scene, "--spp", options.spp, "--out", capture)
            found = {}
            for estimator in ESTIMATORS:
                fit = folder / estimator
                turnlight("fit", capture, "--estimator", estimator, "--out", fit)
                found[estimator] = figures(fit)
        for estimator, row in found.items():
            ratio = row["seconds"] / found["gradient"]["seconds"]
            rounds = f", {row['rounds']} turns, last change {row['change']:.1%}" if "rounds" in row else ""
            print(
                f"{name}, {estimator}: {row['points']} of {row['seen']} points; ln alpha {row['alpha']:.3f}"
                f" (bias {row['alpha_bias']:+.3f}), rho_d {row['rho_d']:.1%}, rho_s {row['rho_s']:.1%};"
                f" scaled {row['rho_d_scaled']:.1%}, {row['rho_s_scaled']:.1%};"
                f" {row['seconds']:.1f} s, {ratio:.1f} times gradient's{rounds}",
                flush=True,
            )
        errors = [found[estimator]["alpha"] for estimator in ESTIMATORS]
        passed = all(np.isfinite(errors)) and errors[0] == min(errors)
        failed += not passed
        print(f"{name}: {'PASS' if passed else 'FAIL'}", flush=True)
        rows.append({"name": name, **found})
    print(f"{failed} of {len(rows)} scenes failed; {time.perf_counter() - start:.0f} s")
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=1))
    return 1 if failed or not rows else 0


if __name__ == "__main__":
    raise SystemExit(main())
