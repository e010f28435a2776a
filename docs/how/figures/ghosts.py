"""Double images of both layers, as bright as a pane makes them."""

import matplotlib.pyplot as plt
import numpy as np

from polaropt import PSE, SceneParameters

fig, axes = plt.subplots(1, 3, figsize=(10, 3.4), sharey=True)
for axis, incidence in zip(axes, (40, 60, 80), strict=True):
    engine = PSE(SceneParameters(incidence, 0.0, 6.0), (0, 45, 90, 135))
    # Unpolarized light: the mean of both polarizations, (2, ghost + 1).
    images = engine.weights[..., :2].mean(axis=-1)[:, :6]
    places = np.arange(images.shape[1])
    axis.bar(places - 0.2, images[0], 0.38, label="transmission", color="tab:blue")
    axis.bar(places + 0.2, images[1], 0.38, label="reflection", color="tab:orange")
    axis.set(title=f"{incidence} degrees", xlabel="double image, in ghost steps", yscale="log", ylim=(1e-4, 1.2))
axes[0].set_ylabel("share of the layer's light")
axes[0].legend()
