"""Build the FMU of docs/bring/fmu.md: `python tools/supplier_fmu.py supplier.fmu`, needs a C compiler.

It is the battery of the test suite as a supplier might hand it out: one cell of 2.5 Ah, discharge positive,
milliamperes and per cent, German names, no units told.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from fmu_files import build_fmu, fmu_cell

NAMES = {
    "drive": "Strom",
    "current": "Strom_ist",
    "voltage": "Klemmenspannung",
    "soc": "Ladezustand",
    "temperature": "T_Zelle",
    "ambient": "T_Umgebung",
}


def build(path: Path) -> None:
    """Write the FMU."""
    with tempfile.TemporaryDirectory() as folder:
        made = build_fmu(
            Path(folder),
            cell=fmu_cell(),
            positive="discharge",
            units={"drive": "mA", "soc": "%"},
            declare="no",
            names=NAMES,
            identifier="Zelle",
            kind="cs",
        )
        path.write_bytes(Path(made).read_bytes())


if __name__ == "__main__":
    build(Path(sys.argv[1]))
