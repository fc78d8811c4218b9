"""Does turnlight render the image that Mitsuba 3 renders of the same scene?

    target/validation/venv/bin/python validation/check_images.py [--quick] [--json FILE]

Every case is a shipped scene with another material, camera and turn of the object, which
`turnlight export mitsuba` hands to Mitsuba. Both render it with several independent seeds; the
means over tiles of 8 x 8 pixels are compared by Welch's test, with Sidak's correction for the
number of tiles and channels.

A case passes if at least 99.75 % of the tests are accepted, the means of the images differ by at
most 0.2 %, and the standard error of their ratio is below 0.07 %, so that this says something.

Where a lamp is seen in two narrow lobes, one after the other, a few pixels make all the noise of the
mean: it would take either renderer thousands of seeds of 256 paths. There, the ratio is of the other
pixels. Which those are is found with seeds that are not used again, they may be 5 % of the object at
most, and the table says how many; the tests of tiles have them all.

The full run covers 3 scenes x 3 roughnesses x 2 lobes x 2 specular albedos x 2 depths, the turn
cycling over three angles. With --json it goes on where an interrupted run stopped.
"""

import argparse
import hashlib
import itertools
import json
import os
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np

import exr_files
import seed_moments
import welch
from mitsuba_env import load_scene, mi, render_seeds, samples_per_pixel

ROOT = Path(__file__).resolve().parent.parent
TURNLIGHT = Path(os.environ.get("TURNLIGHT", ROOT / "target" / "release" / "turnlight"))

TILE = 8
ACCEPTED = 0.9975  # of the tiles and channels
RATIO = 0.002  # of the means, from 1
RATIO_ERROR = 0.0007  # standard error that the ratio may have
SEEDS = 16  # at first; doubled while the ratio is too noisy
SEEDS_LIMIT = 1024
LEFT_OUT = 0.05  # of the object's pixels at most may be kept out of the ratio
SPP = {2: 128, 4: 256}  # of one seed, by depth
# Off the axis, so that a mirrored image or a swapped axis shows.
CAMERA = {"position": [0.9, 1.37, 3.66], "look_at": [0.1, 0.05, 0.0]}
ANGLES = (0.0, 97.0, 211.0)

FULL = [
    {"scene": scene, "alpha": alpha, "ndf": ndf, "rho_s": rho_s, "depth": depth}
    for scene, alpha, ndf, rho_s, depth in itertools.product(
        ("sphere-plastic", "suzanne-plastic", "cup"),
        (0.05, 0.2, 0.5),
        ("beckmann", "ggx"),
        (2.35, 20.0),
        (2, 4),
    )
]
for number, case in enumerate(FULL):
    # + number // 3: 3 divides the number of roughnesses, and each should see every angle.
    case.update(size=128, angle=ANGLES[(number + number // 3) % 3])
    # From the other sides, a lamp is seen in two lobes at once: 16 times the noise.
    if case["scene"] == "suzanne-plastic" and case["depth"] == 4 and case["rho_s"] == 20.0:
        case["angle"] = 97.0
# The noisy ones last: light that a bright lobe throws on another takes Mitsuba hundreds of seeds.
FULL.sort(key=lambda case: (case["depth"] == 4 and case["rho_s"] == 20.0, case["depth"]))
QUICK = [
    {"scene": scene, "alpha": alpha, "ndf": ndf, "rho_s": rho_s, "depth": depth, "size": 64, "angle": 97.0}
    for scene, alpha, ndf, rho_s, depth in (
        ("sphere-plastic", 0.2, "ggx", 2.35, 2),
        ("suzanne-plastic", 0.2, "beckmann", 2.35, 4),
        ("cup", 0.5, "ggx", 2.35, 4),
        ("suzanne-plastic", 0.05, "ggx", 20.0, 2),
    )
]
# So bright and narrow a lobe would take minutes to 0.07 %: measured 0.33 % with 16 seeds. Here the
# tiles decide, and the ratio may be off by its noise; the full run holds such cases to the bar.
QUICK[3]["ratio_error"] = 0.005


def turnlight(*words):
    """Runs `turnlight WORDS`; its errors stay visible."""
    subprocess.run([str(TURNLIGHT), "--quiet", *map(str, words)], check=True)


def derive_scene(name, path, **changes):
    """Writes the shipped scene `name` to `path` with sections changed: camera={"width": 64}."""
    source = ROOT / "scenes" / name / "scene.toml"
    scene = tomllib.loads(source.read_text())
    for section, key in (("object", "mesh"), ("probe", "image")):
        scene[section][key] = str((source.parent / scene[section][key]).resolve())
    for section, values in changes.items():
        scene.setdefault(section, {}).update(values)
    if "angles_deg" in changes.get("turntable", {}):
        scene["turntable"].pop("frames", None)
    lines = []
    for section, values in scene.items():
        lines.append(f"[{section}]")
        # JSON's numbers, strings and lists of them are TOML's, too.
        lines += [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    path.write_text("\n".join(lines) + "\n")
    return path


def turnlight_seeds(scene, seeds, spp, depth, folder):
    """Independent renders of a scene of one frame."""
    for seed in seeds:
        turnlight(
            "render", scene, "--spp", spp, "--max-depth", depth, "--seed", seed, "--out", folder / str(seed)
        )
        yield exr_files.read_exr(folder / str(seed) / "images" / "0000.exr").astype(np.float64)


def ratio_and_error(ours, theirs, pixels):
    """Ratio of the images' means over some pixels and its standard error, from the scatter between
    seeds."""
    a, b = (np.array([image[pixels].mean() for image in images]) for images in (ours, theirs))
    relative = [np.var(x, ddof=1) / len(x) / x.mean() ** 2 for x in (a, b)]
    ratio = a.mean() / b.mean()
    return float(ratio), float(ratio * np.sqrt(sum(relative)))


def steady_pixels(renders, largest_error):
    """The pixels whose mean can be told to `largest_error` with SEEDS_LIMIT seeds, as a mask, from
    other seeds: all of them, or all but the noisiest."""
    means, variances = [], []
    for images in renders:
        images = np.array(images).mean(axis=3)
        means.append(images.mean(axis=0).ravel())
        variances.append(images.var(axis=0, ddof=1).ravel() / SEEDS_LIMIT)
    mean, variance = np.mean(means, axis=0), np.sum(variances, axis=0)
    order = np.argsort(-variance)
    # Pixels are independent: each has its own numbers.
    kept = np.maximum(np.cumsum(mean[order][::-1])[::-1], 1e-12)
    error = np.sqrt(np.cumsum(variance[order][::-1])[::-1]) / kept
    left_out = int(np.argmax(error < largest_error))
    steady = np.ones(mean.size, dtype=bool)
    steady[order[:left_out]] = False
    return steady.reshape(np.shape(renders[0])[1:3])


def check_case(case, folder):
    start = time.perf_counter()
    spp, depth = SPP[case["depth"]], case["depth"]
    scene = derive_scene(
        case["scene"],
        folder / "scene.toml",
        material={key: case[key] for key in ("alpha", "ndf", "rho_s")},
        camera={**CAMERA, "width": case["size"], "height": case["size"]},
        turntable={"angles_deg": [case["angle"]]},
    )
    turnlight("export", "mitsuba", scene, "--out", folder / "mitsuba")
    peer = load_scene(folder / "mitsuba" / "scene.xml", case["angle"], spp, depth)

    largest_error = case.get("ratio_error", RATIO_ERROR)
    ours, theirs = [], []
    steady = np.ones((case["size"], case["size"]), dtype=bool)
    while True:
        have = len(ours)
        seeds = range(have, max(SEEDS, 2 * have))
        ours += turnlight_seeds(scene, seeds, spp, depth, folder)
        theirs += render_seeds(peer, seeds)
        ratio, error = ratio_and_error(ours, theirs, steady)
        if len(ours) == SEEDS and error > largest_error * np.sqrt(SEEDS_LIMIT / SEEDS):
            others = range(SEEDS_LIMIT, SEEDS_LIMIT + 2 * SEEDS)
            renders = [
                list(turnlight_seeds(scene, others, spp, depth, folder)),
                list(render_seeds(peer, others)),
            ]
            steady = steady_pixels(renders, 0.8 * largest_error)
            ratio, error = ratio_and_error(ours, theirs, steady)
        if error < largest_error or len(ours) >= SEEDS_LIMIT:
            break

    largest_ratio = RATIO + (3 * error if "ratio_error" in case else 0.0)
    a, b = (seed_moments.moments(images, TILE) for images in (ours, theirs))
    agreement = welch.compare(a, b)
    object_pixels = int((np.mean(theirs, axis=0).sum(axis=2) > 0).sum())
    left_out = int((~steady).sum())
    noise = [np.sqrt(m.variance.sum()) / np.linalg.norm(m.mean) for m in (a, b)]
    return {
        "ratio": ratio,
        "ratio_error": error,
        "ratio_of_all": ratio_and_error(ours, theirs, np.ones_like(steady)),
        "left_out": left_out,
        "object_pixels": object_pixels,
        "accepted": agreement.accepted_fraction,
        "rejected": agreement.rejected,
        "tests": agreement.tests,
        "worst_z": agreement.worst_z,
        "worst": agreement.worst,
        "family_p": agreement.family_p,
        "uniform_p": agreement.uniform_p,
        "seeds": len(ours),
        "spp": [spp, int(samples_per_pixel(peer))],
        "tile_noise": [float(x) for x in noise],  # relative, of one seed: turnlight's, Mitsuba's
        "seconds": time.perf_counter() - start,
        "passed": bool(
            agreement.accepted_fraction >= ACCEPTED
            and abs(ratio - 1) <= largest_ratio
            and error < largest_error
            and left_out <= LEFT_OUT * object_pixels
        ),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="four small cases")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the table as JSON, and go on from it")
    parser.add_argument("--only", metavar="TEXT", default="", help="only cases whose name contains this")
    options = parser.parse_args()

    # A row is taken from the file only if it is of this program.
    program = hashlib.sha256(TURNLIGHT.read_bytes()).hexdigest()
    table = {"program": program, "mitsuba": mi.__version__, "cases": {}}
    if options.json and options.json.exists():
        earlier = json.loads(options.json.read_text())
        if all(earlier.get(key) == table[key] for key in ("program", "mitsuba")):
            table = earlier

    start = time.perf_counter()
    failed = passed = 0
    print(f"{'case':52}{'ratio - 1':>10}{'+-':>8}{'rejected':>13}{'worst z':>9}{'family p':>10}{'seeds':>6}{'left out':>9}{'s':>7}")
    for case in QUICK if options.quick else FULL:
        name = (
            "{scene} {ndf} alpha {alpha} rho_s {rho_s} depth {depth} {size}² at {angle:.0f}°".format(**case)
        )
        if options.only not in name:
            continue
        row = table["cases"].get(name)
        if row is None:
            with tempfile.TemporaryDirectory() as folder:
                row = check_case(case, Path(folder))
            table["cases"][name] = row
            if options.json:
                options.json.write_text(json.dumps(table, indent=1) + "\n")
        passed += row["passed"]
        failed += not row["passed"]
        print(
            f"{name:52}{row['ratio'] - 1:+10.2%}{row['ratio_error']:8.3%}"
            f"{row['rejected']:6} of {row['tests']:4}{row['worst_z']:+8.1f}{row['family_p']:10.2g}"
            f"{row['seeds']:6}{row['left_out']:9}{row['seconds']:7.1f}{'' if row['passed'] else '  FAIL'}",
            flush=True,
        )
    print(
        f"Mitsuba {mi.__version__}; {passed} cases passed, {failed} failed; "
        f"{time.perf_counter() - start:.0f} s"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
