"""Runs with ultrasound: pictures in the folder, beside the scene and in the report, and `sounding image`."""

import json

import numpy as np
import pytest
from opened_page import Opened
from PIL import Image

from sim.cli.command_line import main
from sim.extras import EXTRAS
from sim.record.ownership import RUN_NAMES
from sim.world.errors import MissingPackageError
from sim.world.optional import optional_module
from sim.world.sensing.ultrasound import compiling
from sim.world.sensing.ultrasound.compiling import compiled

RUN = (
    *("episode", "--scenario", "sphere", "--seed", "1003", "--steps", "2", "--arm", "none"),
    *(
        "--motion",
        "none",
        "--planner",
        "random",
        "--sensor",
        "ultrasound",
        "--planes",
        "3",
        "--image-pixels",
        "128",
    ),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ultrasound") / "run"
    assert main([*RUN, "--frames", "each", "--out", str(folder)]) == 0
    return folder


def test_the_folder_has_a_picture_an_action_that_tells_where_its_plane_lies(run):
    files = sorted(path.name for path in (run / "ultrasound").iterdir())
    assert files == ["0001.png", "0002.png"]
    with Image.open(run / "ultrasound" / "0001.png") as picture:
        pixels, texts = np.asarray(picture), picture.info
    assert pixels.shape == (128, 128)
    assert pixels[64].max() > 60
    T = np.array(json.loads(texts["T_world_plane"]))
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    # The plane's origin is the tip, and its picture has the depth of the cone.
    steps = (run / "steps.csv").read_text().splitlines()
    row = dict(zip(steps[0].split(","), steps[1].split(","), strict=True))
    np.testing.assert_allclose(T[:3, 3], [float(row[f"position_{axis}_m"]) for axis in "xyz"], atol=1e-9)
    assert 128 * float(texts["pixel_m"]) + float(texts["top_m"]) >= 0.102
    assert int(row["n_points"]) > 300
    assert all(RUN_NAMES.fullmatch(f"ultrasound/{name}") for name in (*files, "0001-02.png"))


def test_frames_have_the_picture_beside_the_scene(run):
    with Image.open(run / "frames" / "0001.png") as frame:
        width, height = frame.size
        panel = np.asarray(frame.crop((width - height + 46, 46, width, height)).convert("L"))
    assert width > 1.9 * height
    # The fan on black: its lower corners are dark, its middle is speckle.
    assert panel[-10:, :60].max() < 10
    middle = panel[200:400, 300:380]
    assert middle.mean() > 60
    assert middle.std() > 8


def test_the_report_has_the_pictures_under_the_slider(run):
    page = (run / "report.html").read_text()
    assert 'id="bmode"' in page
    assert page.count("data:image/webp") == 4
    assert '"bmodes":[1,2]' in page
    assert page.index('id="told"') < page.index('id="bmode"') < page.index('id="frame"')


def test_in_a_browser_the_picture_follows_the_slider(run, browser):
    opened = Opened(browser, run / "report.html", viewport={"width": 1280, "height": 900})
    page, addresses = opened.ready(), []
    for step in (2, 1, 2):
        page.locator("#slider").fill(str(step))
        assert page.locator("#bmode").get_attribute("data-step") == str(step)
        assert page.locator("#frame").get_attribute("data-step") == str(step)
        page.wait_for_function("document.getElementById('bmode').naturalWidth === 128")
        addresses.append(page.locator("#bmode").get_attribute("src"))
    assert addresses[0] == addresses[2] != addresses[1]
    assert opened.complaints == []
    opened.context.close()


def test_a_run_from_its_config_repeats_to_the_byte(run, tmp_path):
    again = tmp_path / "again"
    assert (
        main(["episode", "--config", str(run / "config.json"), "--frames", "none", "--out", str(again)]) == 0
    )
    for name in ("ultrasound/0002.png", "map_probability.nii.gz"):
        assert (again / name).read_bytes() == (run / name).read_bytes()


@pytest.mark.parametrize(("keep", "n_files"), [("all", 6), ("none", 0)])
def test_all_pictures_are_kept_or_none(tmp_path, keep, n_files):
    folder = tmp_path / keep
    assert main([*RUN, "--keep-images", keep, "--map", "when-needed", "--out", str(folder)]) == 0
    assert len([*folder.glob("ultrasound/*.png")]) == n_files


def test_a_run_with_the_exact_cone_has_no_pictures(tmp_path):
    folder = tmp_path / "cone"
    command = ["episode", "--scenario", "sphere", "--steps", "1", "--arm", "none", "--motion", "none"]
    assert main([*command, "--out", str(folder)]) == 0
    assert not (folder / "ultrasound").exists()
    assert "bmode-1" not in (folder / "report.html").read_text()


def test_image_draws_one_picture_and_says_what_it_shows(tmp_path, capsys):
    out = tmp_path / "one.png"
    assert (
        main(["image", "--scenario", "sphere", "--seed", "1003", "--image-pixels", "256", "--out", str(out)])
        == 0
    )
    said = capsys.readouterr().out
    assert "tumour" in said
    assert "from the tip" in said
    with Image.open(out) as picture:
        assert picture.height == 720
        first = np.asarray(picture.convert("L")).copy()
    # A pose by its number is the same picture, another plane another one.
    number = said.split()[1].rstrip(",")
    command = ["image", "--scenario", "sphere", "--seed", "1003", "--image-pixels", "256", "--pose", number]
    assert main([*command, "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert np.array_equal(np.asarray(picture.convert("L")), first)
    assert main([*command, "--rock-deg", "10", "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert not np.array_equal(np.asarray(picture.convert("L")), first)


def test_image_draws_what_the_reader_sees(tmp_path, capsys):
    pictures = []
    for reader in ("exact", "image"):
        out = tmp_path / f"{reader}.png"
        command = ["image", "--scenario", "sphere", "--seed", "1003", "--reader", reader, "--out", str(out)]
        assert main(command) == 0
        assert "tumour           none" not in capsys.readouterr().out
        with Image.open(out) as picture:
            pictures.append(np.asarray(picture.convert("RGB")).astype(int))
    # The exact picture is grey, and on the other stands a blue outline.
    blue = [(each[60:, 80:, 2] - each[60:, 80:, 0]).max() for each in pictures]
    assert blue[0] == 0
    assert blue[1] > 100


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--pose", "1000000"], "--pose 1000000: must be a whole number from 0 to"),
        (["--pose", "1", "2"], "--pose 1.0 2.0: give the number of a pose, or a place as x y z."),
        (["--rock-deg", "90"], "--rock-deg 90.0: must be between -90 and 90 degrees."),
        (["--out", "picture.jpg"], "--out picture.jpg: must end with .png."),
        (["--image-pixels", "10000000"], "--image-pixels 10000000: 16 pictures take"),
        (["--frequency-mhz", "0"], "--frequency-mhz 0.0: must be from 0.5 to 20."),
        (
            ["--array-radius-mm", "5"],
            "--array-radius-mm 5.0: must be more than half of the width of the face",
        ),
        (["--tumour-tissue", "blod"], "--tumour-tissue blod: choose a tissue: gel,"),
        (
            ["--structure-tissue", "rib"],
            "rib: give a structure's name and its tissue as name=tissue.",
        ),
        (["--structure-tissue", "rib=bon"], "--structure-tissue"),
    ],
)
def test_bad_options_are_told_in_a_line(words, told, capsys):
    assert main(["image", "--scenario", "sphere", *words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_without_numba_one_error_names_the_extra(monkeypatch):
    monkeypatch.setattr(
        compiling, "optional_module", lambda _module, *more: optional_module("no_such_module", *more)
    )
    with pytest.raises(
        MissingPackageError, match=r"ultrasound needs numba, which is not installed; run: .*ultrasound"
    ):
        compiled(lambda: 0)
    assert EXTRAS["ultrasound"].package == "numba"


def test_where_no_folder_can_be_written_loops_are_compiled_all_the_same(monkeypatch):
    class Numba:
        def njit(self, *, cache=False, **_more):
            if cache:
                raise RuntimeError("cannot cache function: no locator available")
            return lambda loop: loop

    monkeypatch.setattr(compiling, "optional_module", lambda *_words: Numba())
    assert compiled(abs) is abs
