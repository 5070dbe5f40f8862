"""Layer 0 of DDS arrays by Pillow: with the manifest's scale and bias it is the coefficients of the float asset."""

import json
import struct
import sys
from pathlib import Path

import numpy
from PIL import Image, __version__

folder = Path(sys.argv[1])


def planes_of_float():
    """Coefficients of the planes in f32.dds, which is plain: level 0, layers of R, G, B, A floats."""
    data = (folder / "f32.dds").read_bytes()
    height, width = struct.unpack_from("<II", data, 12)
    layers = json.loads((folder / "f32.json").read_text())["arrays"][0]["layers"]
    texels = numpy.frombuffer(data, "<f4", offset=148).reshape(len(layers), height, width, 4)
    planes = {}
    for layer, texel in zip(layers, texels):
        for channel, plane in enumerate(layer["planes"]):
            planes[plane] = texel[:, :, channel] * layer["scale"][channel] + layer["bias"][channel]
    return planes


planes = planes_of_float()
# The bound is on the mean difference, in parts of a plane's spread; swapped planes or rows are off by more than 1.
bounds = {"u8": 0.02, "bc1": 0.15, "bc3": 0.15, "bc4": 0.05, "bc5": 0.05, "bc7": 0.06}
for name, bound in bounds.items():
    layer = json.loads((folder / f"{name}.json").read_text())["arrays"][0]["layers"][0]
    image = Image.open(folder / f"{name}.dds")
    texels = numpy.asarray(image, dtype=numpy.float64) / 255.0
    texels = texels.reshape(*texels.shape[:2], -1)
    worst = 0.0
    for channel, plane in enumerate(layer["planes"]):
        found = texels[:, :, channel] * layer["scale"][channel] + layer["bias"][channel]
        expected = planes[plane]
        assert found.shape == expected.shape, f"{name}: {found.shape} for {expected.shape}"
        worst = max(worst, float(numpy.abs(found - expected).mean() / expected.std()))
    assert worst <= bound, f"{name}: layer 0 is off by {worst:.3f} of its spread, more than {bound}"
    print(f"thirdparty: Pillow {__version__} reads layer 0 of {name}.dds ({image.mode}), off by {worst:.4f} of its spread")
