"""Figures that the source paper prints for itself and for its peers, PSNR in dB / SSIM of the transmission.

They belong to that paper's own photographs, which are not published: they say how hard its scenes were, and cannot be
set against ours number by number.
"""

from __future__ import annotations

from dataclasses import dataclass

Figures = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class PublishedTable:
    """A table as printed: its scenes, and each method's PSNR in dB and SSIM on them."""

    title: str
    scenes: tuple[str, ...]
    methods: dict[str, Figures]


TABLES = (
    PublishedTable(
        "Table 1, against methods for one photograph",
        ("eccv", "bird", "violin", "pyramid", "wood", "DNA"),
        {
            "ERRNet": ((19.25, 0.823), (24.36, 0.843), (26.77, 0.885), (21.67, 0.689), (11.80, 0.650), (20.66, 0.314)),
            "Wen et al.": ((22.77, 0.791), (23.40, 0.823), (24.14, 0.840), (19.37, 0.699), (11.49, 0.620),
                           (18.87, 0.321)),
            "Zhang et al.": ((18.83, 0.931), (25.11, 0.854), (24.33, 0.879), (19.38, 0.660), (16.89, 0.690),
                             (20.79, 0.290)),
            "the paper's method": ((26.14, 0.83), (26.78, 0.802), (30.34, 0.877), (27.9, 0.824), (26.79, 0.79),
                                   (28.72, 0.788)),
        },
    ),
    PublishedTable(
        "Table 2, against methods for polarized photographs",
        ("violin", "paint", "library", "tea"),
        {
            "Lyu et al.": ((10.56, 0.519), (10.31, 0.267), (11.10, 0.425), (10.33, 0.450)),
            "ReflectNet": ((14.16, 0.458), (13.28, 0.504), (14.09, 0.592), (12.10, 0.479)),
            "the paper's method": ((31.08, 0.911), (25.73, 0.817), (29.16, 0.907), (22.91, 0.696)),
        },
    ),
)  # fmt: skip
