"""The committed cycles: checksums, published figures, names; and the preset `larsson`."""

import hashlib
import tomllib
from pathlib import Path

import numpy as np
import pytest

import drivecycles
from drivecycles import CycleError, cycle_info, cycle_names, load_cycle
from drivecycles.larsson import larsson_altitude_m

DATA = Path(drivecycles.__file__).parent / "data"
CHECKSUMS = tomllib.loads((DATA / "checksums.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("file", sorted(CHECKSUMS))
def test_committed_values_are_the_recorded_ones(file: str) -> None:
    # A checkout may turn line ends to CRLF; the values are meant.
    content = (DATA / file).read_bytes().replace(b"\r\n", b"\n")
    assert hashlib.sha256(content).hexdigest() == CHECKSUMS[file]["sha256"]
    provenance = (DATA / "PROVENANCE.md").read_text(encoding="utf-8")
    assert f"`{CHECKSUMS[file]['source_sha256']}` | `{CHECKSUMS[file]['sha256']}`" in provenance


def test_every_file_is_registered_and_recorded() -> None:
    registered = {info.file for info in map(cycle_info, cycle_names()) if info.file}
    assert registered == set(CHECKSUMS) == {path.name for path in DATA.glob("*.csv")}
    licences = {path.name: path.read_text(encoding="utf-8") for path in (DATA / "licenses").iterdir()}
    assert "Apache License" in licences["fastsim-LICENSE.txt"]
    assert "Alliance for Sustainable Energy" in licences["fastsim-NOTICE.txt"]
    assert "Paul Scherrer Institut" in licences["carculator_utils-LICENSE.txt"]


@pytest.mark.parametrize(
    ("name", "duration_s", "distance_km", "tolerance_km"),
    [
        ("udds", 1369, 11.990, 0.0005),
        ("hwfet", 765, 16.507, 0.0005),
        ("us06", 600, 12.888, 0.0005),
        ("wltc-3a", 1800, 83496.9 / 3600, 1e-6),
        ("wltc-3b", 1800, 83758.6 / 3600, 1e-6),
        ("artemis-urban", 993, 4.870, 0.0005),
        ("artemis-rural", 1081, 17.272, 0.0005),
        ("artemis-motorway-130", 1067, 28.736, 0.0005),
        ("artemis-motorway-150", 1067, 29.545, 0.0005),
        ("nedc", 1200, 10.931, 0.0005),
        ("trip-42648", 300, 3.415, 0.0005),
        ("long-haul", 83042, 804.615, 0.0005),
        ("larsson", 4268, 57.0, 0.01),
    ],
)
def test_duration_and_distance(name: str, duration_s: float, distance_km: float, tolerance_km: float) -> None:
    cycle = load_cycle(name)
    assert cycle.duration_s == duration_s
    assert cycle.step_s == 1.0
    assert cycle.distance_m / 1000 == pytest.approx(distance_km, abs=tolerance_km)
    assert cycle.speed_mps[0] == cycle.speed_mps[-1] == 0.0


@pytest.mark.parametrize(("name", "sum_kmh"), [("wltc-3a", 83496.9), ("wltc-3b", 83758.6)])
def test_wltc_checksums(name: str, sum_kmh: float) -> None:
    assert 3.6 * load_cycle(name).speed_mps.sum() == pytest.approx(sum_kmh, abs=0.05)


@pytest.mark.parametrize(
    ("name", "max_kmh"),
    [
        ("udds", 91.2),
        ("hwfet", 96.4),
        ("us06", 129.2),
        ("wltc-3b", 131.3),
        ("nedc", 120.0),
        ("artemis-urban", 57.7),
    ],
)
def test_published_top_speeds(name: str, max_kmh: float) -> None:
    assert 3.6 * load_cycle(name).statistics().max_speed_mps == pytest.approx(max_kmh, abs=0.06)


def test_udds_stops_seventeen_times() -> None:
    assert load_cycle("udds").statistics().stops == 17


def test_graded_cycles_have_hills_and_test_cycles_none() -> None:
    trip = load_cycle("trip-42648")
    # 0.0496 and -0.0411 are the extreme grades in the file; the mean of two neighbours cannot exceed them.
    assert -0.0411 <= trip.grade.min() < -0.03
    assert 0.03 < trip.grade.max() <= 0.0496
    assert len(load_cycle("long-haul")) == 83043
    assert load_cycle("long-haul").ascent_m > 500
    assert load_cycle("us06").ascent_m == 0


def test_larsson_is_two_equal_laps_over_hills_that_close() -> None:
    cycle = load_cycle("larsson")
    lap = load_cycle("hwfet+ftp72")
    half = len(lap) - 1
    assert lap.duration_s == 2134
    assert np.array_equal(cycle.speed_mps[: half + 1], lap.speed_mps)
    assert np.array_equal(cycle.speed_mps[half:], lap.speed_mps)
    assert cycle.altitude_m[[0, half, -1]] == pytest.approx(np.zeros(3), abs=1e-9)
    assert cycle.altitude_m[half:] == pytest.approx(cycle.altitude_m[: half + 1], abs=1e-9)
    assert np.abs(cycle.grade).max() < 0.018
    assert 15 < cycle.altitude_m.max() < 21
    assert -21 < cycle.altitude_m.min() < -15


def test_larsson_profile_is_smooth_where_laps_meet() -> None:
    lap, d = 28_500.0, 0.1
    z = larsson_altitude_m(np.array([lap - d, lap, lap + d]), lap)
    assert (z[1] - z[0]) / d == pytest.approx((z[2] - z[1]) / d, rel=1e-5)


@pytest.mark.parametrize(
    ("given", "canonical"),
    [
        ("UDDS", "ftp72"),
        ("FTP-72", "ftp72"),
        ("ftp_72", "ftp72"),
        (" HWFET ", "hwfet"),
        ("WLTC 3a", "wltc-3a"),
        ("wltc3b", "wltc-3b"),
        ("cadc-road", "artemis-rural"),
        ("Larsson", "larsson"),
    ],
)
def test_names_and_aliases(given: str, canonical: str) -> None:
    assert load_cycle(given).name == canonical
    assert cycle_info(given).name == canonical


def test_aliases_do_not_collide() -> None:
    infos = [cycle_info(name) for name in cycle_names()]
    known = [alias.replace("-", "").lower() for info in infos for alias in (info.name, *info.aliases)]
    assert len(known) == len(set(known))


def test_joined_names_and_files(tmp_path: Path) -> None:
    path = tmp_path / "to+fro.csv"
    path.write_text("time_s,speed_mps\n0,0\n1,2\n2,0\n", encoding="utf-8")
    assert load_cycle(str(path)).name == load_cycle(path).name == "to+fro"
    plain = path.rename(tmp_path / "hop.csv")
    both = load_cycle(f"us06 + {plain}")
    assert (both.name, both.duration_s) == ("us06+hop", 602)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hwfett", r"there is no cycle 'hwfett'; did you mean 'hwfet'\? Known cycles: larsson, ftp72"),
        ("uds", r"did you mean 'ftp72'\?"),
        ("wltc-3c", r"did you mean 'wltc-3.'\?"),
        ("hwfet+uss06", r"there is no cycle 'uss06'; did you mean 'us06'\?"),
        ("zzzzzz", "there is no cycle 'zzzzzz'; Known cycles"),
        ("", "has an empty part"),
        ("hwfet+", "has an empty part"),
        ("nowhere.csv", "there is no file nowhere.csv"),
    ],
)
def test_unknown_names(spec: str, message: str) -> None:
    with pytest.raises(CycleError, match=message):
        load_cycle(spec)


def test_unknown_info() -> None:
    with pytest.raises(CycleError, match="did you mean 'nedc'"):
        cycle_info("nedcc")


def test_loading_is_shared_and_safe() -> None:
    first = load_cycle("us06")
    with pytest.raises(ValueError, match="read-only"):
        first.speed_mps[0] = 1.0
    assert np.array_equal(load_cycle("us06").speed_mps, first.speed_mps)
