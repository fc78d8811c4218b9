"""OpenEXR files as float32 arrays [height, width, channels], row 0 at the top, linear."""

import numpy as np
import OpenEXR


def read_exr(path):
    """The image's R, G, B (three channels) or Y (one), else all its channels by name."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        planes = {name: channel.pixels for name, channel in file.channels().items()}
    for names in (("R", "G", "B"), ("Y",), sorted(planes)):
        if all(name in planes for name in names):
            return np.stack([planes[name] for name in names], axis=-1).astype(np.float32)


def write_exr(path, image):
    """Writes [height, width], [height, width, 1] or [height, width, 3] losslessly as float32."""
    image = np.asarray(image, dtype=np.float32)
    if image.ndim == 2:
        image = image[..., None]
    names = {1: "Y", 3: "RGB"}[image.shape[-1]]
    channels = {name: np.ascontiguousarray(image[..., k]) for k, name in enumerate(names)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
