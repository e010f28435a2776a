"""
Look through two panes
======================

Double glazing is two panes, one behind the other. Each shows double images of its own, and those between the panes lie
farther apart. Where they show, polaropt finds the number of panes by itself.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
window = SceneParameters(60.0, 20.0, ghost_shift=3.0, n_panes=2, gap_shift=11.0, gap_azimuth_deg=24.0)
capture = simulate(transmission, reflection, window, noise=0.003)

# %%
# With the number of panes open, and with one pane told
# -----------------------------------------------------
# Taken for one pane, two look like one at a steeper angle.

found = separate(capture)
for_one = separate(capture, SceneParameters(None, None, None, n_panes=1))
for name, result in {"left open": found, "told as one": for_one}.items():
    scene = result.scene
    print(f"{name:12} panes {scene.n_panes}, incidence {scene.incidence_deg:.1f} degrees (60 is true)")
    print(f"{'':12} warnings: {', '.join(warning.name for warning in result.diagnostics.warnings) or 'none'}")

# %%
fig, axes = plt.subplots(2, 3, figsize=(11, 7.6), layout="constrained")
rows = (
    ("photograph", capture.stokes[0].transpose(1, 2, 0)),
    ("transmission, panes found", found.transmission),
    ("reflection, panes found", found.reflection),
    ("truth: reflection", reflection),
    ("transmission, taken for one pane", for_one.transmission),
    ("reflection, taken for one pane", for_one.reflection),
)
for axis, (title, picture) in zip(axes.flat, rows, strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
