"""The page about the environments: its code runs, and it tells every part of an observation."""

import re

import pytest
from page_commands import ROOT, blocks

gymnasium = pytest.importorskip("gymnasium", reason="needs pip install 'sounding[gym]'")

PAGE = ROOT / "docs" / "gym.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_the_code_of_the_page_runs(capsys) -> None:
    names: dict[str, object] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE.name, "exec"), names)  # the page's own code, from this repository
    assert re.match(r"\d+ actions, [01]\.\d\d sensed, ", capsys.readouterr().out)


def test_the_page_tells_every_part_of_an_observation_and_of_info() -> None:
    env = gymnasium.make("sim.gym:Sounding/sphere-v0").unwrapped
    assert set(re.findall(r"^\| `(\w+)` \| [HNXYZ1, ]*\|", TEXT, re.MULTILINE)) == set(env.observation_space)
    observation, at_reset = env.reset(seed=0)
    assert set(observation) == set(env.observation_space)
    assert all(f"`{name}`" in TEXT or f'info["{name}"]' in TEXT for name in at_reset)
    assert set(env.step(0)[4]) <= set(at_reset)


def test_the_page_names_every_environment() -> None:
    from sim.gym import ENVIRONMENTS

    assert set(re.findall(r"`(Sounding/[\w-]+)`", TEXT)) == set(ENVIRONMENTS)
