"""The page on sensing has the table of tissues as the code has it."""

import re
from pathlib import Path

from sim.world.sensing.ultrasound.tissues import SILENT_DB, TISSUES

PAGE = Path(__file__).resolve().parents[2] / "docs" / "sensing.md"


def test_the_table_of_tissues_is_that_of_the_code():
    rows = re.findall(
        r"^\| `([\w-]+)`[^|]*\| ([\d.]+) \| ([\d.]+) \| (\S+) \|$", PAGE.read_text(), re.MULTILINE
    )
    found = {
        name: (
            float(impedance),
            float(attenuation),
            SILENT_DB if backscatter == "none" else float(backscatter),
        )
        for name, impedance, attenuation, backscatter in rows
    }
    assert found == {
        name: (each.impedance_mrayl, each.attenuation_db_cm_mhz, each.backscatter_db)
        for name, each in TISSUES.items()
    }
