"""
Align photographs that were held by hand
========================================

Turning the filter moves and turns the camera. A shift of a pixel fakes polarization at every edge; the photographs are
put back onto the first one before anything is estimated. What lies farther apart than a quarter of the frame, ``align``
puts back, and cuts off what not all photographs show.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import rotate, shift
from skimage.data import astronaut, coffee

from polaropt import Capture, SceneParameters, align, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
taken = simulate(transmission, reflection, SceneParameters(60.0, 20.0, 4.0))
SHIFTS = ((0, 0), (1.5, -2.2), (-3.0, 0.8), (2.4, 3.1))
TURNS_DEG = (0.0, 0.4, -0.3, 0.6)


def by_hand(photograph, by, turn_deg):
    """A photograph (h, w, 3) moved down and to the right, and turned clockwise."""
    moved = shift(photograph, (*by, 0), order=5, mode="mirror") if any(by) else photograph
    return rotate(moved, -turn_deg, reshape=False, order=5, mode="mirror") if turn_deg else moved


photographs = np.moveaxis(taken.intensities, 1, -1)
capture = Capture([by_hand(*one) for one in zip(photographs, SHIFTS, TURNS_DEG, strict=True)])

# %%
# What is put back
# ----------------

as_they_are, result = separate(capture, match_photographs=False), separate(capture)
for true, found in zip(TURNS_DEG, result.matching.motions.rotations_deg, strict=True):
    print(f"turned by {true:5.2f} degrees; found {found:5.2f}")
for name, separation in {"as they are": as_they_are, "put back": result}.items():
    names = ", ".join(warning.name for warning in separation.diagnostics.warnings) or "none"
    print(f"{name:12} incidence {separation.scene.incidence_deg:5.1f} degrees (60 is true), warnings: {names}")

aligned = align(capture)
print("with align: frame", capture.shape[1:], "->", aligned.shape[1:], "which all photographs show")

# %%
fig, axes = plt.subplots(2, 2, figsize=(8, 8.4), layout="constrained")
pictures = {
    "transmission, as they are": as_they_are.transmission,
    "reflection, as they are": as_they_are.reflection,
    "transmission, put back": result.transmission,
    "reflection, put back": result.reflection,
}
for axis, (title, picture) in zip(axes.flat, pictures.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
