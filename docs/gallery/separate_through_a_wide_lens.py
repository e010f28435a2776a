"""
Separate what a wide lens saw
=============================

A wide lens sees the pane at another angle in each pixel: incidence and azimuth change over the picture, and with
them how much is mirrored. The pane's tilt and the focal length follow from how the direction of polarization turns.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
# 45 degrees of view along 256 px.
focal_px = 128 / np.tan(np.radians(22.5))
capture = simulate(transmission, reflection, SceneParameters(55.0, 20.0, 0.0, focal_px=focal_px))

# %%
# Nothing is told, neither the pane nor the lens.

result = separate(capture)
scene, errors = result.scene, result.errors
print("model:", scene.rung)
print(f"incidence in the middle {scene.incidence_deg:.1f} +- {errors.incidence_deg:.1f} degrees (55 is true)")
print(f"focal length {scene.focal_px:.0f} px ({focal_px:.0f} is true)")

# %%
# The incidence in each pixel
# ---------------------------
# For the pixel's ray v and the pane's normal n the cosine of the incidence is n . v.

tilt, azimuth = np.radians(scene.incidence_deg), np.radians(scene.azimuth_deg)
x, y = np.meshgrid(np.arange(256) - 127.5, 127.5 - np.arange(256))
ray = np.stack([x / scene.focal_px, y / scene.focal_px, np.ones_like(x)])
normal = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
incidence = np.degrees(np.arccos(np.tensordot(normal, ray / np.linalg.norm(ray, axis=0), 1)))

fig, axes = plt.subplots(1, 4, figsize=(14, 3.8), layout="constrained")
pictures = {"photograph": np.moveaxis(capture.stokes[0], 0, -1), "transmission": result.transmission}
pictures |= {"reflection": result.reflection}
for axis, (title, picture) in zip(axes, pictures.items(), strict=False):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
shown = axes[3].imshow(incidence, cmap="viridis")
axes[3].set(title="incidence in degrees", xticks=[], yticks=[])
_ = fig.colorbar(shown, ax=axes[3], shrink=0.8)
