"""
Separate one raw mosaic of a polarization camera
================================================

A polarization camera takes one picture, in which each pixel lies behind its own polarizer. polaropt does not
interpolate between them: the layers that it finds are those whose samples are what the sensor measured.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
import tifffile
from scipy.ndimage import gaussian_filter
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, read_capture, separate, simulate

# %%
# The camera
# ----------
# Four full photographs of a grey scene, of which each pixel keeps one: Sony's cell holds 90, 45, 135 and 0 degrees. The
# lens blurs as those of such cameras do, whose pixels are small (0.7 px).


def through_lens(photograph):
    return gaussian_filter(photograph.mean(axis=2) / 255, 0.7)


behind, mirrored = through_lens(coffee()[60:316, 150:406]), through_lens(astronaut()[0:256, 110:366])
taken = simulate(behind, mirrored, SceneParameters(60.0, 25.0, 4.0), noise=0.005, bits=12)
raw = np.empty(behind.shape)
for (row, column), angle in {(0, 0): 90, (0, 1): 45, (1, 0): 135, (1, 1): 0}.items():
    photograph = taken.intensities[taken.angles_deg.index(angle)]
    raw[row::2, column::2] = photograph[row::2, column::2]
file = Path(mkdtemp()) / "raw.tiff"
tifffile.imwrite(file, np.round(np.clip(raw, 0, 1) * 65535).astype(np.uint16))

# %%
# Read it and separate
# --------------------

capture = read_capture(file)
print(capture.origin.layout, "cell", capture.origin.cell_order)
result = separate(capture)
print(f"incidence {result.scene.incidence_deg:.1f} +- {result.errors.incidence_deg:.1f} degrees (60 is true)")
print([warning.name for warning in result.diagnostics.warnings])

# %%
# The layers have the sensor's resolution.

fig, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
pictures = {"raw mosaic": raw, "transmission": result.transmission, "reflection": result.reflection}
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(picture, cmap="gray", vmin=0, vmax=np.quantile(picture, 0.995))
    axis.set(title=title, xticks=[], yticks=[])

# %%
# A quarter of the pixels, in less time: ``resolution="cell"`` gives one pixel for each cell of four.

cells = separate(read_capture(file, resolution="cell"))
print(result.transmission.shape, cells.transmission.shape)
