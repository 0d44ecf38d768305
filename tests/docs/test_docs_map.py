"""The example on the page about the map runs and finds its tumour."""

import re
from pathlib import Path


def test_the_pages_example_maps_its_tumour(capsys):
    page = (Path(__file__).resolve().parents[2] / "docs" / "map.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL):
        exec(compile(block, "docs/map.md", "exec"), names)  # the page's own code, from this repository
    # A thousand noiseless points in a box of 6 cm see all of a ball of 24 mm.
    assert names["metrics"].auprc > 0.95
    assert capsys.readouterr().out.startswith("rank ")


def test_every_module_the_page_names_exists():
    root = Path(__file__).resolve().parents[2]
    page = (root / "docs" / "map.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+\.py)`", page))
    assert len(named) >= 8
    assert named <= {path.name for path in (root / "mapping").rglob("*.py")}
