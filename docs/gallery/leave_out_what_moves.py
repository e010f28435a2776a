"""
Leave out what moves between the photographs
============================================

At a still pixel ``I0 + I90 = I45 + I135``, whatever the scene. Where that fails something moved. It is left out
when the pane is estimated, and from the layers where the photographs that did not see it tell both of them.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import Capture, SceneParameters, separate, simulate
from polaropt.simulation import psnr_db

scenes = transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
pane = SceneParameters(60.0, 20.0, 4.0)

# %%
# A bright thing of 40 px walks 50 px to the right from photograph to photograph, behind the glass.

photographs, passed_by = [], np.zeros((256, 256), bool)
for k in range(4):
    behind = transmission.copy()
    place = slice(130, 170), slice(10 + 50 * k, 50 + 50 * k)
    behind[place], passed_by[place] = (0.9, 0.7, 0.2), True
    photographs.append(np.moveaxis(simulate(behind, reflection, pane, seed=k).intensities[k], 0, -1))
capture = Capture(photographs)

# %%
result = separate(capture)
print("warnings:", ", ".join(warning.name for warning in result.diagnostics.warnings))
print(f"moving: {100 * result.diagnostics.moving:.1f} % of the frame")
print(f"incidence {result.scene.incidence_deg:.1f} degrees (60 is true)")
for name, layer, truth in zip(
    ("transmission", "reflection"), (result.transmission, result.reflection), scenes, strict=True
):
    inside, beside = (psnr_db(layer[where], truth[where]) for where in (passed_by, ~passed_by))
    print(f"{name}: {inside:.1f} dB where it passed by, {beside:.1f} dB beside")

# %%
fig, axes = plt.subplots(1, 4, figsize=(14, 3.9), layout="constrained")
pictures = {
    "mean of the photographs": 2 * np.mean(photographs, axis=0),
    "where something moves": result.moving,
    "transmission": result.transmission,
    "reflection": result.reflection,
}
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1), cmap="gray")
    axis.set(title=title, xticks=[], yticks=[])
