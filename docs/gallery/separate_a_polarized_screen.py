"""
Separate a polarized screen behind the glass
============================================

The light of a screen is polarized before it meets the glass, and so is the blue sky that glass may mirror. One
degree and one angle of polarization for each layer are found with the pane.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
pane = SceneParameters(60.0, 20.0, 5.0, transmission_polarization=(0.6, 80.0))
capture = simulate(transmission, reflection, pane)

# %%
# The ladder of scene models
# --------------------------
# The lowest rung that leaves no polarized light unexplained is taken; the result tells which were looked at.
# ``POLARIZED_SOURCE`` asks to look at the layers, ``SCENE_UNCERTAIN`` says that other panes cannot be excluded.

result = separate(capture)
for rung in result.tried:
    print(f"{rung.rung:12} {'taken' if rung.taken else 'left'}")
dolp, aolp = result.scene.transmission_polarization
print(f"light from behind: degree {dolp:.2f} (0.60 is true), angle {aolp:.0f} degrees (80 is true)")
print("warnings:", ", ".join(warning.name for warning in result.diagnostics.warnings) or "none")

# %%
# Without that rung nearly all light is taken for mirrored, and a warning says so.

unpolarized = separate(capture, model="ghosts")
print("warnings:", ", ".join(warning.name for warning in unpolarized.diagnostics.warnings) or "none")

fig, axes = plt.subplots(2, 2, figsize=(8, 8.4), layout="constrained")
pictures = {
    "transmission": result.transmission,
    "reflection": result.reflection,
    "transmission, taken for unpolarized": unpolarized.transmission,
    "reflection, taken for unpolarized": unpolarized.reflection,
}
for axis, (title, picture) in zip(axes.flat, pictures.items(), strict=True):
    axis.imshow(np.clip(picture / np.quantile(picture, 0.99), 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
