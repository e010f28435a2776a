"""``polaropt demo``: an example from start to end, without any file of one's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from polaropt.cli.command import say, say_json, watched
from polaropt.cli.options import AsJson
from polaropt.progress import Stages

if TYPE_CHECKING:
    from polaropt.capture import Capture
    from polaropt.cli.example import Example, Score
    from polaropt.optics import Field


MOSAIC, OF_MOSAIC = "mosaic.png", "mosaic"


@dataclass(frozen=True)
class DemoOptions:
    """Where the demo's files go and what is said."""

    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the files; made if it does not exist."),
    ] = Path("demo-output")
    json: AsJson = False


def demo_command(options: DemoOptions) -> None:
    """Show the whole thing on an example: photograph, separate, compare with the truth.

    Two photographs that ship inside scikit-image are put behind and before a simulated pane and photographed through a
    polarizer at four angles. The four files are then separated, with nothing known of the pane. Then the same as one
    raw mosaic of a colour polarization camera.
    """
    from polaropt.capture import result_folder
    from polaropt.kernels import compile_kernels
    from polaropt.reporting import RESULT_FILES

    with watched(not options.json) as stages:
        compile_kernels(wait=False)
        with result_folder(options.output, RESULT_FILES) as work:
            part = _begun(stages, 0.0, _FIRST_DONE)
            example, report, scores = _run(work, options.output, part)
            stages.include(part.seconds, part.cpu_seconds)
        folder = options.output / OF_MOSAIC
        with result_folder(folder, RESULT_FILES) as work:
            part = _begun(stages, _FIRST_DONE, 1.0)
            of_mosaic = _run_mosaic(work, folder, part)
            stages.include(part.seconds, part.cpu_seconds)
        stages.end()
    if options.json:
        mosaic = {"scores": _as_dicts(of_mosaic)}
        say_json({"output": str(options.output), "scores": _as_dicts(scores), "mosaic": mosaic, **report})
    else:
        say(*_sentences(example, report, (scores, of_mosaic), stages.seconds, options.output))


# Fraction of the demo at which the four photographs are done, and of each part at which its example is made and
# separated; set by hand.
_FIRST_DONE, _MADE, _SEPARATED = 0.4, 0.1, 0.75


def _begun(whole: Stages, start: float, stop: float) -> Stages:
    """The stages of one example."""
    whole.begin("Comparing", start)
    return Stages(whole.part(start, stop))


def _run(work: Path, folder: Path, stages: Stages) -> tuple[Example, dict[str, Any], tuple[Score, Score]]:
    from polaropt.capture import read_capture, write_capture, write_picture, write_tiff
    from polaropt.cli.example import comparison, make_example, scores
    from polaropt.optics import SceneParameters
    from polaropt.reporting import COMPARISON, TRUE_LAYERS, write_separation
    from polaropt.separation import separate

    stages.begin("Simulating", 0.0)
    example = make_example()
    # From the files on, as with one's own photographs.
    capture = _in_folder(read_capture(write_capture(example.capture, work / "capture.png")), folder)
    for name, layer in zip(TRUE_LAYERS, (example.transmission, example.reflection), strict=True):
        write_tiff(work / name, layer)
    unknown = SceneParameters(None, None, None)
    result = separate(capture, unknown, progress=stages.part(_MADE, _SEPARATED))
    stages.include(result.seconds, result.cpu_seconds)
    report = write_separation(work, result, capture, stages=stages, reached=_SEPARATED)
    layers = (result.transmission, result.reflection)
    write_picture(work / COMPARISON, comparison(example, *layers))
    rated = scores(example, *layers)
    (work / "scores.json").write_text(json.dumps(_as_dicts(rated), indent=2) + "\n", encoding="utf-8")
    return example, report, rated


def _in_folder(capture: Capture, folder: Path) -> Capture:
    """The capture with its files where they will be, instead of where they are until all is done."""
    assert capture.origin is not None
    return capture.with_origin(files=tuple(str(folder / Path(name).name) for name in capture.origin.files))


def _run_mosaic(work: Path, folder: Path, stages: Stages) -> tuple[Score, Score]:
    import numpy as np

    from polaropt.capture import WHITE_16, read_capture, write_picture, write_png, write_tiff
    from polaropt.cli.example import SCENE, Example, comparison, make_mosaic, scores
    from polaropt.reporting import COMPARISON, TRUE_LAYERS, write_separation
    from polaropt.separation import separate

    stages.begin("Simulating", 0.0)
    raw, transmission, reflection = make_mosaic()
    write_png(work / MOSAIC, np.round(np.clip(raw, 0, 1) * WHITE_16).astype(np.uint16))
    capture = _in_folder(read_capture(work / MOSAIC), folder)
    result = separate(capture, progress=stages.part(_MADE, _SEPARATED))
    stages.include(result.seconds, result.cpu_seconds)
    write_separation(work, result, capture, stages=stages, reached=_SEPARATED)
    for name, layer in zip(TRUE_LAYERS, (transmission, reflection), strict=True):
        write_tiff(work / name, layer)
    example, layers = Example(capture, transmission, reflection, SCENE), (result.transmission, result.reflection)
    write_picture(work / COMPARISON, comparison(example, *layers))
    return scores(example, *layers)


def _as_dicts(scores: tuple[Score, Score]) -> list[dict[str, Any]]:
    return [vars(score) for score in scores]


def _sentences(
    example: Example,
    report: dict[str, Any],
    scores: tuple[tuple[Score, Score], tuple[Score, Score]],
    seconds: Mapping[str, float],
    folder: Path,
) -> list[str]:
    from polaropt.optics import FIELDS, SEARCHED
    from polaropt.reporting import COMPARISON, marked, report_attention, time_sentence

    def row(field: Field) -> str:
        (component,) = field.components
        found, true = report["scene"][field.name], getattr(example.scene, field.name)
        return f"  {field.label:13} {found:9.{component.digits}f} {true:9.{component.digits}f} {component.unit}"

    lines = [
        f"Pane            {'found':>9} {'true':>9}",
        *(row(field) for field in FIELDS if field.name in SEARCHED),
        f"PSNR            {'photograph':>10} {'separated':>10}",
        *map(_score_line, scores[0]),
        "PSNR, from one raw mosaic at the sensor's resolution",
        *map(_score_line, scores[1]),
        time_sentence(seconds),
        *marked(report_attention(report)),
        "",
        "Look at:",
        f"  {folder / COMPARISON}  photographs, separated layers and truth",
        f"  {folder / 'transmission.png'}  what is behind the glass",
        f"  {folder / 'reflection.png'}    what the glass mirrors",
        f"  {folder / 'report.html'}       all of it as a page, for a browser",
        f"  {folder / 'report.json'}       how it was found",
        f"  {folder / OF_MOSAIC}  the same from the raw mosaic",
        "The same from the files:",
        f"  polaropt separate {folder / 'capture_*.png'} -o my-output",
        f"  polaropt separate {folder / OF_MOSAIC / MOSAIC} -o my-output-of-mosaic",
    ]
    return lines


def _score_line(score: Score) -> str:
    return f"  {score.layer:13} {score.doing_nothing_db:8.1f} {score.separated_db:10.1f} dB"
