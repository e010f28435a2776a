"""Coverage of the stated errors: its figure."""

from __future__ import annotations

from studies import coverage
from studies.kit.charts import write_figures
from studies.kit.frames import frame_of


def test_coverage_is_drawn_for_whatever_incidences_there_are(tmp_path):
    rows = [
        coverage.Row(0, incidence, 0.005, "blind", layer, 0.95, 0.9, 0.9, 1.0, 0.5, 0.8)
        for incidence in (10.0, 60.0)
        for layer in coverage.LAYERS
    ]
    files = write_figures(tmp_path, coverage.figures(frame_of(coverage.Row, rows)))
    assert all(file.stat().st_size > 10_000 for file in files)
