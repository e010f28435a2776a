"""``polaropt separate``: two layers out of the photographs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from polaropt.cli.command import DOUBTFUL, say, say_json, say_warnings, watched
from polaropt.cli.options import CaptureOptions, LadderOptions, PaneOptions
from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.solving import Weights
    from solvers.base import StoppingRule


_SOLVING = "Solving"
# Fractions of the progress at which the photographs are read, or aligned, and separated; set by hand.
_READ, _ALIGNED, _SEPARATED = 0.06, 0.3, 0.75


@dataclass(frozen=True)
class SolveOptions:
    """What is minimized, by what, and for how long."""

    solver: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Optimizer that refines the layers: lbfgs, scipy, nlopt, casadi or torch.",
            rich_help_panel=_SOLVING,
        ),
    ] = "lbfgs"
    device: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Where torch works the layers out, of lbfgs or torch: cuda, or cpu. Default: compiled passes.",
            rich_help_panel=_SOLVING,
        ),
    ] = None
    init: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Layers that the optimizer starts from: closed-form, learned, per-pixel or cold.",
            rich_help_panel=_SOLVING,
        ),
    ] = "closed-form"
    keep_start: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            min=0.0,
            max=1.0,
            help="Pull the layers back to the start by this share of the way, 0 to 1, once the optimizer has ended.",
            rich_help_panel=_SOLVING,
        ),
    ] = 0.0
    weights: Annotated[
        str,
        typer.Option(
            metavar="TERM=FACTOR,...",
            help="Factors on the weights that follow from the noise, 0 for off; such as "
            "edge_independence=0,gradient_sparsity=2. Terms: misfit, edge_independence, gradient_sparsity, "
            "nonnegativity, natural_image.",
            rich_help_panel=_SOLVING,
            show_default=False,
        ),
    ] = ""
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            metavar="",
            help="Let single pixels disagree with the pane (moving leaves, defects).",
            rich_help_panel=_SOLVING,
        ),
    ] = False
    max_evaluations: Annotated[
        int | None,
        typer.Option(metavar="N", help="Stop after so many evaluations of the objective.", rich_help_panel=_SOLVING),
    ] = None
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Stop when two iterations in a row lower the objective by less than this share of it.",
            rich_help_panel=_SOLVING,
        ),
    ] = None

    def stopping(self) -> StoppingRule:
        """When to stop."""
        from solvers.base import StoppingRule

        chosen: dict[str, Any] = {"max_evaluations": self.max_evaluations, "relative_change": self.tolerance}
        for option, name in (("--max-evaluations", "max_evaluations"), ("--tolerance", "relative_change")):
            try:
                if chosen[name] is not None:
                    StoppingRule(**{name: chosen[name]})
            except ValueError as error:
                raise InputError(f"{option}: {error}") from None
        return StoppingRule(**{name: value for name, value in chosen.items() if value is not None})

    def check_names(self) -> None:
        """InputError that lists the solvers or starts, where one does not exist."""
        from polaropt.solving import check_device, check_start, start_names
        from solvers.base import MissingPackage
        from solvers.registry import ready_solver, solver_names

        for option, name, known in (("--solver", self.solver, solver_names()), ("--init", self.init, start_names())):
            if name not in known:
                raise InputError(f"{option} {name!r} does not exist; choose one of: {', '.join(known)}")
        check_start(self.init)
        try:
            ready_solver(self.solver)
        except MissingPackage as error:
            raise InputError(f"--solver: {error}") from None
        if self.device is not None:
            try:
                check_device(self.device, self.solver)
            except InputError as error:
                raise InputError(f"--{error}") from None


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Where results go and how they are told."""

    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Folder for the results; made if it does not exist.",
            show_default=False,
        ),
    ]
    json: Annotated[
        bool, typer.Option("--json", metavar="", help="Print the report as one JSON object, for machines.")
    ] = False
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", metavar="", help="Print nothing but errors and warnings of the result.")
    ] = False


@dataclass(frozen=True, kw_only=True)
class FolderOptions(OutputOptions):
    """Where the files of separations go, and which are written."""

    uncertainty: Annotated[
        bool,
        typer.Option(
            "--uncertainty/--no-uncertainty",
            metavar="",
            help="Find the standard errors of the layers and write their maps; without them it is done sooner.",
        ),
    ] = True
    write: Annotated[
        Literal["layers", "all"],
        typer.Option(
            metavar="WHAT",
            help="layers: the two layers and report.json alone; all: error maps, page and pictures as well.",
        ),
    ] = "all"
    strict: Annotated[
        bool, typer.Option("--strict", metavar="", help="End with exit code 1 where the result is warned of.")
    ] = False


def separate_command(
    capture: CaptureOptions, pane: PaneOptions, ladder: LadderOptions, solving: SolveOptions, folder: FolderOptions
) -> None:
    """Separate what is behind the glass (transmission) from what the glass mirrors (reflection).

    Nothing needs to be known: incidence, azimuth and double images are estimated unless given, and with them the number
    of panes and the tint where they show.

    Writes into the folder: transmission.tiff and reflection.tiff (linear, 32-bit floating point), transmission.png and
    reflection.png (to look at: sRGB, each with the exposure that report.json tells), how well they are known
    (transmission_error.tiff, reflection_error.tiff, reflection_known.tiff, uncertainty.png), report.json and
    report.html (all of it as a page, for a browser); moving.png, where something moves between the photographs, and
    unglazed.png, where no glass is seen. Files of other names stay. A run that fails or is interrupted leaves the
    folder as it was.
    """
    from polaropt.capture import result_folder
    from polaropt.reporting import RESULT_FILES

    chosen = separating(pane, ladder, solving)  # its checks, before anything is read
    capture.check(pane)
    with watched(not (folder.json or folder.quiet)) as stages, result_folder(folder.output, RESULT_FILES) as work:
        # Imported after reading, so that an error in the files is told at once.
        read_until = _ALIGNED if capture.align else _READ
        photographs = capture.read(stages, read_until)
        from polaropt.reporting import report_attention, report_sentences, write_separation
        from polaropt.separation import separate

        # An earlier scene is scaled to the photographs.
        chosen["scene"] = pane.scene(photographs)
        result = separate(photographs, **chosen, progress=stages.part(read_until, _SEPARATED))
        stages.include(result.seconds, result.cpu_seconds)
        report = write_separation(
            work,
            result,
            photographs,
            stages=stages,
            reached=_SEPARATED,
            uncertainty=folder.uncertainty,
            layers_only=folder.write == "layers",
        )
    if folder.json:
        say_json({"output": str(folder.output), **report})
    elif not folder.quiet:
        say(*capture.preparation(photographs), *report_sentences(report, folder.output))
    doubts = [*capture.contradictions(), *report_attention(report)]
    if folder.quiet and not folder.json:
        say_warnings(*doubts)
    if folder.strict and doubts:
        raise typer.Exit(DOUBTFUL)


def separating(pane: PaneOptions, ladder: LadderOptions, solving: SolveOptions) -> dict[str, Any]:
    """What `separate` takes beside the capture; InputError where options are wrong or contradict each other."""
    chosen: dict[str, Any] = {
        "scene": pane.scene(),
        "weights": parse_weights(solving.weights),
        "stopping": solving.stopping(),
        "solver": solving.solver,
        "init": solving.init,
        "keep_start": solving.keep_start,
        "model": ladder.model,
        "thickness_px": pane.thickness_px,
        "thickness_kind": pane.thickness_kind,
        "robust": solving.robust,
        "device": solving.device,
        "index_known": pane.index is not None,
        "match_photographs": ladder.match,
        "leave_out_unglazed": ladder.unglazed,
    }
    ladder.check(pane, chosen["scene"])
    solving.check_names()
    return chosen


def parse_weights(text: str) -> Weights:
    """``name=factor,name=factor`` to `Weights`.

    Raises
    ------
    InputError
        A term that does not exist, or no number.
    """
    from polaropt.solving import Weights, plugged_names, term_names

    names, others = term_names(), tuple(plugged_names())
    chosen: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, factor = part.partition("=")
        if name.strip() not in (*names, *others):
            raise InputError(
                f"--weights: there is no term {name.strip()!r}; choose from {', '.join((*names, *others))}"
            )
        chosen[name.strip()] = _factor(name.strip(), factor)
    own = {name: factor for name, factor in chosen.items() if name in names}
    return Weights(**own, plugged=tuple((name, factor) for name, factor in chosen.items() if name not in names))


def _factor(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--weights: {name} is {text!r}; give a factor, 0 for off, such as {name}=2") from None
