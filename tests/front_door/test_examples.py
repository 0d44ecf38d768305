"""The examples: each is short, runs as it stands, and prints results that its planted truth bears out."""

from __future__ import annotations

import ast
import json
import re
import runpy
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
MOST_LINES = 60


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Runs an example in an empty folder, as a user would; gives the lines that it prints."""
    monkeypatch.chdir(tmp_path)

    def run(number: int) -> list[str]:
        (path,) = (path for path in EXAMPLES if path.stem.startswith(f"example_{number:02d}_"))
        runpy.run_path(str(path), run_name="__main__")
        return capsys.readouterr().out.splitlines()

    return run


def values(line: str) -> list[float]:
    """The numbers of a line, with per cent as shares."""
    words = re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?%?", line)
    return [float(word.rstrip("%")) / (100.0 if word.endswith("%") else 1.0) for word in words]


def by_name(lines: list[str]) -> dict[str, float]:
    """The last number of each line that has one, by the words before it."""
    found = {}
    for line in lines:
        if match := re.match(r"(.+?)\s+(-?[\d.]+%?)(?: \w+)?$", line):
            found[match[1]] = values(match[2])[0]
    return found


def test_the_examples_are_numbered_without_a_gap() -> None:
    assert [int(path.stem.split("_")[1]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
    assert len(EXAMPLES) >= 8


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_enters_by_the_front_door(path) -> None:
    source = path.read_text()
    assert len(source.splitlines()) <= MOST_LINES
    assert max(map(len, source.splitlines())) <= 120
    tree = ast.parse(source)
    assert ast.get_docstring(tree)
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    # A client of the service knows nothing of Sounding but its messages.
    assert ("pyigtl" if path.stem.endswith("_client") else "sounding") in imported
    assert not {name for name in imported if name.split(".")[0] in ("sim", "planner", "mapping")}
    assert source.endswith('if __name__ == "__main__":\n    main()\n')


def test_a_first_episode_finds_the_sphere_and_leaves_a_report(printed) -> None:
    *lines, last = printed(1)
    found = by_name(lines)
    assert found["sensing actions"] == 12
    assert found["tumour sensed"] > 0.9
    assert 1 <= found["actions until 95 %"] <= 12
    assert 0.95 < found["AUPRC of the map"] <= 1.0
    report = re.fullmatch(r"open (.+) in a browser", last)
    assert report is not None
    assert Path(report[1]).is_file()


def test_a_planner_of_ones_own_finds_more_than_chance_does(printed) -> None:
    found = {line[:12].strip(): values(line) for line in printed(2)[1:]}
    assert found["least sure"][0] > 2 * found["random"][0]
    assert found["least sure"][1] > 0.9  # the sphere is mapped
    config = json.loads(Path("renders/own-planner/least-sure/config.json").read_text())
    # The text by which the run repeats in the example's folder, though the script was called __main__ then.
    assert config["options"]["planner"] == "example_02_own_planner:LeastSure"


def test_a_sensor_that_misses_more_gives_a_worse_map(printed) -> None:
    """The sensors look at the same places, and only their misses differ."""
    miss_rates, auprc, log_loss = zip(*map(values, printed(3)[1:]), strict=True)
    assert miss_rates == (0.0, 0.3, 0.6)
    assert list(auprc) == sorted(auprc, reverse=True)
    assert auprc[0] - auprc[-1] > 0.1
    assert list(log_loss) == sorted(log_loss)


def test_a_map_of_ones_own_is_scored_beside_the_built_in_one(printed) -> None:
    found = {line.split()[0]: values(line) for line in printed(4)[1:]}
    assert found.keys() == {"NearestPoints", "HilbertMap"}
    auprc, log_loss = found["NearestPoints"]
    # 0.7 per cent of the organ is tumour, which is what a map scores that knows nothing.
    assert 0.3 < auprc < found["HilbertMap"][0]
    assert log_loss > found["HilbertMap"][1]


def test_a_tumour_given_as_arrays_is_found_where_it_was_put(printed) -> None:
    found = by_name(printed(5))
    assert found["poses out of reach"] == 0
    assert found["tumour sensed"] > 0.9
    # Half-axes of 12, 8 and 8 mm; the icosphere of 2562 corners lies within a per cent of the ellipsoid.
    assert found["true volume"] == pytest.approx(4 / 3 * 3.14159 * 1.2 * 0.8 * 0.8, rel=0.01)
    # The map is read at points 3 mm apart, and finer about what was found: a layer of half a millimetre at the
    # surface is a sixth of so small a volume, and the centre is found to half a spacing.
    assert found["mapped volume"] == pytest.approx(found["true volume"], rel=0.15)
    assert found["error of its centre"] < 1.5


def test_a_campaign_tells_the_better_planner(printed) -> None:
    lines = printed(6)
    assert lines[0] == "8 trials in renders/two-planners, 0 failed"
    rows = [line for line in lines if re.match(r"\| (find-and-outline|random) +\| 4 ", line)]
    ours, random = (float(re.findall(r"[\d.]+", row)[1]) for row in rows[:2])  # the mean follows the count
    assert ours < 15 < 30 < random <= 40
    assert (Path("renders") / "two-planners" / "compare" / "report.html").is_file()


def test_a_run_is_read_back_from_its_folder(printed) -> None:
    lines = printed(7)
    assert lines[0] == "find-and-outline on spheres, seed 2: 12 actions"
    curve = [values(line) for line in lines[3:7]]
    assert [row[0] for row in curve] == [3, 6, 9, 12]
    assert [row[1] for row in curve] == sorted(row[1] for row in curve)  # what was sensed stays sensed
    share = next(values(line)[0] for line in lines if line.startswith("tumour is likely"))
    # Three spheres of 12 mm in 180 x 180 x 101 mm, of which the organ fills about two thirds: 1 per cent.
    assert 0.001 < share < 0.015
    tumours = [line.split() for line in lines[-3:]]
    assert [row[0] for row in tumours] == ["1", "2", "3"]
    assert all((values(row[2])[0] > 0.5) == (row[1] == "yes") for row in tumours)


def test_the_arm_reaches_less_the_higher_it_stands(printed) -> None:
    rows = [values(line) for line in printed(8)[1:]]
    assert [row[0] for row in rows] == [0, 200]
    assert 0.5 < rows[1][1] < rows[0][1] <= 1.0
    assert all(0.0 < in_one_piece <= share for _, share, in_one_piece in rows)


def test_a_reach_study_takes_names_and_objects_alike(tmp_path, monkeypatch) -> None:
    import sounding

    monkeypatch.chdir(tmp_path)
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export("ball.stl")
    ball = trimesh.load_mesh("ball.stl")  # the file has single precision
    Path("ball.toml").write_text('organ = "ball.stl"\norgan_unit = "m"\nn_poses = 60\n')
    named = sounding.reach_study("ball.toml", "default", "named")
    scenario = sounding.Scenario(name="ball", organ=ball, n_poses=60)
    given = sounding.reach_study(scenario, sounding.named_arm("default"), "given", name="default")
    measured = {"folder", "wall_s", "search_s", "poses_per_s"}
    assert named["arm"] == "default"
    assert {key: named[key] for key in named.keys() - measured} == {
        key: given[key] for key in given.keys() - measured
    }
    assert Path("named/reach.csv").read_bytes() == Path("given/reach.csv").read_bytes()
