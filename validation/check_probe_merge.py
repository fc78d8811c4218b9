"""Does `turnlight probe merge` find the response and the radiance?

    target/validation/venv/bin/python validation/check_probe_merge.py [--quick] [--json FILE]

Against OpenCV's Debevec on the photographs of ../shared/data/brackets, where they are: the median of
|Δ log2 radiance| over samples that are well exposed (levels 20 to 235) in two frames at least, after one
scale for all. Against the truth on simulated brackets: 11 exposures 1.4 stops apart, 8 bits, a tone curve,
shot and read noise; radiance over six decades, the brightest saturated in every exposure.

Passes if the first is at most 0.05 and, simulated, the median error is at most 1 % (by either response), the range
kept at least 1e5, and at least 99 % of the saturated texels are in the mask.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from exr_files import read_exr

ROOT = Path(__file__).resolve().parent.parent
TURNLIGHT = ROOT / "target/release/turnlight"
BRACKETS = ROOT.parent / "shared/data/brackets"
WELL = (20, 235)


def merge(images, out, *options):
    command = [TURNLIGHT, "--quiet", "probe", "merge", *images, "--out", out, *options]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return read_exr(out), cv2.imread(str(out.with_suffix(".clipped.png")), cv2.IMREAD_GRAYSCALE)


def opencv(stack, times, samples):
    """OpenCV's defaults are 70 samples and lambda 10; its data term grows with the samples."""
    times = np.asarray(times, dtype=np.float32)
    calibrate = cv2.createCalibrateDebevec(samples=samples, lambda_=samples / 7, random=False)
    response = calibrate.process(stack, times)
    radiance = cv2.createMergeDebevec().process(stack, times, response)
    return radiance[..., ::-1]


def photographs(folder, times, work):
    """median |Δ log2| of turnlight's defaults and with the times as they are claimed."""
    images = sorted(folder.glob("*.jpg"))
    stack = [cv2.imread(str(image)) for image in images]
    levels = np.stack([image[..., ::-1] for image in stack])
    well = ((levels >= WELL[0]) & (levels <= WELL[1])).sum(axis=0) >= 2
    rows = []
    peers = {samples: opencv(stack, times, samples) for samples in (70, 400)}
    cases = [(samples, name, options) for samples in peers for name, options in
             (("claimed times", ["--trust-times", "--no-align"]), ("defaults", []))]
    for samples, name, options in cases:
        theirs = peers[samples]
        ours, _ = merge(images, work / "merged.exr", *options)
        usable = well & (ours > 0) & (theirs > 0)
        delta = np.log2(ours[usable] / theirs[usable])
        delta -= np.median(delta)
        rows.append({"case": f"{folder.name}, {name}, OpenCV with {samples} samples", "samples": int(usable.sum()),
                     "median_abs_log2": float(np.median(np.abs(delta)))})
    return rows


def srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


TONES = {
    "sRGB": srgb,
    "film": lambda x: 0.5 * srgb(x) + 0.5 * srgb(x) ** 2 * (3 - 2 * srgb(x)),
    "gamma 1.8": lambda x: x ** (1 / 1.8),
}


def scene(width, height, random):
    """Radiance over six decades, smooth, with lamps and colours."""
    v, u = np.mgrid[0:height, 0:width] / [[[height]], [[width]]]
    level = 6 * u - 3 + 0.3 * np.sin(9 * v) + 0.2 * np.cos(31 * u * v)
    lamps = random.random((height // 8, width // 8)).repeat(8, 0).repeat(8, 1) < 0.03
    base = 10 ** (level + lamps)
    return np.stack([base, base * (0.8 + 0.1 * v), base * (0.6 + 0.3 * u)], axis=-1)


def simulated(tone_name, size, work, options=()):
    random = np.random.default_rng(20)
    truth = scene(*size, random)
    times = 2.0 ** (1.4 * np.arange(11)) / 2000
    tone = TONES[tone_name]
    images = []
    for j, time in enumerate(times):
        x = time * truth
        x = x + random.normal(size=x.shape) * np.sqrt(x / 30000 + (5 / 30000) ** 2)
        level = np.round(255 * tone(np.clip(x, 0, 1))).astype(np.uint8)
        images.append(work / f"{j:02}.png")
        cv2.imwrite(str(images[-1]), level[..., ::-1])
    # EXIF rounds: what is claimed is a few per cent off, and whole on the mean.
    claimed = times * np.exp(0.04 * np.cos(2.1 * np.arange(11)))
    claimed *= np.exp(np.mean(np.log(times / claimed)))
    ours, mask = merge(images, work / "merged.exr", "--times",
                       ",".join(repr(float(t)) for t in claimed), *options)
    brightest = (truth * times[0]).max(axis=-1)
    clipped, open_ = brightest >= 1, mask == 0
    ratio = ours[open_] / truth[open_]
    ratio /= np.median(ratio)
    green = np.sort(ours[..., 1].ravel())
    return {
        "case": f"simulated, {tone_name}, {size[0]} × {size[1]}" + "".join(f", {o}" for o in options),
        "median_error": float(np.median(np.abs(ratio - 1))),
        "range": float(green[-1] / green[len(green) // 100]),
        "clipped": int(clipped.sum()),
        "recall": float((mask[clipped] > 0).mean()),
        "false_share": float((mask[brightest < 0.9] > 0).mean()),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows, failed = [], 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        canon = BRACKETS / "canon_frobisher"
        if canon.exists():
            rows += photographs(canon, [1 / 8, 1, 8], work)
        else:
            print(f"{canon} is not there: no comparison with OpenCV")
        cases = [("film", (256, 128), ())] if arguments.quick else [
            (tone, (1024, 512), options)
            for tone in TONES for options in ((), ("--response", "robertson"))
        ]
        for case in cases:
            rows.append(simulated(case[0], case[1], work, case[2]))
    for row in rows:
        if "median_abs_log2" in row:
            good = row["median_abs_log2"] <= 0.05
            print(f"{row['case']}: median |Δ log2| {row['median_abs_log2']:.4f} over {row['samples']} samples")
        else:
            good = row["median_error"] <= 0.01 and row["range"] >= 1e5 and row["recall"] >= 0.99
            print(f"{row['case']}: median error {100 * row['median_error']:.2f} %, range {row['range']:.2e}, "
                  f"recall {100 * row['recall']:.2f} % of {row['clipped']}, "
                  f"false {100 * row['false_share']:.3f} %")
        row["passed"] = bool(good)
        failed += not good
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))
    print(f"{len(rows) - failed} of {len(rows)} cases pass")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
