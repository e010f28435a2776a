"""The studies by name, what each asks, and its command for one run of all."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec


@dataclass(frozen=True)
class Study:
    """A module of this package, and the question it answers.

    Attributes
    ----------
    name, question : str
    timed : bool
        Whether seconds are what it is about: then nothing runs beside it.
    inputs : tuple of str
        Options, each with a folder or file, that tell it what to work on and that not all studies know.
    extras : tuple of str
        Extras of polaropt that it needs.
    """

    name: str
    question: str
    timed: bool = False
    inputs: tuple[str, ...] = ()
    extras: tuple[str, ...] = ("studies",)

    def missing(self) -> dict[str, list[str]]:
        """Packages that are not installed, by the extra that brings them."""
        lacking = {extra: [name for name in PACKAGES[extra] if find_spec(name) is None] for extra in self.extras}
        return {extra: names for extra, names in lacking.items() if names}


PACKAGES = {
    "studies": (
        "bokeh",
        "cryptography",
        "cv2",
        "dask",
        "distributed",
        "markdown_it",
        "matplotlib",
        "pandas",
        "polanalyser",
        "sklearn",
    ),
    "batch": ("cryptography", "dask", "distributed"),
    "torch": ("kornia", "safetensors", "torch"),
}
"""What the extras that a study may need bring, as it is imported."""
_NETWORKS = ("studies", "torch")

STUDIES = (
    Study("paper_protocol", "How good is a separation on the paper's six incidences, blind and with the scene known?"),
    Study("model_ladder", "Which scene model is taken on each family of scenes, and what does the choice cost?"),
    Study("stability", "How far may scenes leave the plain case, where do methods fail, and is it announced?"),
    Study("random_windows", "How good is a separation of any window, and is it announced where it is not?"),
    Study(
        "learned_init",
        "Where does a solve from the learned start win over other starts, and where does it not?",
        extras=_NETWORKS,
    ),
    Study("ablation", "What is each part of the separation worth?", extras=_NETWORKS),
    Study(
        "ablation_losses",
        "What is each term of the learned networks' loss worth, and how good are networks alone?",
        inputs=("--records", "--vgg19"),
        extras=_NETWORKS,
    ),
    Study(
        "peers",
        "How good is a separation against others' methods, and against the figures the paper prints?",
        inputs=("--layers",),
    ),
    Study(
        "mosaic",
        "How good are layers from one raw mosaic, at the resolution of the sensor, against four full photographs?",
        inputs=("--data",),
    ),
    Study("coverage", "Do the stated standard errors of the layers hold?"),
    Study("parameter_errors", "Do the stated standard errors of the scene's parameters hold?"),
    Study("shared_scene", "How much better do several captures tell their pane together?"),
    Study("real_captures", "What does a separation make of real captures and of measured layers?", inputs=("--data",)),
    Study(
        "speed_accuracy",
        "What do other solvers, starts, models and tolerances cost and gain against the defaults?",
        timed=True,
    ),
    Study(
        "many_captures",
        "What do many captures cost, and what do they ask of a cluster?",
        timed=True,
        extras=("studies", "batch"),
    ),
    Study(
        "sequences",
        "How fast are the frames of a film separated, how steady are their layers, and how good?",
        timed=True,
    ),
    Study(
        "benchmark",
        "How fast is the solver against others, at the same objective value?",
        timed=True,
        extras=_NETWORKS,
    ),
)
