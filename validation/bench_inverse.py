"""Parameter error over time: `turnlight fit` and Mitsuba 3's differentiable renderer on the same images.

    target/validation/venv/bin/python validation/bench_inverse.py [--quick] [--size N] [--out FOLDER]

Two objects, a sphere and Suzanne (whose charts are turnlight's), each with 256² maps of rho_d (RGB),
rho_s (neutral) and alpha, Beckmann, under the interior probe; Mitsuba renders 36 frames of 256² (direct
light for the sphere, depth 4 for Suzanne), which both are given, and both are told geometry, light, NDF
and index. Each estimates the maps, one value a texel:

* `turnlight fit --points texels=256`, `--estimator full` over its effort settings (`--light-nodes`,
  here `--nodes`), and the paper's `gradient`: wall time of the command, with loading and writing, all cores;
* Mitsuba `llvm_ad_rgb`: Adam on the maps through `prb`, one frame an iteration in random order, squared
  error relative to the frame, steps by the parameters' scales and decaying over the run. Settings are
  tried for 8 s, the better two for 20 s, the best for 80 s (`--seconds`), and its curve is the best error
  of any run by then. Kernels are compiled and warm before the clock starts (seconds told apart); the
  object stands still and light and camera turn, so that nothing is rebuilt.

Errors are medians of absolute differences over the texels that a sixth of the frames see, of what each
would render them with; `all` is the geometric mean of the three, each relative to its median truth.
"Times faster" is Mitsuba's time over turnlight's, to turnlight's error ("over" where Mitsuba did not get
there in the time it had, which is at least turnlight's) and to the least that Mitsuba reached.

Writes bench_inverse.json, .svg and .md to FOLDER (target/validation).
"""

import argparse
import json
import math
import os
import platform
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import check_fit
import check_images
import exr_files
import turnlight_example
from bench_fit_scale import fit
from bench_render import geometric_mean
from check_images import ROOT, derive_scene
from log_plots import page, panel
from mitsuba_env import mi

import drjit as dr  # after mitsuba_env has found LLVM

ETA = 1.3
SPECULAR_SHARE = 0.5  # of Mitsuba's blend, as `turnlight export mitsuba` has it
CAMERA = {"fov_x_deg": 32.0, "position": [0.0, 1.37, 3.76], "look_at": [0.0, 0.0, 0.0]}
PROBE = ROOT / "scenes" / "probes" / "interior.exr"
PARAMETERS = ("rho_d", "rho_s", "alpha")
# Longest paths in Mitsuba's count: a sphere lights no part of itself.
DEPTH = {"sphere": 2, "suzanne": 4}
START = {"rho_d": 0.35, "rho_s": 0.7, "alpha": 0.35}
BOUNDS = {"rho_d": (0.001, 1.0), "rho_s": (0.0, 10.0), "alpha": (0.02, 1.0)}
# Steps are these times the learning rate: about the parameters' own sizes.
SCALE = {"rho_d": 0.5, "rho_s": 1.0, "alpha": 0.2}
SETTINGS = [  # (learning rate, samples a pixel)
    (0.05, 16),
    (0.1, 4),
    (0.05, 4),
    (0.1, 16),
]

FULL = {
    "texels": 256,
    "size": 256,
    "frames": 36,
    "spp": 256,
    "nodes": (64, 512),
    "stages": ((8.0, 4), (20.0, 2), (80.0, 1)),  # seconds, settings
}
QUICK = {
    "texels": 64,
    "size": 96,
    "frames": 18,
    "spp": 64,
    "nodes": (64, 512),
    "stages": ((3.0, 2), (8.0, 1)),
}


def true_maps(texels):
    """Waves over the map, and a chessboard in rho_d: [texels, texels, channels]."""
    v, u = (np.indices((texels, texels)) + 0.5) / texels
    wave = lambda a, b, phase: np.sin(2 * np.pi * (a * u + b * v) + phase)  # noqa: E731
    rho_d = np.stack(
        [
            0.42 + 0.2 * wave(2, 1, 0.4) * wave(1, 3, 0.0),
            0.36 + 0.17 * wave(4, 1, 1.1),
            0.28 + 0.14 * wave(2, 5, 2.0),
        ],
        axis=-1,
    )
    dark = (np.floor(8 * u) + np.floor(8 * v)) % 2 == 1
    rho_d = np.where(dark[..., None], 0.6 * rho_d, rho_d)
    rho_s = 1.0 + 0.4 * wave(2, 3, 1.3)
    alpha = 0.22 + 0.1 * wave(3, 2, 0.7)
    maps = {"rho_d": rho_d, "rho_s": rho_s[..., None], "alpha": alpha[..., None]}
    return {name: array.astype(np.float32) for name, array in maps.items()}


def write_scene(name, plan, folder, mesh=None):
    """scene.toml of the textured object, with its maps and mesh beside it."""
    texels = plan["texels"]
    if mesh is None and name == "sphere":
        mesh = ROOT / "scenes" / "meshes" / "sphere.ply"
    elif mesh is None:
        mesh = folder / "charted.ply"
        source = ROOT / "scenes" / "meshes" / f"{name}.ply"
        subprocess.run([turnlight_example.build("unwrap"), source, str(texels), mesh], check=True)
    for key, array in true_maps(texels).items():
        exr_files.write_exr(folder / f"{key}.exr", array)
    return derive_scene(
        "sphere-plastic",
        folder / "scene.toml",
        object={"mesh": str(mesh)},
        material={"ndf": "beckmann", "eta": ETA, **{key: f"{key}.exr" for key in PARAMETERS}},
        probe={"image": str(PROBE)},
        camera={"width": plan["size"], "height": plan["size"], **CAMERA},
        turntable={"frames": plan["frames"]},
    )


def make_capture(name, scene, plan, folder, cache):
    """Mitsuba's images with turnlight's masks, as a capture folder."""
    angles = [360.0 * frame / plan["frames"] for frame in range(plan["frames"])]
    images = check_fit.peer_images(scene, angles, plan["spp"], DEPTH[name], cache)
    capture = folder / "capture"
    check_images.turnlight("render", scene, "--spp", 16, "--max-depth", 2, "--out", capture)
    shutil.rmtree(capture / "truth")  # stays out of what the fit is given
    for frame, image in enumerate(images):
        shutil.copyfile(image, capture / "images" / f"{frame:04}.exr")
    return capture


def own_maps(out):
    """What a fit would render with."""
    maps = {key: exr_files.read_exr(out / "maps" / f"{key}.exr") for key in PARAMETERS}
    maps["rho_s"] = maps["rho_s"][..., :1]
    return maps


def seen_texels(out, plan):
    """Mask of the texels that a sixth of the frames see."""
    with np.load(out / "points.npz") as points:
        seen = points["texel"][points["frames"] >= plan["frames"] // 6]
    mask = np.zeros(plan["texels"] ** 2, dtype=bool)
    mask[seen] = True
    return mask.reshape(plan["texels"], plan["texels"])


def errors(maps, truth, seen):
    """Medians of absolute errors, and their geometric mean relative to the truth."""
    found = {key: float(np.median(np.abs(maps[key] - truth[key])[seen])) for key in PARAMETERS}
    relative = [found[key] / float(np.median(truth[key][seen])) for key in PARAMETERS]
    return found | {"all": math.exp(np.mean(np.log(relative)))}


class Peer:
    """The scene in Mitsuba with maps that can be optimised; light and camera turn, the object stands."""

    def __init__(self, name, scene, plan, capture, folder):
        exported = folder / "mitsuba"
        check_images.turnlight("export", "mitsuba", scene, "--out", exported)
        self.texels, self.frames = plan["texels"], plan["frames"]
        self.angles = [-360.0 * frame / self.frames for frame in range(self.frames)]
        texture = lambda share, channels: {  # noqa: E731
            "type": "bitmap",
            "raw": True,
            "bitmap": mi.Bitmap(np.full((self.texels, self.texels, channels), 0.5 / share, np.float32)),
        }
        conductor = {
            "type": "roughconductor",
            "distribution": "beckmann",
            "alpha": texture(1.0, 1),
            "eta": ETA,
            "k": 0.0,
            "specular_reflectance": texture(SPECULAR_SHARE, 1),
        }
        diffuse = {"type": "diffuse", "reflectance": texture(1 - SPECULAR_SHARE, 3)}
        bsdf = {"type": "blendbsdf", "weight": SPECULAR_SHARE, "a": diffuse, "b": conductor}
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "light": {"type": "envmap", "filename": str(exported / "probe.exr")},
                "object": {"type": "ply", "filename": str(exported / "mesh.ply"), "bsdf": bsdf},
            }
        )
        depth = {"max_depth": DEPTH[name], "rr_depth": 100, "hide_emitters": True}
        self.gradient = mi.load_dict({"type": "prb", **depth})
        self.forward = mi.load_dict({"type": "path", **depth})
        self.parameters = mi.traverse(self.scene)
        find = lambda *words: next(  # noqa: E731
            key for key in self.parameters.keys() if all(word in key for word in words)
        )
        self.key = {
            "rho_d": find("bsdf_0.reflectance", "data"),
            "rho_s": find("specular_reflectance", "data"),
            "alpha": find(".alpha", "data"),
        }
        self.light = find("light", "to_world")
        self.share = {"rho_d": 1 - SPECULAR_SHARE, "rho_s": SPECULAR_SHARE, "alpha": 1.0}
        turn = mi.ScalarTransform4f().rotate
        self.turns = [mi.Transform4f(turn([0, 1, 0], angle)) for angle in self.angles]
        images = [exr_files.read_exr(capture / "images" / f"{k:04}.exr") for k in range(self.frames)]
        self.images = [mi.TensorXf(image) for image in images]
        self.weights = [mi.TensorXf(1 / (image**2 + (0.1 * image.mean()) ** 2)) for image in images]
        self.size = plan["size"]

    def sensors(self, spp, sampler="multijitter"):
        """One a frame."""
        place = mi.ScalarTransform4f()
        here = place.look_at(CAMERA["position"], CAMERA["look_at"], [0, 1, 0])
        film = {"type": "hdrfilm", "width": self.size, "height": self.size, "pixel_format": "rgb"}
        film |= {"component_format": "float32", "rfilter": {"type": "box"}}
        sensor = {"type": "perspective", "fov": CAMERA["fov_x_deg"], "fov_axis": "x", "film": film}
        sensor["sampler"] = {"type": sampler, "sample_count": spp}
        return [
            mi.load_dict({**sensor, "to_world": place.rotate([0, 1, 0], angle) @ here})
            for angle in self.angles
        ]

    def set_maps(self, maps):
        for name, key in self.key.items():
            self.parameters[key] = mi.TensorXf(np.ascontiguousarray(maps[name] / self.share[name]))
        self.parameters.update()

    def set_frame(self, frame):
        self.parameters[self.light] = self.turns[frame]
        self.parameters.update()

    def check(self, truth):
        """Ratio of means of a frame rendered from the true maps to the frame given: is it one scene?"""
        self.set_maps(truth)
        frame = self.frames // 5
        self.set_frame(frame)
        image = mi.render(self.scene, integrator=self.forward, sensor=self.sensors(64)[frame], spp=64)
        return float(np.mean(np.array(image)) / np.mean(np.array(self.images[frame])))

    def optimise(self, rate, spp, seconds, truth, seen):
        """Curve of (seconds, errors) of one run of Adam."""
        sensors = self.sensors(spp)
        spp = sensors[0].sampler().sample_count()
        start = {"rho_d": np.full((self.texels, self.texels, 3), START["rho_d"], np.float32)}
        for name in ("rho_s", "alpha"):
            start[name] = np.full((self.texels, self.texels, 1), START[name], np.float32)
        order = np.random.default_rng(1)
        warm = time.perf_counter()

        def begin():
            self.set_maps(start)
            optimiser = mi.ad.Adam(lr=rate, mask_updates=True)
            for key in self.key.values():
                optimiser[key] = self.parameters[key]
            self.parameters.update(optimiser)
            return optimiser

        def step(optimiser, frame, number, decay):
            optimiser.set_learning_rate(
                {key: rate * decay * SCALE[name] / self.share[name] for name, key in self.key.items()}
            )
            self.set_frame(frame)
            image = mi.render(
                self.scene,
                self.parameters,
                integrator=self.gradient,
                sensor=sensors[frame],
                spp=spp,
                seed=2 * number,
                seed_grad=2 * number + 1,
            )
            difference = image - self.images[frame]
            dr.backward(dr.mean(difference * difference * self.weights[frame], axis=None))
            optimiser.step()
            for name, key in self.key.items():
                low, high = (bound / self.share[name] for bound in BOUNDS[name])
                optimiser[key] = dr.clip(optimiser[key], low, high)
            self.parameters.update(optimiser)
            # The backend works behind the caller's back until it is asked to finish.
            dr.eval([optimiser[key] for key in self.key.values()])
            dr.sync_thread()

        # Compile everything, then begin again.
        optimiser = begin()
        for number in range(3):
            step(optimiser, number % self.frames, number, 1.0)
        optimiser = begin()
        warm = time.perf_counter() - warm

        curve, queue = [], []
        clock, number, snapshot = 0.0, 0, 0.5
        while clock < seconds:
            started = time.perf_counter()
            if not queue:
                queue = list(order.permutation(self.frames))
            decay = max(0.03, 0.5 * (1 + math.cos(math.pi * clock / seconds)))
            step(optimiser, int(queue.pop()), 10 + number, decay)
            clock += time.perf_counter() - started
            number += 1
            if clock >= min(snapshot, seconds):
                maps = {n: np.array(self.parameters[k]) * self.share[n] for n, k in self.key.items()}
                curve.append((clock, errors(maps, truth, seen)))
                snapshot = 1.3 * clock
        return {"rate": rate, "spp": spp, "budget": seconds, "warm": warm, "iterations": number, "curve": curve}


def tuned(peer, plan, truth, seen, least):
    """All runs of the stages: the settings that did best go on to the next; the last has `least` seconds."""
    settings, runs = SETTINGS, []
    for seconds, count in (*plan["stages"][:-1], (max(plan["stages"][-1][0], least), 1)):
        stage = [peer.optimise(*setting, seconds, truth, seen) for setting in settings[:count]]
        order = np.argsort([run["curve"][-1][1]["all"] for run in stage])
        settings = [settings[k] for k in order]
        runs += stage
    return runs


def best_by_then(runs, parameter):
    """[(seconds, error)] falling: the least error of any run up to each time."""
    points = sorted((t, e[parameter]) for run in runs for t, e in run["curve"])
    least = np.minimum.accumulate([e for _, e in points])
    return [(t, float(e)) for (t, _), e in zip(points, least, strict=True)]


def first_time(curve, level):
    """When a curve is first at or below an error; None if never."""
    return min((t for t, e in curve if e <= level), default=None)


def times_faster(own, runs, parameter):
    """Mitsuba's time over turnlight's, to either one's error.

    `ours`: to that of a setting of turnlight, the setting that compares best; a lower bound by the time
    Mitsuba was given where it never got there. `theirs`: to the least that Mitsuba reached (within 2 %);
    None where turnlight did not, or where Mitsuba's was no better at its end than in its first second.
    """
    ours = [(row["seconds"], row["errors"][parameter]) for row in own]
    theirs = best_by_then(runs, parameter)
    given = max(t for t, _ in theirs)
    there = [(first_time(theirs, e), t) for t, e in ours]
    ratios = [((other or given) / t, other is None) for other, t in there]
    ratio, is_bound = max(ratios)
    least = 1.02 * theirs[-1][1]
    mine = first_time(ours, least)
    learnt = theirs[-1][1] < 0.9 * theirs[0][1]
    result = {"ours": ratio, "bound": is_bound, "error_ours": min(e for _, e in ours)}
    result["error_theirs"] = theirs[-1][1]
    result["theirs"] = first_time(theirs, least) / mine if learnt and mine else None
    return result


def bench_object(name, plan, cache, folder):
    truth = true_maps(plan["texels"])
    scene = write_scene(name, plan, folder)
    capture = make_capture(name, scene, plan, folder, cache)
    bounces = ("--interreflections", DEPTH[name] - 2)
    common = ("--points", f"texels={plan['texels']}", "--ndf", "beckmann", *bounces)

    own, seen = [], None
    runs = [("full", nodes) for nodes in reversed(plan["nodes"])] + [("gradient", 512)]
    for estimator, nodes in runs:
        out = folder / f"{estimator}-{nodes}"
        seconds, mebibytes, timings = fit(
            capture, out, *common, "--estimator", estimator, "--light-nodes", nodes
        )
        seen = seen_texels(out, plan) if seen is None else seen
        row = {"estimator": estimator, "nodes": nodes, "seconds": seconds, "mebibytes": mebibytes}
        row |= {"timings": timings, "errors": errors(own_maps(out), truth, seen)}
        own.append(row)
        print_line(name, f"{estimator}, {nodes} nodes", seconds, row["errors"])

    peer = Peer(name, scene, plan, capture, folder)
    ratio = peer.check(truth)
    if abs(ratio - 1) > 0.01:
        raise RuntimeError(f"{name}: Mitsuba's turned camera sees {ratio:.3f} times the light of the frame")
    full = [row for row in own if row["estimator"] == "full"]
    runs = tuned(peer, plan, truth, seen, max(row["seconds"] for row in full))
    for run in runs:
        label = f"Mitsuba, rate {run['rate']}, {run['spp']} spp ({run['warm']:.1f} s to compile)"
        print_line(name, label, *run["curve"][-1])
    faster = {key: times_faster(full, runs, key) for key in (*PARAMETERS, "all")}
    gradient = own[-1]["errors"]["alpha"] / min(row["errors"]["alpha"] for row in full)
    return {
        "object": name,
        "texels_seen": int(seen.sum()),
        "own": own,
        "mitsuba": runs,
        "faster": faster,
        "alpha_gradient_over_full": gradient,
    }


def print_line(name, label, seconds, found):
    told = ", ".join(f"{key} {value:.4f}" for key, value in found.items())
    print(f"{name:8} {label:52} {seconds:7.1f} s: {told}", flush=True)


def table(rows):
    lines = ["| object | estimator | seconds | rho_d | rho_s | alpha |", "|---|---|---|---|---|---|"]

    def line(name, label, seconds, found):
        numbers = " | ".join(f"{found[key]:.3g}" for key in PARAMETERS)
        lines.append(f"| {name} | {label} | {seconds:.1f} | {numbers} |")

    for row in rows:
        for own in sorted(row["own"], key=lambda own: (own["estimator"], own["seconds"])):
            label = f"`full`, {own['nodes']} nodes" if own["estimator"] == "full" else "`gradient`"
            line(row["object"], label, own["seconds"], own["errors"])
        for run in row["mitsuba"]:
            label = f"Mitsuba, Adam {run['rate']}, {run['spp']} samples"
            line(row["object"], label, *run["curve"][-1])
    for key in (*PARAMETERS, "all"):
        found = [row["faster"][key] for row in rows]
        each = ", ".join(
            f"{row['object']} {'over ' * entry['bound']}{entry['ours']:.3g}"
            for row, entry in zip(rows, found, strict=True)
        )
        mean = geometric_mean([entry["ours"] for entry in found])
        bound = "over " * any(entry["bound"] for entry in found)
        lines.append(f"\nTimes faster to turnlight's error of {key}: {each}; geometric mean {bound}{mean:.3g}.")
        each = ", ".join(
            f"{row['object']} {'-' if entry['theirs'] is None else format(entry['theirs'], '.3g')}"
            for row, entry in zip(rows, found, strict=True)
        )
        lines.append(f"To the least that Mitsuba reached: {each}.")
    worse = geometric_mean([row["alpha_gradient_over_full"] for row in rows])
    lines.append(f"\nMedian error of alpha, `gradient` over `full`: {worse:.3g} times.")
    return "\n".join(lines) + "\n"


def plot(rows):
    wide, high = 250, 210
    parts = []
    for i, row in enumerate(rows):
        for j, key in enumerate((*PARAMETERS, "all")):
            curve = lambda estimator, key=key, row=row: sorted(  # noqa: E731
                (own["seconds"], own["errors"][key]) for own in row["own"] if own["estimator"] == estimator
            )
            lines = [
                ("#c33", True, curve("full")),
                ("#393", True, curve("gradient")),
                ("#26c", False, best_by_then(row["mitsuba"], key)),
            ]
            what = "all three, relative" if key == "all" else key
            parts += panel(wide * j, 20 + high * i, wide, high, f"{row['object']}: {what}", lines)
    heading = (
        "Median error over seconds: <tspan fill='#c33'>turnlight full</tspan>, "
        "<tspan fill='#393'>gradient</tspan>, <tspan fill='#26c'>Mitsuba 3, the best of its runs</tspan>"
    )
    return page(wide * 4, 20 + high * len(rows), heading, parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small images and short runs")
    parser.add_argument("--size", type=int, metavar="N", help="images and maps of N² instead")
    parser.add_argument("--nodes", metavar="N,N", help="light nodes of turnlight's fits, its effort settings")
    parser.add_argument("--seconds", type=float, help="Mitsuba's time in the last stage")
    parser.add_argument("--only", default="", metavar="TEXT", help="only the object of this name")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "validation", metavar="FOLDER")
    parser.add_argument(
        "--cache",
        type=Path,
        default=ROOT / "target" / "validation" / "inverse-cache",
        metavar="FOLDER",
        help="for Mitsuba's images (default: %(default)s)",
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "mitsuba": mi.__version__}

    plan = dict(QUICK if options.quick else FULL)
    if options.size:
        plan["size"] = plan["texels"] = options.size
    if options.nodes:
        plan["nodes"] = tuple(sorted(int(nodes) for nodes in options.nodes.split(",")))
    if options.seconds:
        plan["stages"] = (*plan["stages"][:-1], (options.seconds, 1))
    rows = []
    for name in DEPTH:
        if options.only in name:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(bench_object(name, plan, options.cache, Path(folder)))
    (options.out / "bench_inverse.json").write_text(json.dumps({**machine, "rows": rows}, indent=1) + "\n")
    (options.out / "bench_inverse.svg").write_text(plot(rows))
    (options.out / "bench_inverse.md").write_text(table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
