"""
See what noise costs, and what the photographs do not tell
==========================================================

Polarization is a small difference of photographs: noise costs the reflection first. The result says in every pixel
how exact the layers are, and how much of the reflection's detail the photographs tell at all.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
pane = SceneParameters(45.0, 20.0, 4.0)
NOISES = (0.002, 0.01, 0.04)
results = {noise: separate(simulate(transmission, reflection, pane, noise=noise)) for noise in NOISES}

# %%
# The stated error against the true one, in the mean over the frame (root of the mean square, white = 1), and the
# share of the reflection's fine detail that is not told. With the strongest noise it cannot be told which layer is
# which: nothing is separated, and the warning says so.

truth = np.stack([np.moveaxis(layer, -1, 0) for layer in (transmission, reflection)])
inner = np.s_[..., 16:-16, 16:-16]
for noise, result in results.items():
    true = np.sqrt(np.mean((result.layers - truth)[inner] ** 2, axis=(1, 2, 3)))
    stated = np.sqrt(np.mean(result.uncertainty[inner] ** 2, axis=(1, 2, 3)))
    print(f"noise {noise:5.3f}: transmission {true[0]:.4f} (stated {stated[0]:.4f}),", end=" ")
    print(f"reflection {true[1]:.4f} (stated {stated[1]:.4f}), not told {result.diagnostics.reflection_unknown:.0%}")
    print("            ", ", ".join(warning.name for warning in result.diagnostics.warnings) or "no warnings")

# %%
fig, axes = plt.subplots(3, 3, figsize=(11, 11.4), layout="constrained")
for row, (noise, result) in zip(axes, results.items(), strict=True):
    pictures = {
        f"transmission, noise {noise:.1%}": (result.transmission, {}),
        "reflection": (result.reflection, {}),
        "known share of its detail": (result.reflection_known, {"vmin": 0, "vmax": 1}),
    }
    for axis, (title, (picture, limits)) in zip(row, pictures.items(), strict=True):
        axis.imshow(np.clip(picture, 0, 1), **limits)
        axis.set(title=title, xticks=[], yticks=[])
