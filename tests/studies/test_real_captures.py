"""Real captures: how far edges are shared, and what stands in the tables."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from studies import real_captures
from studies.kit.frames import frame_of
from studies.real_captures import Row, edge_correlation, tables


def test_edges_correlate_with_themselves():
    random = np.random.default_rng(0)
    image, other = random.standard_normal((2, 40, 40))
    assert edge_correlation(image, image) == pytest.approx(1)
    assert abs(edge_correlation(image, other)) < 0.2


def test_captures_stand_beside_a_peer_and_measured_layers_beside_the_truth():
    unknown = math.nan
    rows = [
        Row("one", unknown, 40.0, 10.0, 0, 2.9, 0.4, 0.2, 0.2, 0.3, *[unknown] * 3, 5.0, ("SATURATED",)),
        Row("two", 20.0, 21.0, 10.0, 0, 1.0, *[unknown] * 4, 20.0, 30.0, 25.0, 5.0, ()),
    ]
    text = tables(frame_of(Row, rows))
    assert "| one | 40.0 | 10.0 | 0.00 | 2.9 | 0.400 | 0.200 | 5.0 | SATURATED |" in text
    assert "one, upper left: edge correlation with the reflection 0.200 (peer network: 0.300)" in text
    assert "| two | 20 | 20.00 | 30.00 | 25.00 | 21.0 |" in text


def test_without_data_it_says_what_it_wants(tmp_path, capsys):
    real_captures.main(["-o", str(tmp_path)])
    assert "`--data DIR`" in capsys.readouterr().out
    assert json.loads((tmp_path / "real_captures.json").read_text())["results"] == []
