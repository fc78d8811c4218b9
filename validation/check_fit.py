"""Does a fit recover the material from images that turnlight did not render itself?

    target/validation/venv/bin/python validation/check_fit.py [--quick] [--json FILE] [--cache DIR]

Mitsuba 3 renders a turntable sequence of scenes/suzanne-plastic, interreflections included, and
`turnlight fit` is given it as a capture; only the masks are turnlight's. Then:

* the points of the estimate are compared with the truth, over the points that enough frames see,
  whatever their status (those without an estimate of a parameter are counted, not compared);
* at alpha 0.2, `turnlight reproduce` renders the estimate in the capture's light, and in another,
  which is compared with Mitsuba's render of the truth in that light.

Bars are for `--estimator full` at alpha 0.2; other roughnesses and the paper's `gradient` are shown.
Mitsuba's images are kept in the cache, by their scene's content.
"""

import argparse
import hashlib
import json
import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

import mitsuba_env
from check_images import ROOT, derive_scene, turnlight
from exr_files import write_exr

NAME = "suzanne-plastic"
TRUTH = {"ndf": "ggx", "rho_d": [0.4, 0.3, 0.2], "rho_s": 2.35, "eta": 1.3}
OTHER_PROBE = ROOT / "scenes" / "probes" / "courtyard.exr"
DEPTH = 6  # Mitsuba's
MASK_SPP = 16  # a mask's pixel is 255 if all its samples hit
STATUS = ("converged", "unidentifiable", "alpha_at_bound", "too_few_samples", "unseen", "saturated")

FULL = {
    "alphas": (0.05, 0.2, 0.35),
    "frames": 36,
    "size": 256,
    "spp": 1024,
    "seen": 8,
    "other_frames": 12,
    "reproduce_spp": 1024,
}
QUICK = {
    "alphas": (0.2,),
    "frames": 18,
    "size": 128,
    "spp": 256,
    "seen": 8,
    "other_frames": 6,
    "reproduce_spp": 64,
}
# Upper bounds; those of PSNR (dB) are lower bounds.
BARS_FULL = {
    "alpha_error": 0.06,
    "alpha_bias": 0.02,
    "rho_d_error": 0.01,
    "rho_s_error": 0.06,
    "psnr": 40.0,
    "other_psnr": 36.0,
}
# A quarter of the pixels a vertex, half the frames and twice the noise of the full run. Measured:
# alpha 0.051, bias +0.003, rho_d 0.008, rho_s 0.055; 30.9 and 32.4 dB, of which the noise of 64 paths
# in the reproduction and 256 in the observation is most.
BARS_QUICK = {
    "alpha_error": 0.08,
    "alpha_bias": 0.03,
    "rho_d_error": 0.012,
    "rho_s_error": 0.09,
    "psnr": 29.5,
    "other_psnr": 30.5,
}
BARRED_ALPHA = 0.2


def peer_images(scene, angles, spp, depth, cache, edit=None):
    """Mitsuba's renders, by frame: paths of EXR files in the cache.

    `edit` may change what Mitsuba is given, the XML text of the exported scene.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        turnlight("export", "mitsuba", scene, "--out", folder)
        if edit:
            xml = folder / "scene.xml"
            xml.write_text(edit(xml.read_text()))
        digest = hashlib.sha256(repr((list(angles), spp, depth, mitsuba_env.mi.__version__)).encode())
        for file in sorted(folder.iterdir()):
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
        store = cache / digest.hexdigest()[:16]
        store.mkdir(parents=True, exist_ok=True)
        paths = [store / f"{frame:04}.exr" for frame in range(len(angles))]
        for frame, (angle, path) in enumerate(zip(angles, paths)):
            if path.exists():
                continue
            peer = mitsuba_env.load_scene(folder / "scene.xml", angle, spp, depth)
            partial = path.with_suffix(f".{os.getpid()}.partial.exr")
            write_exr(partial, mitsuba_env.render(peer, seed=frame))
            partial.rename(path)  # complete or not there
    return paths


def make_capture(alpha, plan, frames, folder, cache, probe=None):
    """A capture folder with Mitsuba's images and turnlight's masks."""
    changes = {"probe": {"image": str(probe)}} if probe else {}
    folder.mkdir()
    scene = derive_scene(
        NAME,
        folder / "scene.toml",
        material={"alpha": alpha, **TRUTH},
        camera={"width": plan["size"], "height": plan["size"]},
        turntable={"frames": frames},
        **changes,
    )
    angles = [360.0 * frame / frames for frame in range(frames)]
    images = peer_images(scene, angles, plan["spp"], DEPTH, cache)
    capture = folder / "capture"
    turnlight("render", scene, "--spp", MASK_SPP, "--max-depth", 2, "--out", capture)
    # The truth stays out of what the fit is given.
    shutil.rmtree(capture / "truth")
    for frame, image in enumerate(images):
        shutil.copyfile(image, capture / "images" / f"{frame:04}.exr")
    return capture


def point_errors(fit, alpha, seen):
    """Medians over the points that at least `seen` frames see."""
    with np.load(fit / "points.npz") as points:
        points = {name: points[name] for name in points.files}
    used = points["frames"] >= seen
    value = {name: array[used].astype(np.float64) for name, array in points.items()}
    status = points["status"][used]
    rho_d, rho_s = np.array(TRUTH["rho_d"]), TRUTH["rho_s"]
    relative = value["alpha"] / alpha - 1
    errors = {
        "points": int(used.sum()),
        "without_alpha": int(np.isnan(relative).sum()),
        "alpha_error": np.nanmedian(np.abs(relative)),
        "alpha_bias": abs(np.nanmedian(relative)),
        "alpha_bias_signed": np.nanmedian(relative),
        "alpha_error_converged": np.nanmedian(np.abs(relative[status == 0])),
        "rho_d_error": np.nanmedian(np.abs(value["rho_d"] / rho_d - 1)),
        "rho_s_error": np.nanmedian(np.abs(value["rho_s"][:, 0] / rho_s - 1)),
        "ggx_share": np.mean(value["ndf"] == 1),
        "status": {name: float(np.mean(status == code)) for code, name in enumerate(STATUS)},
    }
    # Of a normal distribution with the right sigma the median is 0.67.
    with np.errstate(divide="ignore", invalid="ignore"):
        by_sigma = {
            "alpha": (value["alpha"] - alpha) / value["sigma_alpha"],
            "rho_d": (value["rho_d"] - rho_d) / value["sigma_rho_d"],
            "rho_s": (value["rho_s"][:, 0] - rho_s) / value["sigma_rho_s"],
        }
    for name, ratio in by_sigma.items():
        ratio = np.abs(ratio[np.isfinite(ratio)])
        errors[f"{name}_by_sigma"] = np.median(ratio) if len(ratio) else np.nan
    return {name: x if isinstance(x, dict | int) else float(x) for name, x in errors.items()}


def compare(reference, test, folder):
    """turnlight's own figures, pooled over the sequence."""
    table = folder / "compare.json"
    turnlight("compare", reference, test, "--json", table)
    return json.loads(table.read_text())["overall"]


def check_alpha(alpha, plan, cache, folder):
    """Rows by estimator."""
    capture = make_capture(alpha, plan, plan["frames"], folder / "capture", cache)
    rows = []
    for estimator in ("full", "gradient"):
        start = time.perf_counter()
        fit = folder / estimator
        turnlight("fit", capture, "--estimator", estimator, "--out", fit)
        seconds = time.perf_counter() - start
        row = {"alpha": alpha, "estimator": estimator, "fit_seconds": seconds}
        row |= point_errors(fit, alpha, plan["seen"])
        if estimator == "full" and alpha == BARRED_ALPHA:
            spp = ("--spp", plan["reproduce_spp"])
            again = folder / "again"
            turnlight("reproduce", fit, *spp, "--out", again)
            errors = compare(capture, again, folder)
            row |= {"psnr": errors["psnr_db"], "ssim": errors["ssim"], "mean_ratio": errors["mean_ratio"]}
            row |= other_light(alpha, plan, cache, folder, fit, spp)
        rows.append(row)
    return rows


def other_light(alpha, plan, cache, folder, fit, spp):
    """The estimate under another probe against Mitsuba's render of the truth under it."""
    count = plan["other_frames"]
    truth = make_capture(alpha, plan, count, folder / "other", cache, OTHER_PROBE)
    every = plan["frames"] // count
    frames = folder / "other-light"
    images, masks = folder / "images", folder / "masks"
    images.mkdir(), masks.mkdir()
    # The fit's turntable has more frames: take those at the angles of the truth.
    for number in range(count):
        frame = number * every
        out = frames / str(frame)
        turnlight(
            "reproduce", fit, "--probe", OTHER_PROBE, *spp, "--frames", f"{frame}..{frame + 1}", "--out", out
        )
        shutil.copyfile(out / "images" / f"{frame:04}.exr", images / f"{number:04}.exr")
    table = folder / "other.json"
    turnlight("compare", truth / "images", images, "--masks", truth / "masks", "--json", table)
    errors = json.loads(table.read_text())["overall"]
    return {
        "other_psnr": errors["psnr_db"],
        "other_ssim": errors["ssim"],
        "other_mean_ratio": errors["mean_ratio"],
    }


def judge(row, bars):
    """Names of the figures that miss their bar."""
    if row["alpha"] != BARRED_ALPHA or row["estimator"] != "full":
        return []
    # Written so that NaN misses.
    return [
        name
        for name, bar in bars.items()
        if not (row[name] >= bar if name.endswith("psnr") else row[name] <= bar)
    ]


def print_row(row):
    print(
        f"alpha {row['alpha']}, {row['estimator']} ({row['fit_seconds']:.0f} s), {row['points']} points:"
        f" alpha error {row['alpha_error']:.2%} (converged {row['alpha_error_converged']:.2%}),"
        f" bias {row['alpha_bias_signed']:+.2%}; rho_d {row['rho_d_error']:.2%};"
        f" rho_s {row['rho_s_error']:.2%}; GGX {row['ggx_share']:.0%}; without alpha {row['without_alpha']}"
    )
    print(
        "   error / sigma: "
        + ", ".join(f"{name} {row[name + '_by_sigma']:.2f}" for name in ("alpha", "rho_d", "rho_s"))
        + "; status: "
        + ", ".join(f"{name} {share:.1%}" for name, share in row["status"].items() if share)
    )
    for key, light in (("", "the same light"), ("other_", "another light")):
        if key + "psnr" in row:
            print(
                f"   reproduced in {light}: PSNR {row[key + 'psnr']:.1f} dB, SSIM {row[key + 'ssim']:.4f},"
                f" mean ratio {row[key + 'mean_ratio']:.4f}"
            )
    if row["missed"]:
        print(f"   FAIL: {', '.join(row['missed'])}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer, smaller, noisier images; alpha 0.2")
    parser.add_argument("--json", metavar="FILE", help="write the table as JSON")
    parser.add_argument(
        "--cache",
        metavar="DIR",
        type=Path,
        default=ROOT / "target" / "validation" / "fit-cache",
        help="folder for Mitsuba's images (default: %(default)s)",
    )
    parser.add_argument("--keep", metavar="DIR", type=Path, help="leave captures and fits in this new folder")
    parser.add_argument("--alpha", type=float, action="append", help="only this roughness (may be repeated)")
    options = parser.parse_args()

    plan, bars = (QUICK, BARS_QUICK) if options.quick else (FULL, BARS_FULL)
    start = time.perf_counter()
    rows = []
    for alpha in options.alpha or plan["alphas"]:
        with tempfile.TemporaryDirectory() as temporary:
            folder = options.keep / f"alpha-{alpha}" if options.keep else Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            for row in check_alpha(alpha, plan, options.cache, folder):
                row["missed"] = judge(row, bars)
                rows.append(row)
                print_row(row)
    failed = sum(bool(row["missed"]) for row in rows)
    print(
        f"Mitsuba {mitsuba_env.mi.__version__}; {'all bars met' if not failed else 'FAILED'}; "
        f"{time.perf_counter() - start:.0f} s"
    )
    if options.json:
        with open(options.json, "w") as file:
            json.dump({"plan": plan, "bars": bars, "rows": rows}, file, indent=1)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
