"""Make the drive cycles in drivecycles/data from the wheels that carry them.

    pip download --no-deps --only-binary :all: --python-version 3.11 fastsim==2.1.5 carculator_utils==1.3.5
    python tools/import_cycles.py fastsim-2.1.5-*.whl carculator_utils-1.3.5-*.whl [--check]

Values are copied as text, digit by digit: only columns are dropped and the header is renamed. With --check
nothing is written and the exit code tells whether the committed files are what this script would make.
"""

import argparse
import csv
import hashlib
import io
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

DATA = Path(__file__).resolve().parents[1] / "drivecycles" / "data"
CARCULATOR_FILE = "carculator_utils/data/driving_cycles/car.csv"


@dataclass(frozen=True)
class Source:
    """One cycle: our file, its file in a wheel, and the (source column, our header) pairs kept."""

    file: str
    package: str
    member: str
    columns: tuple[tuple[str, str], ...]
    note: str = ""


def fastsim(
    file: str, member: str, *, grade: bool = False, time: str = "cycSecs", speed: str = "cycMps"
) -> Source:
    """Describe a cycle of fastsim, whose speeds are in m/s."""
    columns = [(time, "time_s"), (speed, "speed_mps")]
    if grade:
        columns.append(("cycGrade" if time == "cycSecs" else "grade", "grade"))
    note = "" if grade or time == "time_s" else "grade is zero throughout and left out"
    return Source(file, "fastsim 2.1.5", f"fastsim/resources/cycles/{member}", tuple(columns), note)


def carculator(file: str, column: str, note: str = "") -> Source:
    """Describe a cycle of carculator_utils: one column of a table in km/h."""
    columns = (("Time (s)", "time_s"), (column, "speed_kmh"))
    return Source(file, "carculator_utils 1.3.5", CARCULATOR_FILE, columns, note)


SOURCES = (
    fastsim("ftp72.csv", "udds.csv"),
    fastsim("hwfet.csv", "hwfet.csv"),
    fastsim("us06.csv", "us06.csv"),
    fastsim("wltc-3a.csv", "wltc_3a.csv"),
    fastsim("wltc-3b.csv", "wltc_3b.csv"),
    fastsim("trip-42648.csv", "TSDC_tripno_42648_cycle.csv", grade=True, time="time_s", speed="mps"),
    fastsim("long-haul.csv", "longHaulDriveCycle.csv", grade=True),
    carculator("nedc.csv", "NEDC", "lasts 1200 s and 10.931 km; the regulation has 1180 s and 11.007 km"),
    carculator("artemis-urban.csv", "CADC Urban"),
    carculator("artemis-rural.csv", "CADC Road"),
    carculator("artemis-motorway-130.csv", "CADC Motorway 130"),
    carculator("artemis-motorway-150.csv", "CADC Motorway"),
)

LICENSES = {
    "fastsim-LICENSE.txt": ("fastsim", "license_files/LICENSE"),
    "fastsim-NOTICE.txt": ("fastsim", "license_files/NOTICE"),
    "carculator_utils-LICENSE.txt": ("carculator_utils", "licenses/LICENSE"),
}

PROVENANCE_HEAD = """\
# Where the drive cycles come from

Written by `tools/import_cycles.py`, which makes every CSV here from two wheels on PyPI. Values are the
sources', digit by digit; columns that we do not use are left out (road type, and grade where it is zero
throughout), headers are renamed so that they carry units, and a comment line names the source.

| package | licence | wheel | SHA-256 of the wheel |
|---|---|---|---|
"""

PROVENANCE_NOTES = """
- fastsim: Copyright 2020 Alliance for Sustainable Energy, LLC; Apache-2.0, see
  `licenses/fastsim-LICENSE.txt` and `licenses/fastsim-NOTICE.txt`. Releases from 3.0 on no longer carry these
  cycles. Its `udds.csv` is FTP-72.
- carculator_utils: Copyright 2020 Paul Scherrer Institut; BSD-3-Clause, see
  `licenses/carculator_utils-LICENSE.txt`. Its WLTC is a version before the final one and is not used.
- `long-haul` has 83,043 samples, from 0 to 83,042 s.
- `wltc-3a` and `wltc-3b`: the speeds in km/h add up to 83496.9 and 83758.6, the checksums of UN GTR 15.
- `nedc`: the source repeats the urban part every 196 s instead of 195 s and pads the end, hence its 1200 s.
- The preset `larsson` has no file: `hwfet` and `ftp72`, twice, with the altitude profile of `larsson.py`.

| our file | file in the package | columns kept | SHA-256 of the source file | SHA-256 of our file | remarks |
|---|---|---|---|---|---|
"""


def sha256(content: bytes) -> str:
    """Return the hexadecimal SHA-256 digest."""
    return hashlib.sha256(content).hexdigest()


def convert(source: Source, raw: bytes) -> bytes:
    """Return our CSV for a source file: wanted columns, rows up to the last filled cell, text unchanged."""
    text = raw.decode("utf-8-sig")
    delimiter = ";" if ";" in text.split("\n", 1)[0] else ","
    rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    header = [cell.strip() for cell in rows[0]]
    wanted = [header.index(name) for name, _ in source.columns]
    kept = [[row[i].strip() for i in wanted] for row in rows[1:] if row]
    while kept and not kept[-1][1]:
        kept.pop()
    if not all(cell for row in kept for cell in row):
        raise ValueError(f"{source.member}: a blank cell inside the cycle of {source.file}")
    names = ", ".join(f"'{name}'" for name, _ in source.columns)
    lines = [f"# Source: {source.package}, {source.member}, columns {names}; see PROVENANCE.md"]
    lines.append(",".join(name for _, name in source.columns))
    lines += [",".join(row) for row in kept]
    return ("\n".join(lines) + "\n").encode()


def build(wheels: dict[str, Path]) -> dict[str, bytes]:
    """Return the content of every file that this script makes, by path below the data folder."""
    files: dict[str, bytes] = {}
    table: list[str] = []
    checksums = ["# SHA-256 of every cycle file, and of the file it was made from; see PROVENANCE.md", ""]
    archives = {package: zipfile.ZipFile(path) for package, path in wheels.items()}
    for source in SOURCES:
        raw = archives[source.package.split()[0]].read(source.member)
        ours = files[source.file] = convert(source, raw)
        columns = ", ".join(f"`{name}`" for name, _ in source.columns)
        table.append(
            f"| {source.file} | {source.package}, `{source.member}` | {columns} | `{sha256(raw)}` "
            f"| `{sha256(ours)}` | {source.note} |"
        )
        checksums += [
            f'["{source.file}"]',
            f'sha256 = "{sha256(ours)}"',
            f'source_sha256 = "{sha256(raw)}"',
            "",
        ]
    for file, (package, suffix) in LICENSES.items():
        member = next(name for name in archives[package].namelist() if name.endswith(f".dist-info/{suffix}"))
        files[f"licenses/{file}"] = archives[package].read(member)
    licences = {"fastsim": "Apache-2.0", "carculator_utils": "BSD-3-Clause"}
    packages = [
        f"| {package} | {licences[package]} | {path.name} | `{sha256(path.read_bytes())}` |"
        for package, path in wheels.items()
    ]
    head = PROVENANCE_HEAD + "\n".join(packages) + "\n" + PROVENANCE_NOTES
    files["PROVENANCE.md"] = (head + "\n".join(table) + "\n").encode()
    files["checksums.toml"] = ("\n".join(checksums).rstrip() + "\n").encode()
    return files


def main() -> int:
    """Write the files, or compare them with --check."""
    parser = argparse.ArgumentParser(description="Make drivecycles/data from the wheels of two packages.")
    parser.add_argument("fastsim", type=Path, help="wheel of fastsim 2.1.5")
    parser.add_argument("carculator_utils", type=Path, help="wheel of carculator_utils 1.3.5")
    parser.add_argument(
        "--check", action="store_true", help="compare with the committed files, write nothing"
    )
    arguments = parser.parse_args()
    files = build({"fastsim": arguments.fastsim, "carculator_utils": arguments.carculator_utils})
    if arguments.check:
        differing = [name for name, content in files.items() if (DATA / name).read_bytes() != content]
        print(
            "\n".join(f"differs: {name}" for name in differing) or f"{len(files)} files are as they should be"
        )
        return int(bool(differing))
    (DATA / "licenses").mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (DATA / name).write_bytes(content)
        print(f"{name}: {len(content)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
