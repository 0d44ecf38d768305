"""The report in a real browser: no error, no request, and a slider that moves the view and the curves."""

from __future__ import annotations

import pytest
from opened_page import WAIT_MS, Opened
from shared_runs import N_ARM_ACTIONS as ACTIONS

OWN_GROUND = "button => getComputedStyle(button).backgroundColor !== 'rgba(0, 0, 0, 0)'"


@pytest.fixture(scope="module")
def report(arm_run):
    return arm_run / "report.html"


@pytest.fixture(scope="module")
def loaded(browser, report):
    page = Opened(browser, report, viewport={"width": 1280, "height": 900})
    page.ready()
    yield page
    page.context.close()


@pytest.fixture
def opened(loaded):
    """The page, which is brought back to how it was opened after each test."""
    page = loaded.page
    level, boxes = page.locator("input[name=level]"), page.locator("input[type=checkbox]").all()
    before, is_checked = level.input_value(), [box.is_checked() for box in boxes]
    yield loaded
    page.locator("#slider").fill(str(ACTIONS))
    level.fill(before)
    for box, was_checked in zip(boxes, is_checked, strict=True):
        box.set_checked(was_checked)
    page.evaluate("document.activeElement.blur()")  # keys are the page's again
    page.evaluate("scrollTo(0, 0)")
    assert loaded.complaints == []


def test_it_loads_without_an_error_or_a_request(opened, report) -> None:
    opened.page.wait_for_timeout(200)
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith("data:")] == [report.as_uri()]
    assert opened.page.evaluate("window.soundingReport.error") is None
    assert opened.state["step"] == ACTIONS


def picture(page) -> bytes:
    page.wait_for_timeout(150)
    return page.locator("#view").screenshot()


def test_the_slider_moves_the_view_and_the_curves(opened) -> None:
    page = opened.page
    cursor = page.locator("svg[data-chart=auprc] .cursor")
    seen, places, pictures = [], [], []
    for step in (0, 1, 3, ACTIONS):
        page.locator("#slider").fill(str(step))
        seen.append(opened.state["tip"])
        places.append(cursor.get_attribute("x1"))
        pictures.append(picture(page))
        assert page.locator("#number").inner_text() == f"{step} of {ACTIONS}"
    assert seen[0] is None
    assert len({tuple(tip) for tip in seen[1:]}) == 3
    assert len(set(places[1:])) == 3
    assert len(set(pictures)) == 4


def test_the_frame_follows_the_slider_and_is_decoded_when_it_is_shown(opened) -> None:
    page, addresses = opened.page, []
    for step in (ACTIONS, 1, 3, ACTIONS):
        page.locator("#slider").fill(str(step))
        addresses.append(page.locator("#frame").get_attribute("src"))
        assert page.locator("#frame").get_attribute("data-step") == str(step)
        page.wait_for_function("document.getElementById('frame').naturalWidth > 0")
    assert len(set(addresses[:3])) == 3
    assert addresses[3] == addresses[0]
    assert page.evaluate("document.images.length") == 1


def test_the_keys_move_it_and_the_space_bar_plays(opened) -> None:
    page = opened.page
    page.locator("body").press("ArrowLeft")
    assert opened.state["step"] == ACTIONS - 1
    page.locator("#slider").focus()
    page.locator("#slider").press("Home")
    assert opened.state["step"] == 0
    page.locator("#slider").press("ArrowRight")
    assert opened.state["step"] == 1
    page.locator("#slider").press(" ")
    page.wait_for_function(f"window.soundingReport.state.step === {ACTIONS}")


def test_home_and_end_work_at_once_and_the_legend_lies_above_the_fold(browser, report) -> None:
    opened = Opened(browser, report, viewport={"width": 1280, "height": 900})
    page = opened.ready()
    page.keyboard.press("Home")  # nothing was clicked before
    assert opened.state["step"] == 0
    page.keyboard.press("End")
    assert opened.state["step"] == ACTIONS
    for part in ("#view", "#legend", "#transport"):
        box = page.locator(part).bounding_box()
        assert box["y"] + box["height"] <= 900
    assert page.locator(".presets button").first.evaluate(OWN_GROUND)
    opened.context.close()


def test_the_arm_is_seen_on_its_way_to_the_next_action(opened) -> None:
    page = opened.page
    page.locator("body").press("Home")
    at_home = picture(page)
    moving = "(window.soundingReport.setStep({}), window.soundingReport.state.isMoving)"
    assert page.evaluate(moving.format(1))
    page.wait_for_function("!window.soundingReport.state.isMoving")
    assert picture(page) != at_home
    assert not page.evaluate(moving.format(ACTIONS))  # over several actions it jumps


def test_the_camera_stays_out_of_the_organ_and_the_arm(opened) -> None:
    page = opened.page
    box = page.locator("#canvas").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for _ in range(30):
        page.mouse.wheel(0, -240)
        assert not page.evaluate("window.soundingReport.state.isBlocked()")
    page.evaluate("window.soundingReport.setStep(0)")
    assert not page.evaluate("window.soundingReport.state.isBlocked()")
    page.locator("[data-preset=organ]").click()


def test_values_are_told_where_the_pointer_is(opened) -> None:
    page = opened.page
    page.locator("svg[data-chart=auprc]").hover()
    assert page.locator(".tip").inner_text().startswith("after action ")
    page.locator("svg[data-hover]").hover()
    assert page.locator(".tip").inner_text().startswith("recall ")


def test_the_slices_follow_the_slider_and_hide_the_truth(opened) -> None:
    page = opened.page
    page.locator("#slices").scroll_into_view_if_needed()
    page.wait_for_timeout(300)
    first, uncertain = page.locator("#planes canvas").nth(0), page.locator("#planes canvas").nth(1)
    drawn = "canvas => canvas.toDataURL()"
    last, unsure = first.evaluate(drawn), uncertain.evaluate(drawn)
    page.evaluate("window.soundingReport.setStep(1)")
    page.wait_for_timeout(300)
    early = first.evaluate(drawn)
    assert early != last
    assert uncertain.evaluate(drawn) == unsure  # that of the last map, whatever the slider says
    page.locator("#slice-truth").uncheck()
    page.wait_for_timeout(300)
    assert first.evaluate(drawn) != early
    before = first.evaluate(drawn)
    page.locator("#planes input").first.press("ArrowRight")
    assert first.evaluate(drawn) != before
    assert opened.state["step"] == 1  # the slice's slider has its own keys


def test_a_click_on_a_curve_goes_to_its_action(opened) -> None:
    box = opened.page.locator("svg[data-chart=sensed]").bounding_box()
    opened.page.mouse.click(box["x"] + box["width"] * 0.12, box["y"] + box["height"] / 2)
    assert opened.state["step"] == 1


def test_the_map_grows_where_the_level_falls_and_layers_hide(opened) -> None:
    page = opened.page
    before = opened.state["mapTriangles"]
    page.locator("input[name=level]").fill("0.05")
    assert opened.state["mapTriangles"] > before
    shown = picture(page)
    page.locator("input[name=organ]").uncheck()
    assert picture(page) != shown


def test_it_fits_every_width_and_scheme(browser, report) -> None:
    opened = Opened(browser, report, viewport={"width": 800, "height": 900}, color_scheme="dark")
    page = opened.ready()
    for width, scheme in ((390, "light"), (800, "dark"), (1280, "dark"), (1280, "light"), (800, "light")):
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(color_scheme=scheme)
        assert page.evaluate("document.documentElement.scrollWidth") <= width  # nothing to scroll sideways
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        red = int(background.split("(")[1].split(",")[0])
        assert (red > 200) == (scheme == "light")
    assert opened.complaints == []
    opened.context.close()


def test_tables_and_curves_need_no_script(browser, report) -> None:
    opened = Opened(browser, report, java_script_enabled=False)
    page = opened.page
    assert page.locator("table.findings tbody tr").count() == 1
    # A level curve has no height, which the browser takes for invisible.
    assert page.locator("svg[data-chart=auprc]").is_visible()
    assert page.locator("svg[data-chart=auprc] polyline").count() >= 1
    assert page.locator("noscript p, .without").first.is_visible()
    opened.context.close()


def test_without_webgl_all_else_works(browser, report) -> None:
    context = browser.new_context()
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(report.as_uri())
    page.wait_for_function("window.soundingReport")
    assert "needs WebGL" in page.locator("#view").inner_text()
    page.locator("#slider").fill("2")
    assert page.locator("#number").inner_text() == f"2 of {ACTIONS}"
    context.close()


def test_a_second_class_has_a_map_and_layers_of_its_own(browser, two_class_run) -> None:
    opened = Opened(browser, two_class_run / "report.html", viewport={"width": 800, "height": 900})
    page = opened.ready()
    assert page.evaluate("document.documentElement.scrollWidth") <= 800
    page.locator("input[name=level]").fill("0.05")
    assert opened.state["targetTriangles"] > 0
    page.locator("input[name=arm]").uncheck()  # the probe may stand between the camera and all else
    for layer in ("target-map", "target-truth"):  # and the map around all of the truth
        before = picture(page)
        page.locator(f"input[name={layer}]").uncheck()
        assert picture(page) != before, layer
    page.locator("#slider").fill("0")
    assert opened.state["targetTriangles"] == 0
    assert page.locator("svg[data-chart=target] polyline").is_visible()
    assert opened.complaints == []
    opened.context.close()
