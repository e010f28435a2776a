"""
With and without the learned start
==================================

The solve starts from a closed form. Networks can improve that start; where the photographs leave a layer open, the
solve then keeps what they say. This needs the extra ``torch``. Both ways get the same photographs and are told the
pane, so that the start alone makes the difference.
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
# PSNR in dB, 16 px at the border left out. The networks were trained on photographs inside scikit-image, these two
# among them: on others they gain less, see :doc:`/results`.

transmission, reflection = coffee()[100:292, 150:342] / 255, chelsea()[40:232, 100:292] / 255


def psnr(layer, truth):
    inner = np.s_[16:-16, 16:-16]
    return -10 * np.log10(np.mean((layer[inner] - truth[inner]) ** 2))


STARTS = ("closed-form", "learned")
results = {}
for incidence in (20, 60, 80):
    pane = SceneParameters(incidence, azimuth_deg=25.0, ghost_shift=4.0)
    capture = simulate(transmission, reflection, pane, noise=0.01)
    for start in STARTS:
        result = separate(capture, pane, init=start)
        results[incidence, start] = result
        t, r = psnr(result.transmission, transmission), psnr(result.reflection, reflection)
        evaluations, seconds = result.solver.n_evaluations, sum(result.seconds.values())
        print(f"{incidence} deg  {start:12} T {t:5.2f}  R {r:5.2f} dB  {evaluations:3} evaluations  {seconds:.1f} s")

# %%
# What they differ in
# -------------------
# Reflections at 20 degrees: their detail drowns in the noise there. The networks fill in what is likely, and the maps
# of what the photographs tell (``result.reflection_known``) do not change with the start.

fig, axes = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
shown = {"truth": reflection, **{f"start {start}": results[20, start].reflection for start in STARTS}}
for axis, (title, picture) in zip(axes, shown.items(), strict=True):
    axis.imshow(np.clip(picture, 0, 1))
    axis.set(title=title, xticks=[], yticks=[])
