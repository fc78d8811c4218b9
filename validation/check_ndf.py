"""Is the NDF that `--ndf tabulated` finds the one that was measured, on a real material?

    target/validation/venv/bin/python validation/check_ndf.py FILE.bsdf ... [--json FILE] [--cache DIR]

FILE.bsdf is a measured isotropic BRDF of Dupuy and Jakob's database (RGL, 2018), three channels
(`*_rgb.bsdf`), which holds the NDF that was measured by retroreflection. Mitsuba 3 renders a sphere of
it with its `measured` plugin; `turnlight fit --ndf tabulated --pool object --fresnel auto` is given the
images. Densities are compared by shape, over the half angles at which the measured one is above 1 % of
its peak: the median and the largest of |ln ratio|, the mean of the ratio's logarithm left out. The same
for the parametric lobe of the fit. A table that is no nearer to the measured NDF than that fails.
"""

import argparse
import json
import shutil
import struct
import tempfile
import time
from pathlib import Path

import numpy as np

from check_fit import MASK_SPP, peer_images
from check_images import ROOT, derive_scene, turnlight
from check_metals import DEPTH, NAME, for_mitsuba, noise_of, write_sphere
from mitsuba_env import mi

PLAN = {"frames": 24, "size": 64, "spp": 1936}
TOLD = 0.2  # knots with a larger relative deviation tell nothing
FLOOR = 0.01  # of the peak


def read_tensors(path):
    """Arrays of a file in the tensor format of Dupuy and Jakob."""
    data = path.read_bytes()
    assert data[:12] == b"tensor_file\0", f"{path}: not a tensor file"
    kinds = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "u8", 8: "i8", 9: "f2", 10: "f4", 11: "f8"}
    (fields,) = struct.unpack_from("<I", data, 14)
    position, arrays = 18, {}
    for _ in range(fields):
        (length,) = struct.unpack_from("<H", data, position)
        name = data[position + 2 : position + 2 + length].decode()
        position += 2 + length
        axes, kind, offset = struct.unpack_from("<HBQ", data, position)
        position += 11
        shape = struct.unpack_from(f"<{axes}Q", data, position)
        position += 8 * axes
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, "<" + kinds[kind], count, offset).reshape(shape)
    return arrays


def measured_ndf(path):
    """Half angles and the density there, up to a factor."""
    ndf = read_tensors(path)["ndf"].astype(np.float64).mean(axis=0)
    # The grid is even in the square root of the angle.
    return (np.linspace(0, 1, len(ndf)) ** 2) * np.pi / 2, ndf


def parametric(theta, alpha, ndf):
    cos2, a2 = np.cos(theta) ** 2, alpha * alpha
    if ndf == 1:
        return a2 / (np.pi * (cos2 * (a2 - 1) + 1) ** 2)
    return np.exp(-np.tan(theta) ** 2 / a2) / (np.pi * a2 * cos2 * cos2)


def distance(density, truth):
    """Median and largest |ln ratio|, its mean left out."""
    ratio = np.log(np.maximum(density, 1e-12) / truth)
    ratio -= ratio.mean()
    return float(np.median(np.abs(ratio))), float(np.abs(ratio).max())


def check(path, folder, cache, plan):
    scene = derive_scene(
        NAME,
        folder / "scene.toml",
        object={"mesh": str(write_sphere(folder / "sphere.ply"))},
        camera={"width": plan["size"], "height": plan["size"]},
        turntable={"frames": plan["frames"]},
    )
    angles = [360.0 * frame / plan["frames"] for frame in range(plan["frames"])]

    def edit(xml):
        xml = for_mitsuba({"metal": "Au", "alpha": 0.1, "ndf": "ggx"})(xml)
        start, end = xml.index('<bsdf type="roughconductor">'), xml.index("</bsdf>")
        measured = f'<bsdf type="measured"><string name="filename" value="{path.resolve()}"/>'
        return xml[:start] + measured + xml[end:]

    images = peer_images(scene, angles, plan["spp"], DEPTH, cache, edit)
    capture = folder / "capture"
    turnlight("render", scene, "--spp", MASK_SPP, "--max-depth", DEPTH, "--out", capture)
    shutil.rmtree(capture / "truth")
    for frame, image in enumerate(images):
        shutil.copyfile(image, capture / "images" / f"{frame:04}.exr")
    fit = folder / "fit"
    choices = ("--ndf", "tabulated", "--pool", "object", "--fresnel", "auto")
    turnlight("fit", capture, *choices, "--out", fit)
    with np.load(fit / "ndf.npz") as file:
        table = {name: file[name].astype(np.float64) for name in file.files}
    theta, density, sigma = table["theta"], table["density"][0], table["sigma"][0]
    truth = np.interp(theta, *measured_ndf(path))
    told = (truth > FLOOR * truth.max()) & (sigma < TOLD * density)
    lobe = parametric(theta[told], table["alpha"][0], int(table["ndf"][0]))
    return {
        "name": path.stem,
        "noise": noise_of(images),
        "points": int(table["points"][0]),
        "knots": int(told.sum()),
        "above_floor": int((truth > FLOOR * truth.max()).sum()),
        "alpha": float(table["alpha"][0]),
        "ndf": int(table["ndf"][0]),
        "integral": float(table["integral"][0]),
        "table": distance(density[told], truth[told]),
        "lobe": distance(lobe, truth[told]),
        "theta_deg": np.degrees(theta[told]).tolist(),
        "density": density[told].tolist(),
        "sigma": sigma[told].tolist(),
        "measured": truth[told].tolist(),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", metavar="FILE", type=Path, nargs="+", help="measured BRDFs, *_rgb.bsdf")
    parser.add_argument("--json", metavar="FILE", help="write the table as JSON")
    parser.add_argument(
        "--cache",
        metavar="DIR",
        type=Path,
        default=ROOT / "target" / "validation" / "fit-cache",
        help="folder for Mitsuba's images (default: %(default)s)",
    )
    for key in PLAN:
        parser.add_argument(f"--{key}", type=int, metavar="N", help="instead of the plan's")
    options = parser.parse_args()
    plan = {key: getattr(options, key) or value for key, value in PLAN.items()}
    start = time.perf_counter()
    rows, failed = [], 0
    for path in options.files:
        with tempfile.TemporaryDirectory() as folder:
            row = check(path, Path(folder), options.cache, plan)
        rows.append(row)
        passed = row["table"][0] < row["lobe"][0] and row["knots"] > 0
        failed += not passed
        print(
            f"{row['name']}: noise {row['noise']:.2%}, {row['points']} points, {row['knots']} of"
            f" {row['above_floor']} knots told; |ln ratio| median {row['table'][0]:.3f}, largest {row['table'][1]:.3f};"
            f" {'GGX' if row['ndf'] == 1 else 'Beckmann'} {row['alpha']:.3f}: {row['lobe'][0]:.3f},"
            f" {row['lobe'][1]:.3f}: {'PASS' if passed else 'FAIL'}",
            flush=True,
        )
    print(f"Mitsuba {mi.__version__}; {failed} of {len(rows)} failed; {time.perf_counter() - start:.0f} s")
    if options.json:
        Path(options.json).write_text(json.dumps({"plan": plan, "rows": rows}, indent=1))
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
