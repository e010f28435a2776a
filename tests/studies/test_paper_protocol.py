"""The paper's protocol: one command, its rows, table and figure."""

from __future__ import annotations

from functools import partial

from studies import paper_protocol
from tests.documents import document_of


def test_the_table_is_one_command(tmp_path, capsys, monkeypatch, told_pane, png_alone):
    monkeypatch.setattr(paper_protocol, "Job", partial(paper_protocol.Job, size=128))
    paper_protocol.main(["--pairs", "1", "--incidences", "65", "--kind", "paper", "-o", str(tmp_path)])
    assert "| paper | 65 |" in capsys.readouterr().out
    document = document_of(tmp_path / "paper_protocol.json")
    (row,) = document["results"]
    assert {"settings", "machine", "libraries", "commit", "sources", "seeds"} <= document["metadata"].keys()
    assert (tmp_path / "paper_protocol.png").stat().st_size > 10_000
    assert (tmp_path / "paper_protocol.csv").read_text().splitlines()[0] == ",".join(row)
    assert row["blind_transmission"] > row["nothing"] + 10
