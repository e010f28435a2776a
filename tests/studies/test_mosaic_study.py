"""The study of mosaics runs as one command and tells every way apart."""

import studies.mosaic as study
from studies.photographs import pairs_of
from tests.documents import document_of


def test_the_truth_is_what_the_lens_images():
    pair = pairs_of(None, study.SIZE_PX, study.MARGIN_PX)[0]
    sharp, soft = (study.take(pair, study.Job(0, 60.0, "mono", lens)) for lens in study.BLURS_PX)
    assert sharp.layers.shape == soft.layers.shape == (2, study.SIZE_PX, study.SIZE_PX)
    assert soft.layers.std() < sharp.layers.std()


def test_the_study_is_one_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "SIZE_PX", 128)
    study.main(["--quick", "--sensors", "mono", "-o", str(tmp_path)])
    assert "| mono | lens blur 0.7 px | 60 | joint solve |" in capsys.readouterr().out
    rows = document_of(tmp_path / "mosaic.json")["results"]
    assert {row["way"] for row in rows} == set(study.WAYS)
    by_way = {row["way"]: row for row in rows if row["pair"] == 0}
    # No mosaic tells as much as four full photographs; with the pane known samples tell more than their interpolation.
    assert by_way[study.BOUND]["known_transmission"] > by_way[study.JOINT]["known_transmission"]
    assert by_way[study.JOINT]["known_transmission"] > by_way[study.BILINEAR]["known_transmission"]
    assert (tmp_path / "mosaic.png").stat().st_size > 10_000
