"""Does `turnlight render --target-error E` deliver the error that was asked for, without bias?

    target/validation/venv/bin/python validation/check_target_error.py [--quick] [--json FILE]

The truth is Mitsuba's, from two independent references A and B, so that its own noise drops out: the
squared error of an image is the mean over object pixels of (image - A)(image - B), relative to
truth^2 + (0.1 mean)^2, as turnlight defines it. Several seeds are rendered; a case passes if the
root of the mean of their squared errors is within 15 % of what was asked for, and the mean of all
images is Mitsuba's within four standard deviations of both. One seed alone scatters more, where
rare bright paths make the error; the table says how much.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import check_images
import exr_files
from bench_render import HELMET, relative_mse
from mitsuba_env import load_scene, mi, render

DELIVERED = 0.15  # from 1
SIGMAS = 4.0
FULL = {
    "scenes": ("sphere-plastic", "suzanne-plastic", "cup", "helmet"),
    "depths": (2, 4),
    "targets": (0.1, 0.03),
    "size": 128,
    "seeds": 12,
    "reference": (8, 512),  # seeds of each reference and their samples a pixel
}
QUICK = {
    "scenes": ("sphere-plastic", "cup"),
    "depths": (4,),
    "targets": (0.05,),
    "size": 64,
    "seeds": 24,
    "reference": (4, 1024),
}


def render_own(scene, target, depth, seed, folder):
    stats = folder / f"{seed}.json"
    words = [check_images.TURNLIGHT, "--quiet", "render", scene, "--target-error", target]
    words += ["--max-depth", depth, "--seed", seed, "--frames", "0..1", "--stats", stats]
    words += ["--out", folder / f"{target}-{seed}"]
    subprocess.run([str(word) for word in words], check=True)
    image = exr_files.read_exr(folder / f"{target}-{seed}" / "images" / "0000.exr").astype(np.float64)
    return image, json.loads(stats.read_text())["render"]


def make_scene(name, size, folder):
    changes = {
        "material": {"alpha": 0.2, "ndf": "ggx", "rho_s": 2.35},
        "camera": {**check_images.CAMERA, "width": size, "height": size},
        "turntable": {"angles_deg": [0.0]},
    }
    if name == "helmet":
        changes["object"] = {"mesh": str(HELMET), "scale": 2.9, "translation": [0.0, -0.95, 0.0]}
        name = "suzanne-plastic"
    scene = check_images.derive_scene(name, folder / "scene.toml", **changes)
    check_images.turnlight("export", "mitsuba", scene, "--out", folder / "mitsuba")
    return scene


def check_case(scene, target, depth, seeds, references, folder):
    start = time.perf_counter()
    runs = [render_own(scene, target, depth, seed, folder) for seed in range(seeds)]
    truth = [np.mean(half, axis=0) for half in references]
    errors = np.sqrt([relative_mse(image, *truth) for image, _ in runs]) / target
    delivered = float(np.sqrt(np.mean(errors**2)))
    own = np.array([image.mean() for image, _ in runs])
    peer = np.array([image.mean() for half in references for image in half])
    sigma = np.sqrt(own.var(ddof=1) / len(own) + peer.var(ddof=1) / len(peer))
    z = float((own.mean() - peer.mean()) / sigma)
    return {
        "delivered": delivered,
        "scatter": float(errors.std(ddof=1)),
        "ratio": float(own.mean() / peer.mean()),
        "ratio_error": float(sigma / peer.mean()),
        "z": z,
        "paths": float(np.mean([stats["paths"] for _, stats in runs])),
        "pilot_share": float(np.mean([stats["pilot_paths"] / stats["paths"] for _, stats in runs])),
        "seconds": time.perf_counter() - start,
        "passed": bool(abs(delivered - 1) <= DELIVERED and abs(z) <= SIGMAS),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two small cases")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the table as JSON")
    options = parser.parse_args()

    plan = QUICK if options.quick else FULL
    table = {"mitsuba": mi.__version__, "cases": {}}
    seeds, spp = plan["reference"]
    print(f"{'case':44}{'delivered / asked':>18}{'scatter':>9}{'ratio - 1':>11}{'z':>6}{'pilots':>8}{'s':>7}")
    for name in plan["scenes"]:
        if name == "helmet" and not HELMET.exists():
            print(f"{HELMET}: absent, the helmet is left out")
            continue
        for depth in plan["depths"]:
            with tempfile.TemporaryDirectory() as folder:
                folder = Path(folder)
                scene = make_scene(name, plan["size"], folder)
                peer = load_scene(folder / "mitsuba" / "scene.xml", 0.0, spp, depth)
                references = [
                    [render(peer, 1000 + seeds * half + k) for k in range(seeds)] for half in (0, 1)
                ]
                for target in plan["targets"]:
                    row = check_case(scene, target, depth, plan["seeds"], references, folder)
                    case = f"{name} depth {depth} {plan['size']}² target {target}"
                    table["cases"][case] = row
                    print(
                        f"{case:44}{row['delivered']:18.2f}{row['scatter']:9.2f}{row['ratio'] - 1:+11.2%}"
                        f"{row['z']:+6.1f}{row['pilot_share']:8.0%}{row['seconds']:7.1f}"
                        f"{'' if row['passed'] else '  FAIL'}",
                        flush=True,
                    )
                    if options.json:
                        options.json.write_text(json.dumps(table, indent=1) + "\n")
    failed = sum(not row["passed"] for row in table["cases"].values())
    print(f"Mitsuba {mi.__version__}; {len(table['cases']) - failed} cases passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
