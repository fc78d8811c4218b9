"""Mitsuba 3 as the peer renderer, set up the same way for every validation script.

Importing this module finds libLLVM and selects the variant `llvm_ad_rgb`, so import it
before anything else that imports mitsuba, and use its `mi`.

Seeds: renders with different seeds are independent; the same seed gives the same image.
"""

import os

import numpy as np

import libllvm

_library = libllvm.find()
if _library is None:
    raise ImportError("no libLLVM 17 or newer found; run validation/setup.sh")
os.environ["DRJIT_LIBLLVM_PATH"] = _library

import mitsuba as mi  # noqa: E402  (after the library path is set)

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Warn)


def load_scene(xml, angle_deg=0.0, spp=64, max_depth=4, sampler="multijitter"):
    """Loads an XML scene that `turnlight export mitsuba` wrote, the object turned by `angle_deg`.

    `multijitter` is the sampler to compare speeds with: Mitsuba's default, `independent`,
    is 5 to 16 times worse at equal time. It rounds `spp` up to a grid (512 to 528).
    """
    return mi.load_file(
        str(xml),
        angle_deg=repr(float(angle_deg)),
        spp=str(int(spp)),
        max_depth=str(int(max_depth)),
        sampler=sampler,
    )


def samples_per_pixel(scene):
    """What the sampler really takes, after its rounding."""
    return scene.sensors()[0].sampler().sample_count()


def render(scene, seed):
    """Linear radiance, float64 [height, width, 3], row 0 at the top. Waits for the result."""
    return np.array(mi.render(scene, seed=seed), dtype=np.float64)


def render_seeds(scene, seeds):
    """Independent renders, one at a time: `for image in render_seeds(scene, range(64))`."""
    for seed in seeds:
        yield render(scene, seed)
