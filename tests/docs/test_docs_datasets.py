"""The page about datasets: its code runs."""

import pytest
from page_commands import ROOT, blocks

pytest.importorskip("pyarrow")
PAGE = ROOT / "docs" / "datasets.md"


@pytest.mark.slow
def test_the_code_of_the_page_runs(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE.name, "exec"), {})  # the page's own code, from this repository
    assert capsys.readouterr().out.splitlines()[-1] == "(22, 22, 13)"
