import argparse
import hashlib
import sys
import tempfile
from pathlib import Path

import mitsuba_env
from check_images import derive_scene, turnlight
from exr_files import write_exr
import os

def peer_images(scene, angles, spp, depth, cache):
    """Mitsuba's renders, by frame: paths of EXR files in the cache."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        turnlight("export", "mitsuba", scene, "--out", folder)
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

def make(alpha, cache, frames=36, size=256, spp=1024, probe=None):
    import time
    with tempfile.TemporaryDirectory() as folder:
        kw = {}
        if probe: kw["probe"] = {"image": str(probe)}
        scene = derive_scene("suzanne-plastic", Path(folder) / "scene.toml", material={"alpha": alpha, "ndf": "ggx"},
            camera={"width": size, "height": size}, turntable={"frames": frames}, **kw)
        t=time.time()
        ps = peer_images(scene, [360.0 * k / frames for k in range(frames)], spp, 6, Path(cache))
        print(alpha, probe, ps[0].parent, time.time()-t, flush=True)

if __name__ == "__main__":
    make(float(sys.argv[1]), sys.argv[2])
