"""
Compare solvers on the same objective
=====================================

All solvers minimize the same objective in the same whitened coordinates. They come to the same layers, at different
cost.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, StoppingRule, separate, simulate

transmission, reflection = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
pane = SceneParameters(60.0, 20.0, 4.0)
capture = simulate(transmission, reflection, pane)
rule = StoppingRule(relative_change=5e-5)

# %%
# From the plain intensity, to see them work; the closed form, the usual start, leaves little to do.

SOLVERS = ("lbfgs", "scipy", "nlopt")
results = {name: separate(capture, pane, solver=name, init="cold", stopping=rule) for name in SOLVERS}
least = min(result.solver.value for result in results.values())
for name, result in results.items():
    difference = np.sqrt(np.mean((result.layers - results["lbfgs"].layers) ** 2))
    print(f"{name:6} {result.solver.n_evaluations:3} evaluations. {result.solver.status.value}")
    print(f"       its layers differ from those of lbfgs by {difference:.4f} (root mean square, white = 1)")

# %%
# Each evaluation's distance from the least value that was found.

fig, axis = plt.subplots(figsize=(7, 4), layout="constrained")
for name, result in results.items():
    values = np.minimum.accumulate([point.value for point in result.solver.trace])
    numbers = [point.n_evaluations for point in result.solver.trace]
    axis.semilogy(numbers, (values - least) / (values[0] - least) + 1e-9, label=name)
axis.set(xlabel="evaluations of objective and gradient", ylabel="distance from the minimum", ylim=(1e-7, 1.5))
_ = axis.legend()
