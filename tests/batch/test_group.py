"""Files of folders and rows of tables become captures; what does not is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from polaropt.batch.group import Grouping, angles_in_names, group_sources
from polaropt.batch.table import read_table
from polaropt.errors import InputError

ANGLES = (0.0, 45.0, 90.0, 135.0)


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


def grouped(folder: Path, rule: str | None = None, angles: tuple[float, ...] = ANGLES) -> Grouping:
    return group_sources([str(folder)], angles, rule, output=folder / "out")


def found(grouping: Grouping) -> dict[str, list[str]]:
    return {group.name: [file.name for file in group.files] for group in grouping.groups if not group.problem}


@pytest.mark.parametrize(
    "names",
    [
        ["a_000.png", "a_045.png", "a_090.png", "a_135.png"],
        ["a-0.tif", "a-45.tif", "a-90.tif", "a-135.tif"],
        ["a_I0.png", "a_I45.png", "a_I90.png", "a_I135.png"],
        ["aI0.tif", "aI45.tif", "aI90.tif", "aI135.tif"],
        ["a/I0.png", "a/I45.png", "a/I90.png", "a/I135.png"],
        ["a/000.png", "a/045.png", "a/090.png", "a/135.png"],
        ["a/0deg.jpg", "a/45deg.jpg", "a/90deg.jpg", "a/135deg.jpg"],
        ["0_a.png", "45_a.png", "90_a.png", "135_a.png"],
        ["a_0.0.png", "a_45.0.png", "a_90.0.png", "a_135.0.png"],
        ["a_0\N{DEGREE SIGN}.png", "a_45\N{DEGREE SIGN}.png", "a_90\N{DEGREE SIGN}.png", "a_135\N{DEGREE SIGN}.png"],
        ["a/1.NEF", "a/2.NEF", "a/3.NEF", "a/4.NEF"],
    ],
)
def test_common_names_of_photographs_are_known(tmp_path: Path, names: list[str]) -> None:
    touch(tmp_path, *names)
    assert found(grouped(tmp_path)) == {"a": [Path(name).name for name in names]}


def test_scenes_of_many_photographs_have_the_names_of_their_folders(tmp_path: Path) -> None:
    names = [f"input/{scene}/{number}_{angle}.png" for scene in ("x", "y") for number in (1, 2) for angle in ("000", "045", "090", "135")]  # fmt: skip # noqa: E501
    touch(tmp_path, *names)
    assert list(found(grouped(tmp_path))) == ["input/x/1", "input/x/2", "input/y/1", "input/y/2"]


def test_mosaics_and_stacks_are_captures_by_themselves(tmp_path: Path) -> None:
    touch(tmp_path, "a.png", "b/c.tiff", "d.npz", "frame_000.png", "frame_045.png", "frame_046.png")
    assert found(grouped(tmp_path)) == {
        "a": ["a.png"],
        "d": ["d.npz"],
        "frame_000": ["frame_000.png"],
        "frame_045": ["frame_045.png"],
        "frame_046": ["frame_046.png"],
        "b/c": ["c.tiff"],
    }


def test_numbers_behind_a_word_are_no_angles(tmp_path: Path) -> None:
    touch(tmp_path, "taxi0.png", "taxi45.png", "HAWAII0.tif", "HAWAII45.tif")
    assert {group.name for group in grouped(tmp_path).groups} == {"taxi0", "taxi45", "HAWAII0", "HAWAII45"}


def test_what_does_not_group_is_named(tmp_path: Path) -> None:
    touch(tmp_path, "a_000.png", "a_045.png", "a_090.png", "notes.txt", "look.jpg", ".hidden.png", "out/old.png")
    touch(tmp_path, "before/report.json", "before/transmission.tiff")
    grouping = grouped(tmp_path)
    (group,) = grouping.groups
    assert group.problem == "has angles 0, 45, 90; 135 missing"
    assert {left.file.name for left in grouping.leftovers} == {"notes.txt", "look.jpg"}


def test_photographs_beside_their_results_are_found(tmp_path: Path) -> None:
    results = ("report.json", "transmission.tiff", "reflection_known.tiff", "uncertainty.png", "thumbnail.jpg")
    touch(tmp_path, *(f"shots/a_{angle:03}.png" for angle in (0, 45, 90, 135)), *(f"shots/{name}" for name in results))
    for folder in (tmp_path, tmp_path / "shots"):
        grouping = grouped(folder)
        assert [len(group.files) for group in grouping.groups] == [4]
        assert grouping.leftovers == ()


def test_a_batch_beside_its_photographs_leaves_its_own_files_out(tmp_path: Path) -> None:
    touch(
        tmp_path, "a.png", "batch.jsonl", "summary.csv", "index.html", "scene.json", "a/report.json", "a/thumbnail.jpg"
    )
    grouping = grouped(tmp_path)
    assert (list(found(grouping)), [left.file.name for left in grouping.leftovers]) == (["a"], [])


def test_what_simulate_and_demo_write_beside_photographs_is_no_capture(tmp_path: Path) -> None:
    truth = ("true_transmission.tiff", "true_reflection.tiff")
    photographs = [f"capture_{angle:03}.png" for angle in (0, 45, 90, 135)]
    touch(tmp_path, *(f"simulated/{name}" for name in (*photographs, *truth, "scene.json")))
    touch(tmp_path, *(f"demo/{name}" for name in (*photographs, *truth, "report.json", "side-by-side.png")))
    touch(tmp_path, "mine/side-by-side.png")
    assert found(grouped(tmp_path)) == {
        "simulated/capture": photographs,
        "demo/capture": photographs,
        "mine/side-by-side": ["side-by-side.png"],
    }


def test_other_angles_are_looked_for(tmp_path: Path) -> None:
    touch(tmp_path, "a_60.png", "a_0.png", "a_120.png")
    assert found(grouped(tmp_path, angles=(0, 60, 120))) == {"a": ["a_0.png", "a_60.png", "a_120.png"]}


def test_a_pattern_groups(tmp_path: Path) -> None:
    touch(tmp_path, "000/x.png", "045/x.png", "090/x.png", "135/x.png", "more.png")
    grouping = grouped(tmp_path, "{angle}/{name}.png")
    # By folders of angles: each folder holds a part of the capture.
    assert found(grouping) == {"x": ["x.png"] * 4}
    assert [left.file.name for left in grouping.leftovers] == ["more.png"]


def test_each_and_folder(tmp_path: Path) -> None:
    touch(tmp_path, "a_000.png", "a_045.png", "a_090.png", "a_135.png")
    assert len(found(grouped(tmp_path, "each"))) == 4
    assert found(grouped(tmp_path, "folder")) == {tmp_path.name: ["a_000.png", "a_045.png", "a_090.png", "a_135.png"]}


def test_files_that_are_named_one_by_one_go_together(tmp_path: Path) -> None:
    names = [f"a/x_{angle}.png" for angle in ("000", "045", "090", "135")]
    touch(tmp_path, *names, "b/mosaic.png")
    sources = [str(tmp_path / name) for name in (*names, "b/mosaic.png")]
    (photographs, mosaic) = group_sources(sources, ANGLES, output=tmp_path / "out").groups
    assert (photographs.name, len(photographs.files), photographs.problem) == ("a/x", 4, "")
    assert (mosaic.name, len(mosaic.files)) == ("b/mosaic", 1)


def test_names_differ(tmp_path: Path) -> None:
    touch(tmp_path, "a.png", "a.tif", "A.npz")
    assert sorted(found(grouped(tmp_path))) == ["A", "a-2", "a-3"]


def test_a_batch_own_files_are_no_names_of_captures(tmp_path: Path) -> None:
    touch(tmp_path, "index.html.png", "Summary.csv/a_000.tif", "Summary.csv/a_045.tif", "b/index.html.png")
    names = {group.name for group in grouped(tmp_path).groups}
    assert names == {"index.html-2", "Summary.csv-2/a", "b/index.html"}


def test_a_link_that_leads_back_is_not_followed(tmp_path: Path) -> None:
    touch(tmp_path, "a/m.png")
    (tmp_path / "a" / "up").symlink_to("..")
    (tmp_path / "b").symlink_to("a")
    assert list(found(grouped(tmp_path))) == ["a/m", "b/m"]


def test_a_source_that_is_named_twice_counts_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    touch(tmp_path, "a/m.png")
    monkeypatch.chdir(tmp_path)
    sources = ["a", "./a/../a", str(tmp_path / "a"), "*/m.png"]
    assert list(found(group_sources(sources, ANGLES, output=tmp_path / "out"))) == ["m"]


def test_two_files_of_one_angle_are_named(tmp_path: Path) -> None:
    angles = ("000", "045", "090", "135")
    touch(tmp_path, *(f"a{mark}{angle}.png" for mark in "-_" for angle in angles), "b_1.png", "b_001.png")
    grouping = grouped(tmp_path)
    assert found(grouping) == {
        "a": [f"a-{angle}.png" for angle in angles],
        "b_001": ["b_001.png"],
        "b_1": ["b_1.png"],
    }
    assert [left.file.name for left in grouping.leftovers] == [f"a_{angle}.png" for angle in angles]
    turned = tmp_path / "turned"
    touch(turned, *(f"c_{angle}.tif" for angle in (0, 45, 90, 135, 180)))
    grouping = grouped(turned, "{name}_{angle}.tif")
    assert list(found(grouping)) == ["c"]
    assert [left.file.name for left in grouping.leftovers] == ["c_180.tif"]


def test_patterns_of_files(tmp_path: Path) -> None:
    touch(tmp_path, "x/a.png", "x/b.tif", "y/a.png")
    pattern = str(tmp_path / "*" / "*.png")
    assert list(found(group_sources([pattern], ANGLES, output=tmp_path / "out"))) == ["x/a", "y/a"]


@pytest.mark.parametrize(
    ("source", "rule", "words"),
    [
        ("nothing", None, "no such file"),
        ("*.xyz", None, "no file has such a name"),
        ("empty", None, "no photographs"),
        (".", "{name}.png", "give a pattern with {name} and {angle}"),
    ],
)
def test_wrong_sources_and_rules_are_refused(tmp_path: Path, source: str, rule: str | None, words: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=words.replace("{", r"\{")):
        group_sources([str(tmp_path / source)], ANGLES, rule, output=tmp_path / "out")


def test_a_table_names_files_and_options(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("name,files,incidence,black-level\none,a.png;b.png;c.png;d.png,60,\n,m.png,,64\n\n")
    first, second = read_table(table, {"incidence", "black_level"})
    assert (first.group.name, len(first.group.files), first.options) == ("one", 4, {"incidence": "60"})
    assert (second.group.name, second.group.files, second.options) == (
        "m",
        (tmp_path / "m.png",),
        {"black_level": "64"},
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name\nx\n", "has no column 'files'"),
        ("name;files\nx;a.png\n", "its columns are set apart by ';'"),
        ("name\tfiles\nx\ta.png\n", "its columns are set apart by"),
        ("files,colour\na.png,red\n", "there is no column 'colour'"),
        ("files\n", "holds no captures"),
        ("files\na.png,b.png\n", "line 2: holds more fields"),
        ("name,files\n../x,a.png\n", "leaves the output folder"),
        ("name,files\nx,\n", "line 2: names no file"),
        ("name,files\n.,a.png\n", "leaves the output folder"),
        ("name,name,files\nx,y,a.png\n", "has the column 'name' twice"),
        ("files,incidence,--incidence\na.png,1,2\n", "has the column 'incidence' twice"),
        ("files,,\na.png,,b\n", "line 2: holds more fields"),
    ],
)
def test_wrong_tables_are_refused(tmp_path: Path, text: str, words: str) -> None:
    table = tmp_path / "table.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=words):
        read_table(table, {"incidence"})


def test_a_table_names_captures_as_a_folder_does_and_may_have_empty_columns(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text(
        "files,,\nc000_0.png;c000_45.png,,\nc100_000.png;c100_045.png,,\na.png;b.png,,\nx-1.png;x-2.png,,\n"
    )
    assert [entry.group.name for entry in read_table(table, ())] == ["c000", "c100", tmp_path.name, "x"]


def test_numbers_before_a_word_that_go_on_count_files(tmp_path: Path) -> None:
    touch(tmp_path, *(f"{number:03d}_frame.png" for number in range(0, 200, 5)))
    assert len(found(grouped(tmp_path))) == 40


def test_angles_are_told_by_names_in_any_order() -> None:
    for names in (["135_a.png", "0_a.png", "45_a.png"], ["a_135.0.png", "a_0.0.png", "a_45\N{DEGREE SIGN}.png"]):
        assert angles_in_names([Path(name) for name in names]) == (135, 0, 45)
