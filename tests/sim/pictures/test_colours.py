"""One colour code: the page's colours are those of frames and figures."""

import re
from pathlib import Path

import pytest

import sim.report
from sim import colours


@pytest.mark.parametrize(
    ("name", "colour"),
    [
        ("truth", colours.TRUTH),
        ("map", colours.MAP),
        ("probe", colours.PROBE),
        ("second", colours.TARGET),
        ("second-map", colours.TARGET_MAP),
        ("structure", colours.STRUCTURE),
        ("keepout", colours.KEEPOUT),
    ],
)
def test_the_page_has_the_same_colours(name, colour):
    style = (Path(sim.report.__file__).parent / "assets/style.css").read_text(encoding="utf-8")
    found = re.search(rf"--{name}:\s*(#[0-9a-fA-F]{{6}})", style)
    assert found is not None
    assert found[1].lower() == colour.lower()


def test_a_colour_as_numbers_keeps_its_channels():
    assert colours.rgba("#FF8000", 0.5) == pytest.approx((1.0, 128 / 255, 0.0, 0.5))
