"""
Find where the polarizer's angles start
=======================================

A filter's mark may stand anywhere: its steps of 45 degrees are known, their start is not. The pane's double images
lie along the plane of incidence, and that tells it.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, find_start_angle, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
START_DEG = 25.0
turned = tuple(START_DEG + angle for angle in (0, 45, 90, 135))
taken = simulate(transmission, reflection, SceneParameters(60.0, 20.0, 6.0), angles_deg=turned)
# What the photographer wrote down:
capture = taken.replace(angles_deg=(0, 45, 90, 135))

# %%
found = find_start_angle(capture)
print(f"start found at {found.origin.start_deg:.1f} degrees ({START_DEG:.0f} is true)")

# %%
# With the angles as written down, and with the start found
# ---------------------------------------------------------

as_written, result = separate(capture), separate(found)
for name, separation in {"as written": as_written, "start found": result}.items():
    names = ", ".join(warning.name for warning in separation.diagnostics.warnings) or "none"
    print(f"{name:12} azimuth {separation.scene.azimuth_deg:6.1f} degrees (20 is true), warnings: {names}")

fig, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
pictures = {
    "truth: reflection": reflection,
    "reflection, angles as written": as_written.reflection,
    "reflection, start found": result.reflection,
}
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
