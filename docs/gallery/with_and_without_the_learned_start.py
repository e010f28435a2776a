"""
With and without the learned start
==================================

The solve starts from a closed form. Networks improve that start, and their layers tell better what is expected in each
place; ``keep_start`` pulls the layers back to the start once the solve has ended. This needs the extra ``torch``. All
ways get the same photographs and are told the pane, so that the start alone makes the difference.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import chelsea, coffee

from polaropt import SceneParameters, initializers, separate, simulate

for start in initializers():
    print(f"{start.name:12} {'installed' if start.installed else 'not installed':14} {start.sentence}")

# %%
# Two photographs, at three incidences
# ------------------------------------
# PSNR in dB, 16 px at the border left out. The networks were not trained on these two photographs; what they gain
# in the mean over others stands in :doc:`/results`.

transmission, reflection = coffee()[100:292, 150:342] / 255, chelsea()[40:232, 100:292] / 255


def psnr(layer, truth):
    inner = np.s_[16:-16, 16:-16]
    return -10 * np.log10(np.mean((layer[inner] - truth[inner]) ** 2))


STARTS = {"closed-form": 0.0, "learned": 0.0, "learned, half kept": 0.5}
results = {}
for incidence in (20, 60, 80):
    pane = SceneParameters(incidence, azimuth_deg=25.0, ghost_shift=4.0)
    capture = simulate(transmission, reflection, pane, noise=0.01)
    for start, share in STARTS.items():
        result = separate(capture, pane, init=start.split(",")[0], keep_start=share)
        results[incidence, start] = result
        t, r = psnr(result.transmission, transmission), psnr(result.reflection, reflection)
        evaluations, seconds = result.solver.n_evaluations, sum(result.seconds.values())
        print(f"{incidence} deg  {start:18} T {t:5.2f}  R {r:5.2f} dB  {evaluations:3} evaluations  {seconds:.1f} s")

# %%
# What they differ in
# -------------------
# Reflections at 20 degrees: their detail drowns in the noise there. What the networks fill in is likely, and the solve
# takes most of it back unless the start is kept; the maps of what the photographs tell (``result.reflection_known``)
# hardly change with the start.

fig, axes = plt.subplots(1, 4, figsize=(14, 4.0), layout="constrained")
shown = {"truth": reflection, **{f"start {start}": results[20, start].reflection for start in STARTS}}
for axis, (title, picture) in zip(axes, shown.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
