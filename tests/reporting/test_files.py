"""What a separation writes goes on from where the progress had come."""

from __future__ import annotations

import pytest

from polaropt.progress import Stages
from polaropt.reporting import write_separation
from polaropt.separation import separate
from solvers.base import StoppingRule
from tests.blends import blend


@pytest.mark.parametrize("uncertainty", [True, False])
def test_the_progress_of_writing_begins_where_the_separation_ended_and_never_goes_back(tmp_path, uncertainty):
    example, told = blend(size=96), []
    result = separate(example.capture, example.scene, stopping=StoppingRule(max_evaluations=1))
    stages = Stages(lambda stage, fraction: told.append((stage, fraction)))
    write_separation(tmp_path, result, example.capture, stages=stages, reached=0.4, uncertainty=uncertainty)
    fractions = [fraction for _, fraction in told]
    assert fractions[0] == 0.4
    assert fractions == sorted(fractions)
    assert 0.7 < fractions[-1] <= 1
    assert {stage for stage, _ in told} == ({"Error maps", "Writing"} if uncertainty else {"Writing"})
