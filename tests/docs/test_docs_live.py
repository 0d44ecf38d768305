"""The page about live probes: its code runs, and its tables tell every device and every reason."""

import re
import typing

from page_commands import ROOT, blocks

from sim.live.errors import Refusal
from sim.live.igtl import messages

PAGE = ROOT / "docs" / "live.md"
TEXT = PAGE.read_text(encoding="utf-8")
ROW = r"^\| `([^`]+)` \|"


def test_the_code_of_the_page_runs(capsys) -> None:
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE.name, "exec"), {})  # the page's own code, from this repository
    assert capsys.readouterr().out == "2 1\n"


def test_the_tables_name_every_device_and_every_reason() -> None:
    devices = {value for name, value in vars(messages).items() if name.isupper() and isinstance(value, str)}
    assert set(re.findall(ROW, TEXT, re.MULTILINE)) == devices | set(typing.get_args(Refusal))
