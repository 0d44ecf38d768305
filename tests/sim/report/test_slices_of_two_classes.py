"""The slices of a run with a second class: either map can be chosen, and is seen where its bodies lie."""

from __future__ import annotations

import pytest
from opened_page import Opened


@pytest.fixture
def opened(browser, two_class_run):
    page = Opened(browser, two_class_run / "report.html", viewport={"width": 1280, "height": 900})
    page.ready()
    yield page
    page.context.close()


def test_the_map_of_either_class_can_be_chosen(opened) -> None:
    page = opened.page
    choice, first = page.locator("#slice-class"), page.locator("#planes canvas").first
    places = "[...document.querySelectorAll('#planes input')].map(input => input.value)"
    drawn = "canvas => canvas.toDataURL()"
    choice.scroll_into_view_if_needed()
    page.wait_for_timeout(300)
    assert choice.locator("option").all_inner_texts() == ["tumours", "cysts"]
    seen, spread, at = (
        first.evaluate(drawn),
        page.locator("#deviation-range").inner_text(),
        page.evaluate(places),
    )
    choice.select_option("cysts")
    page.wait_for_timeout(300)
    assert page.evaluate(places) != at
    # The maps differ, and not only because another place is looked at.
    for slider, value in zip(page.locator("#planes input").all(), at, strict=True):
        slider.fill(value)
    assert page.evaluate(places) == at
    assert first.evaluate(drawn) != seen
    assert page.locator("#deviation-range").inner_text() != spread
    choice.select_option("tumours")
    page.wait_for_timeout(300)
    assert first.evaluate(drawn) == seen
    # The list has keys of its own.
    choice.press("ArrowLeft")
    assert opened.state["step"] == 4
    assert opened.complaints == []
