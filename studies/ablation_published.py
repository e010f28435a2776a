"""The source paper's ablation of its losses (Table 3 and Fig. 7), PSNR in dB / SSIM of the transmission.

They belong to that paper's own photographs, which are not published: only differences between its columns can be set
beside ours, and those with care.
"""

from __future__ import annotations

from studies.ablation_records import ALL, PIXELS, PLAIN

TABLE_3 = {
    ALL: (28.3, 0.889),
    "without perceptual": (24.1, 0.797),
    "without pse": (26.4, 0.842),
    "without edge_independence": (26.6, 0.809),
    "without adversarial": (28.1, 0.878),
}
FIGURE_7 = {
    "without pse": "k: significant artifacts in the reflection",
    "without edge_independence": "l: overlapping gradients in the transmission",
    "without adversarial": "m: a noticeable black spot",
    PIXELS: "n: over-smoothed",
    PLAIN: "o: poor, lack of local details",
}
"""What the paper says of its pictures; no figures belong to them."""
