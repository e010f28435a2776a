"""What a pane reflects, by polarization."""

import matplotlib.pyplot as plt
import numpy as np

N = 1.5
theta = np.radians(np.linspace(0, 89.9, 500))
theta_t = np.arcsin(np.sin(theta) / N)
r_s = (np.cos(theta) - N * np.cos(theta_t)) / (np.cos(theta) + N * np.cos(theta_t))
r_p = (N * np.cos(theta) - np.cos(theta_t)) / (N * np.cos(theta) + np.cos(theta_t))
# All bounces in place.
pane_s, pane_p = (2 * r**2 / (1 + r**2) for r in (r_s, r_p))

fig, axis = plt.subplots(figsize=(7.5, 4.2))
degrees = np.degrees(theta)
axis.plot(degrees, pane_s, label="a pane, perpendicular", color="tab:blue")
axis.plot(degrees, pane_p, label="a pane, parallel", color="tab:orange")
axis.plot(degrees, r_s**2, "--", label="one surface, perpendicular", color="tab:blue")
axis.plot(degrees, r_p**2, "--", label="one surface, parallel", color="tab:orange")
axis.plot(degrees, pane_s - pane_p, ":", label="difference: what separates", color="black")
axis.axvline(np.degrees(np.arctan(N)), color="grey", linewidth=0.8)
axis.text(np.degrees(np.arctan(N)) + 0.8, 0.93, "Brewster's angle")
axis.set(xlabel="incidence in degrees", ylabel="share of the light that is reflected", xlim=(0, 90), ylim=(0, 1))
axis.legend(loc="upper left")
