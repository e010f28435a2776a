"""Edge independence over trial incidences, by means of blocks."""

import matplotlib.pyplot as plt
import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, simulate

TRUE_DEG = 30.0
pane = SceneParameters(TRUE_DEG, 0.0, 0.0)
layers = coffee()[60:316, 150:406] / 255, astronaut()[0:256, 110:366] / 255
s0, s1, _ = simulate(*layers, pane, noise=0.01).stokes.mean(axis=1)
parallel, perpendicular = (s0 + s1) / 2, (s0 - s1) / 2


def reflectances(degrees, n=1.5):
    theta = np.radians(degrees)
    theta_t = np.arcsin(np.sin(theta) / n)
    r_s = (np.cos(theta) - n * np.cos(theta_t)) / (np.cos(theta) + n * np.cos(theta_t))
    r_p = (n * np.cos(theta) - np.cos(theta_t)) / (n * np.cos(theta) + np.cos(theta_t))
    return tuple(2 * r**2 / (1 + r**2) for r in (r_p, r_s))


def shared_edges(degrees, side):
    p, s = reflectances(degrees)
    # The 2x2 system of each pixel: I = ((1 - R) t + R r) / 2.
    r = 2 * ((1 - s) * parallel - (1 - p) * perpendicular) / (p - s)
    t = 2 * (p * perpendicular - s * parallel) / (p - s)
    means = [layer.reshape(256 // side, side, 256 // side, side).mean(axis=(1, 3)) for layer in (t, r)]
    t_edges, r_edges = (np.hypot(*np.gradient(mean)) for mean in means)
    return (t_edges * r_edges).sum() / np.sqrt((t_edges**2).sum() * (r_edges**2).sum())


trial = np.arange(10, 76, 1.0)
fig, axis = plt.subplots(figsize=(7.5, 4))
for side in (1, 4, 8):
    axis.plot(
        trial,
        [shared_edges(degrees, side) for degrees in trial],
        label="every pixel" if side == 1 else f"means of {side}x{side} px",
    )
axis.axvline(TRUE_DEG, color="grey", linewidth=0.8)
axis.text(TRUE_DEG + 0.8, axis.get_ylim()[1] * 0.95, "true incidence", va="top")
axis.set(xlabel="trial incidence in degrees", ylabel="edges that both layers share")
axis.legend()
