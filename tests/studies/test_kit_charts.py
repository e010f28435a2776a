"""Figures are files of one look, the same bytes for the same figure."""

from __future__ import annotations

import numpy as np

from studies.kit.charts import Fill, Style, crops, legend_below, new_figure, write_figures


def lines():
    figure = new_figure(4, 3)
    axis = figure.subplots()
    axis.plot([0, 1], [1, 2], label="a", **Style("black", "--", "o").line)
    axis.barh([0], [1], **Fill("white", "///").bar)
    legend_below(figure, *axis.get_legend_handles_labels(), 1)
    return figure


def test_figures_are_png_and_svg_and_the_same_each_time(tmp_path):
    files = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        files.append(write_figures(tmp_path / name, {"chart": lines}))
    assert [file.name for file in files[0]] == ["chart.png", "chart.svg"]
    assert all(first.read_bytes() == second.read_bytes() for first, second in zip(*files, strict=True))


def test_crops_show_the_middles_under_their_titles():
    images = np.zeros((2, 120, 200, 3))
    images[:, 12:-12, 52:-52] = 1
    figure = crops({"truth": images, "other": images, "third": images}, 2)
    shown = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == ["truth", "other", "third"]
    assert len(shown) == 6
    assert all(axes.images[0].get_array().shape == (96, 96, 3) for axes in shown)
    assert all(np.asarray(axes.images[0].get_array()).min() == 1 for axes in shown)
