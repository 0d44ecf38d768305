"""Several arms on one workspace, and the tables of a study in Parquet."""

from __future__ import annotations

import csv
import json
import sys
from importlib.util import find_spec

import pytest

from sim.cli.command_line import main
from sim.reach.arm_comparison import COLUMNS, arms_table, folder_names
from sim.reach.tables import write_parquet
from sim.world.scene.arm import MODELS_DIR

COARSE = 'base = "liver"\nn_poses = 60\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The embedded arm, and a copy of it whose elbow hardly bends."""
    path = tmp_path_factory.mktemp("arms")
    (path / "coarse.toml").write_text(COARSE)
    text = (MODELS_DIR / "arm.xml").read_text()
    stiff = text.replace('range="-3.0718 -0.0698"', 'range="-3.0718 -2.6"').replace(
        "-1.57079633 0 1.57", "-2.8 0 1.57"
    )
    assert stiff != text
    (path / "stiff.xml").write_text(stiff)
    arguments = ["--scenario", str(path / "coarse.toml"), "--arm", "default", str(path / "stiff.xml")]
    parquet = ["--parquet"] if find_spec("pyarrow") else []
    assert main(["reach", *arguments, *parquet, "--out", str(path / "out")]) == 0
    return path / "out"


def test_the_table_holds_a_row_per_arm_that_its_own_folder_bears_out(folder) -> None:
    with (folder / "arms.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["arm"] for row in rows] == ["default", "stiff"]
    for row in rows:
        summary = json.loads((folder / row["arm"] / "summary.json").read_text())
        assert float(row["reached_fraction"]) == summary["reached_fraction"]
        with (folder / row["arm"] / "reach.csv").open() as file:
            reached = [line["is_reached"] == "1" for line in csv.DictReader(file)]
        assert sum(reached) / len(reached) == pytest.approx(float(row["reached_fraction"]))
    assert float(rows[1]["reached_fraction"]) < float(rows[0]["reached_fraction"])
    assert (folder / "arms.png").stat().st_size > 10_000
    assert json.loads((folder / "manifest.json").read_text())["status"] == "finished"


def test_the_markdown_is_a_table(folder) -> None:
    lines = (folder / "arms.md").read_text().splitlines()
    assert len(lines) == 4
    assert len({line.count("|") for line in lines}) == 1
    assert "stiff" in lines[3]


def test_names_are_never_given_twice() -> None:
    assert folder_names(["default", "a/x.xml", "b/x.xml"]) == ["default", "a-x", "b-x"]
    assert arms_table([dict.fromkeys(COLUMNS, None) | {"arm": "x", "best_base": ""}]).count("\n") == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--arm", "default", "nowhere.xml"], "nowhere.xml: no such arm file"),
        (["--arm", "default", "none"], "free-flying"),
        (["--flange", "a", "b"], "one for each of the 1 arms"),
        (["--base-search", "3"], "from 10 to 5000"),
        (["--base-search", "20", "--base-poses", "2"], "from 20 to"),
        (["--base-search", "20", "--base-height-mm", "300", "0"], "two rising heights"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    arguments, words, small_ball, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["reach", "--scenario", str(small_ball), *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error
    assert not list(tmp_path.iterdir())


def test_parquet_holds_what_the_csv_does(folder) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet comes with the extra `parquet`")
    out = folder / "default"
    table = parquet.read_table(out / "reach.parquet").to_pylist()
    with (out / "reach.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(table) == len(rows) > 0
    for ours, text in zip(table, rows, strict=True):
        assert list(ours) == list(text)
        for name, value in ours.items():
            if isinstance(value, float):
                assert value == float(text[name])
            else:
                assert (
                    str(int(value) if isinstance(value, bool) else "" if value is None else value)
                    == text[name]
                )


def test_parquet_columns_without_a_value_are_still_numbers(tmp_path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet comes with the extra `parquet`")
    write_parquet(
        tmp_path / "t.parquet", [{"pose_index": 0, "score": None}, {"pose_index": 1, "score": None}]
    )
    assert [str(kind) for kind in parquet.read_schema(tmp_path / "t.parquet").types] == ["int64", "double"]


def test_parquet_that_is_not_installed_names_its_extra(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.chdir(tmp_path)
    assert main(["reach", "--parquet"]) == 2
    told = capsys.readouterr().err
    assert "--parquet needs pyarrow" in told
    assert "[parquet]" in told
    assert not list(tmp_path.iterdir())
