"""Text files as people's editors write them: with a byte order mark, and with any line ends."""

import codecs

import pytest

from sim.campaign.study_file import load_study
from sim.episode.scenario_file import load_scenario
from sim.errors import UsageError
from sim.tables import read_rows
from sim.world.text import decoded, read_text

MARKS = {
    "utf-8": lambda text: text.encode(),
    "utf-8 with mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "utf-16": lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
    "utf-16 the other way": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
}


@pytest.mark.parametrize("mark", MARKS)
def test_scenarios_and_studies_are_read_with_any_mark(tmp_path, mark):
    path = tmp_path / "case.toml"
    path.write_bytes(MARKS[mark]('base = "sphere"\r\nn_tumours = 2\r\n'))
    assert load_scenario(str(path)).n_tumours == 2
    path.write_bytes(MARKS[mark]('title = "Größen"\r\n[axes]\r\nscenario = ["sphere"]\r\nseed = "0:2"\r\n'))
    study = load_study(str(path))
    assert study.title == "Größen"


def test_what_is_no_text_is_still_refused(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes("name = 'Läsion'".encode("cp1252"))
    with pytest.raises(UsageError, match="not a valid TOML file"):
        load_scenario(str(path))


def test_a_table_with_a_mark_has_its_first_column(tmp_path):
    path = tmp_path / "table.csv"
    path.write_bytes(codecs.BOM_UTF8 + b"a,b\r\n1,2\r\n")
    assert read_rows(path) == [{"a": "1", "b": "2"}]


def test_text_that_need_not_be_utf_8_is_western_european_then(tmp_path):
    assert decoded("Läsion".encode("cp1252")) == "Läsion"
    assert decoded(bytes(range(128, 256)))  # every byte is a letter
    path = tmp_path / "x.txt"
    path.write_bytes(b"a\r\nb\rc\n")
    assert read_text(path) == "a\nb\nc\n"
