"""
Simulate a capture
==================

The engine that separates also simulates: photographs of two known layers behind any pane that it can describe, and the
double images of each layer alone.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import PSE, SceneParameters, ghost_step, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
ANGLES_DEG = (0, 45, 90, 135)

# %%
# A pane 10 px thick, at six incidences
# -------------------------------------
# The steeper, the brighter the mirrored scene; near Brewster's angle (56 degrees for an index of 1.5) it is polarized
# most.

fig, axes = plt.subplots(2, 6, figsize=(15, 5.6), layout="constrained")
for (above, below), incidence in zip(axes.T, (10, 40, 60, 70, 80, 85), strict=True):
    pane = SceneParameters(incidence, 0.0, ghost_step(incidence, 1.5, thickness_px=10.0))
    capture = simulate(transmission, reflection, pane)
    s0, s1, s2 = capture.stokes.mean(axis=1)
    above.imshow(np.clip(np.moveaxis(capture.stokes[0], 0, -1), 0, 1))
    above.set(title=f"{incidence} degrees", xticks=[], yticks=[])
    shown = below.imshow(np.hypot(s1, s2) / s0, vmin=0, vmax=0.8, cmap="magma")
    below.set(xticks=[], yticks=[])
axes[0, 0].set_ylabel("intensity")
axes[1, 0].set_ylabel("degree of polarization")
_ = fig.colorbar(shown, ax=axes, shrink=0.8)
# %%
# The parts of one photograph
# ---------------------------
# ``PSE.components`` gives what each layer contributes, double images and all.

engine = PSE(SceneParameters(60.0, 0.0, 8.0), ANGLES_DEG)
layers = np.stack([np.moveaxis(layer, -1, 0) for layer in (transmission, reflection)])
of_transmission, of_reflection = np.moveaxis(engine.components(layers)[:, 2], 1, -1)
print("ghosts that carry light:", engine.n_ghosts)

fig, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
pictures = {
    "polarizer at 90 degrees": of_transmission + of_reflection,
    "from behind the glass": of_transmission,
    "mirrored, four times as bright": 4 * of_reflection,
}
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(2 * picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
