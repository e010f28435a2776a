"""
Align photographs that were held by hand
========================================

Turning the filter moves the camera. A shift of a pixel fakes polarization at every edge; ``align`` finds the shifts
(and turns) and takes them back before anything is estimated.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import shift
from skimage.data import astronaut, coffee

from polaropt import Capture, SceneParameters, align, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
taken = simulate(transmission, reflection, SceneParameters(60.0, 20.0, 4.0))
SHIFTS = ((0, 0), (1.5, -2.2), (-3.0, 0.8), (2.4, 3.1))
moved = [
    shift(photograph, (*by, 0), order=3, mode="mirror")
    for photograph, by in zip(np.moveaxis(taken.intensities, 1, -1), SHIFTS, strict=True)
]
capture = Capture(moved)

# %%
aligned = align(capture)
for true, found in zip(SHIFTS, aligned.origin.shifts_px, strict=True):
    print(f"down {true[0]:5.2f}, right {true[1]:5.2f} px; found {found[0]:5.2f}, {found[1]:5.2f}")
print("frame", capture.shape[1:], "->", aligned.shape[1:], "which all photographs show")

# %%
# As they are, and aligned
# ------------------------

as_they_are, result = separate(capture), separate(aligned)
for name, separation in {"as they are": as_they_are, "aligned": result}.items():
    names = ", ".join(warning.name for warning in separation.diagnostics.warnings) or "none"
    print(f"{name:12} incidence {separation.scene.incidence_deg:5.1f} degrees (60 is true), warnings: {names}")

fig, axes = plt.subplots(2, 2, figsize=(8, 8.4), layout="constrained")
pictures = {
    "transmission, as they are": as_they_are.transmission,
    "reflection, as they are": as_they_are.reflection,
    "transmission, aligned": result.transmission,
    "reflection, aligned": result.reflection,
}
for axis, (title, picture) in zip(axes.flat, pictures.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
