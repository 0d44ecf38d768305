"""The page's light colours are those of frames and figures."""

import re

import pytest

from sim.report.page import ASSETS

NAMES = {
    "TRUTH": "truth", "MAP": "map", "PROBE": "probe", "TARGET": "second", "TARGET_MAP": "second-map",
    "STRUCTURE": "structure", "KEEPOUT": "keepout", "ORGAN": "organ",
}  # fmt: skip
"""The name of each colour in the one table, and in the style sheet."""


def test_the_page_has_the_colours_of_frames_and_figures() -> None:
    table = pytest.importorskip("sim.colours", reason="frames and figures have no table of colours yet")
    light = (ASSETS / "style.css").read_text(encoding="utf-8").split("@media")[0]
    of_page = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", light))
    assert {name: of_page[css] for name, css in NAMES.items()} == {
        name: getattr(table, name).lower() for name in NAMES
    }
