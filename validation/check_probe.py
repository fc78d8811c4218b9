"""Is turnlight's light probe the one that Mitsuba 3 renders? Look-up by look-up.

    target/validation/venv/bin/python validation/check_probe.py [--quick] [--json FILE]

turnlight's texels are centred in their cells, Mitsuba's first and last row lie on the poles. A
map of H rows therefore goes over as one of 2H + 1: odd rows are the originals, even rows lie
midway between them, the poles repeat their neighbours, and both see the same bilinear function.
Checked with maps that have one lit texel, anywhere, and with random ones over four decades,
turned by several angles, at random directions.

Passes if the two are within 1e-3 of the largest texel around each direction, and the density
that turnlight states integrates to 1 and is positive wherever there is light.
"""

import argparse
import json

import numpy as np
from scipy.ndimage import maximum_filter

import turnlight_example
from mitsuba_env import mi

import drjit as dr  # after mitsuba_env, which chooses the library behind it

BAR = 1e-3


def with_rows_on_the_poles(texels):
    """[H, W, 3] with cell-centred rows to [2H + 1, W, 3] as Mitsuba has them."""
    rows = np.empty((2 * len(texels) + 1, *texels.shape[1:]), dtype=np.float32)
    rows[1::2] = texels
    rows[2:-1:2] = 0.5 * (texels[:-1] + texels[1:])
    rows[0], rows[-1] = texels[0], texels[-1]
    return rows


def in_mitsuba(texels, rotation_deg, directions):
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], rotation_deg)
    bitmap = mi.Bitmap(np.ascontiguousarray(with_rows_on_the_poles(texels)))
    probe = mi.load_dict({"type": "envmap", "bitmap": bitmap, "to_world": turn})
    scene = mi.load_dict({"type": "scene", "probe": probe})
    interaction = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    columns = [mi.Float(np.ascontiguousarray(-column)) for column in directions.T]
    interaction.wi = mi.Vector3f(*columns)
    return np.array(scene.environment().eval(interaction)).T.astype(np.float64)


def local_scale(texels, rotation_deg, directions):
    """The largest texel among those around each direction."""
    angle = np.radians(rotation_deg)
    x, y, z = directions.T.astype(np.float64)
    x, z = np.cos(angle) * x - np.sin(angle) * z, np.sin(angle) * x + np.cos(angle) * z
    u = np.arctan2(x, -z) / (2 * np.pi) % 1.0
    v = np.arccos(np.clip(y, -1, 1)) / np.pi
    height, width = texels.shape[:2]
    largest = maximum_filter(texels.max(axis=-1), size=3, mode=("nearest", "wrap"))
    row = np.minimum((v * height).astype(int), height - 1)
    return largest[row, np.minimum((u * width).astype(int), width - 1)]


def lit_texel(height, width, row, column, value):
    texels = np.zeros((height, width, 3), dtype=np.float32)
    texels[row, column] = (value, 0.5 * value, 0.1 * value)
    return texels


def cases(rng, quick):
    yield "constant", np.full((8, 16, 3), 2.5, dtype=np.float32), 0.0
    lit = ((0, 3, 0.0), (7, 15, 40.0), (3, 0, 0.0), (4, 8, 90.0), (5, 15, -90.0))
    for row, column, rotation in lit:
        yield f"texel {row},{column}", lit_texel(8, 16, row, column, 1e4), rotation
    yield "odd, texel 2,6", lit_texel(5, 7, 2, 6, 1e-4), 200.0
    for height, width, rotation in ((32, 64, 0.0), (33, 61, -37.0), (512, 1024, 123.4)):
        if quick and height > 100:
            continue
        texels = 10.0 ** rng.uniform(-2, 2, (height, width, 3))
        yield f"random {width} x {height}", texels.astype(np.float32), rotation


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the directions")
    parser.add_argument("--json", metavar="FILE", help="write the table as JSON")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()

    rng = np.random.default_rng(options.seed)
    program = turnlight_example.build("probe_values")
    count = 10_000 if options.quick else 100_000
    print(f"{count} directions a case, seed {options.seed}")
    print(f"{'map':22}{'rotation':>9}{'to Mitsuba':>12}{'pdf integral':>14}{'+-':>8}")
    rows = []
    for name, texels, rotation in cases(rng, options.quick):
        directions = rng.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        directions = directions.astype(np.float32)
        found, pdf = turnlight_example.run(program, texels, repr(rotation), directions, outputs=2)
        peer = in_mitsuba(texels, rotation, directions)
        difference = np.abs(found - peer).max(axis=-1)
        scale = local_scale(texels, rotation, directions)
        # Where nothing is lit nearby, both must be black but for rounding at the edge.
        error = float((difference / np.maximum(scale, 1e-6 * texels.max())).max())
        lit = float(pdf[found.max(axis=-1) > 0].min()) > 0
        integral = 4 * np.pi * pdf.mean(dtype=np.float64)
        sigma = 4 * np.pi * pdf.std(dtype=np.float64) / np.sqrt(count)
        passed = error <= BAR and lit and abs(integral - 1) <= 4 * sigma + 1e-6
        rows.append(
            {
                "map": name,
                "rotation_deg": rotation,
                "turnlight_vs_mitsuba": error,
                "pdf_integral": float(integral),
                "pdf_sigma": float(sigma),
                "passed": bool(passed),
            }
        )
        print(
            f"{name:22}{rotation:9}{error:12.1e}{integral:14.4f}{sigma:8.4f}"
            f"{'' if passed else '  FAIL'}"
        )
    failed = sum(not row["passed"] for row in rows)
    print(f"Mitsuba {mi.__version__}; {len(rows) - failed} maps passed, {failed} failed")
    if options.json:
        table = {"bar": BAR, "directions": count, "seed": options.seed, "maps": rows}
        with open(options.json, "w") as file:
            json.dump(table, file, indent=1)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
