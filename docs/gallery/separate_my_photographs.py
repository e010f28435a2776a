"""
Separate my photographs
=======================

Four photographs through a hand-turned polarizer become what is behind the glass and what the glass mirrors. To use this
notebook on your own photographs, put their names into ``FILES`` and leave the next cell out, which only makes some.
"""

# %%
# The photographs
# ---------------
# Linear TIFF or PNG files, or the camera's raw files, in the order of the polarizer's angles.

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
import tifffile
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, read_capture, separate, simulate

FOLDER = Path(mkdtemp())
ANGLES_DEG = (0, 45, 90, 135)
FILES = [FOLDER / f"glass_{angle:03}.tiff" for angle in ANGLES_DEG]

# %%
# In place of a camera: a cup of coffee behind glass at 65 degrees, in which an astronaut is mirrored. 16 bits, noise of
# 0.5 % of white.

room, street = coffee()[60:316, 150:406] / 255 * 0.5, astronaut()[0:256, 110:366] / 255
taken = simulate(room, street, SceneParameters(incidence_deg=65.0, azimuth_deg=25.0, ghost_shift=5.0))
for file, photograph in zip(FILES, np.moveaxis(taken.intensities, 1, -1), strict=True):
    tifffile.imwrite(file, np.round(np.clip(photograph, 0, 1) * 65535).astype(np.uint16))

# %%
# Read and look
# -------------
# The photographs differ, as the glass polarizes what it mirrors.

capture = read_capture(FILES, angles_deg=ANGLES_DEG)
fig, axes = plt.subplots(1, 4, figsize=(12, 3.2), layout="constrained")
for axis, angle, photograph in zip(axes, ANGLES_DEG, np.moveaxis(capture.intensities, 1, -1), strict=True):
    axis.imshow(np.clip(2 * photograph, 0, 1))
    axis.set(title=f"polarizer at {angle} degrees", xticks=[], yticks=[])

# %%
# Separate
# --------
# Nothing is told of the pane.

result = separate(capture)
scene, errors = result.scene, result.errors
print(f"incidence   {scene.incidence_deg:6.1f} +- {errors.incidence_deg:.2f} degrees")
print(f"azimuth     {scene.azimuth_deg:6.1f} +- {errors.azimuth_deg:.2f} degrees")
print(f"ghost shift {scene.ghost_shift:6.1f} +- {errors.ghost_shift:.2f} px")
for warning in result.diagnostics.warnings:
    print(warning.name, warning.value)

# %%
# The layers, and where they are uncertain: the standard error of each pixel.

error = result.uncertainty.mean(axis=1)
pictures = {
    "what is behind the glass": result.transmission,
    "what the glass mirrors": result.reflection,
    "standard error, transmission": error[0],
    "standard error, reflection": error[1],
}
fig, axes = plt.subplots(2, 2, figsize=(8, 8.4), layout="constrained")
for axis, (title, picture) in zip(axes.flat, pictures.items(), strict=True):
    shown = axis.imshow(picture if picture.ndim == 2 else np.clip(picture / np.quantile(picture, 0.99), 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
    if picture.ndim == 2:
        fig.colorbar(shown, ax=axis, shrink=0.8)

# %%
# Keep
# ----
# The layers are linear, 32-bit floating point. ``polaropt separate`` writes these files, pictures to look at and a
# report.

tifffile.imwrite(FOLDER / "transmission.tiff", result.transmission)
tifffile.imwrite(FOLDER / "reflection.tiff", result.reflection)
print(sorted(file.name for file in FOLDER.iterdir()))
