"""`socwise inertia`: what is shown and stored is what the estimators said of synthetic and logged drives."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run, tree

from socwise.commands.inertia_options import names_of
from socwise.commands.inertia_table import plus_minus
from socwise.commands.options import key_values
from socwise.figures.inertia import plot_quantity, quantity_label
from socwise.inertia import InertiaRun, grouped, honesty, lean, runs_over, spread, to_json
from socwise.inertia_cases import METHODS, MODES, allowed_for, run_mass_spring, run_synthetic, run_vehicle
from socwise.results.estimate import read_series
from vehicle.inertia.estimation import estimate
from vehicle.inertia.load_transfer import NAMES
from vehicle.inertia.log_columns import find_columns
from vehicle.inertia.mass_spring import simulate
from vehicle.inertia.read_log import REQUIRED
from vehicle.inertia.record import InertiaEstimate
from vehicle.inertia.sensors import RIDE_SENSORS, ROAD_SENSORS, ROAD_SENSORS_GAIN
from vehicle.inertia.synthetic import synthetic

SHORT = ("--duration", "20")
LENGTHS = ("--geometry", "wheelbase_m=2.794", "--geometry", "track_m=1.79")
CORNERS = ("fl", "fr", "rl", "rr")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def inertia(capsys, *arguments):
    shown = run(capsys, "inertia", *arguments)
    assert (shown.code, shown.err) == (0, "")
    return shown.out


@pytest.fixture(scope="module")
def drive():
    """Half a minute of a rural drive, with the sensors' noise."""
    return synthetic("rural", seed=4, duration_s=30.0, sensors=ROAD_SENSORS)[0]


def write_log(log, path=Path("log.csv")):
    """Write a drive with its corners as a user would log it: kN, g and km/h, to many digits."""
    columns = {
        "time_s": log.time_s,
        **{f"Force {c.upper()} [kN]": f / 1e3 for c, f in zip(CORNERS, log.forces_N.T, strict=True)},
        "ax [g]": log.ax_mps2 / 9.80665,
        "ay_mps2": log.ay_mps2,
        **{f"az_{c}_mps2": a for c, a in zip(CORNERS, log.corner_az_mps2.T, strict=True)},
        "speed [km/h]": 3.6 * log.speed_mps,
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")


def run_of(value, sd, truth, seed=0, method="gpc", covariance=None):
    """Build a run of one quantity, whose estimate stays what it is."""
    made = InertiaEstimate(
        method,
        np.array([0.0, 1.0]),
        ("mass_kg",),
        np.full((2, 1), value),
        np.full((2, 1), sd),
        np.array([[sd**2 if covariance is None else covariance]]),
    )
    return InertiaRun("ride", "rural", seed, made, {"mass_kg": truth}, 0.1)


def test_numbers_and_traces_are_those_of_the_filters(capsys):
    out = inertia(capsys, "mass-spring", "--seed", "3", "--method", "full-germ,ekf", *SHORT, "--json")
    found = json.loads(out)
    assert found["schema"] == 1
    assert found["data"] == {"source": None, "seeds": [3]}
    log = simulate(seed=3, duration_s=20.0, position_m=0.2)
    for entry, direct in zip(
        found["estimates"], run_mass_spring(log, ["full_germ", "ekf"], seed=3), strict=True
    ):
        one = direct.estimate
        assert (entry["method"], entry["seed"], entry["nis"]) == (one.method, 3, one.nis)
        mass = entry["parameters"]["mass_kg"]
        assert mass["value"] == one.final["mass_kg"]
        assert mass["sd"] == one.final_sd["mass_kg"]
        assert mass["truth"] == 250.0
        assert mass["error"] == pytest.approx(one.final["mass_kg"] / 250.0 - 1.0)
        assert mass["settled_s"] == one.settled_s[2]
        assert entry["parameters"]["position_m"]["settled_s"] is None
        assert entry["nees"] == pytest.approx(direct.estimate.nees(log.final_truth))
        stored = read_series(Path(f"results/inertia/{direct.label}.nc"))
        np.testing.assert_array_equal(stored["time_s"], one.time_s)
        values, sds = one.column("mass_kg")
        np.testing.assert_array_equal(stored["mass_kg"], values)
        np.testing.assert_array_equal(stored["mass_kg_sd"], sds)


def test_every_quantity_has_a_row_for_every_method(capsys):
    out = inertia(capsys, "mass-spring", *SHORT)
    rows = [line.split("  ")[0] for line in out.splitlines()]
    for label in ("gPC-EKF, full germ", "gPC-EKF, report", "gPC-EKF, unmodified", "EKF", "UKF"):
        assert rows.count(label) == 3
    assert {"position [m]", "velocity [m/s]", "mass [kg]"} <= {row.strip() for row in rows}
    assert max(len(line) for line in out.splitlines()) <= 100


def test_ride_has_every_method_and_warns_of_the_biased_one(capsys):
    out = inertia(capsys, "ride", *SHORT)
    for label in ("gPC-EKF", "gPC-EKF, report", "RLS, force form", "RLS, acceleration form", "EKF", "UKF"):
        assert sum(line.startswith(f"{label} ") and "±" in line for line in out.splitlines()) == 4
    assert "RLS, force form: biased" in out


def test_load_transfer_runs_both_models(capsys):
    arguments = ("load-transfer", *SHORT, "--scenario", "rural", "--method", "gpc", "--json")
    found = json.loads(inertia(capsys, *arguments))
    kinds = [(one["model"], one["scenario"]) for one in found["estimates"]]
    assert kinds == [("ltm", "rural"), ("mltm", "rural")]
    for one in found["estimates"]:
        assert tuple(one["parameters"]) == NAMES
        assert any("drag_kgpm is not identifiable" in note for note in one["notes"])
        mass = one["parameters"]["mass_kg"]
        assert abs(mass["value"] - mass["truth"]) < 4.0 * mass["sd"]


def test_gains_are_allowed_for_in_the_standard_deviations():
    assert allowed_for(RIDE_SENSORS) is None
    assert allowed_for(ROAD_SENSORS_GAIN) is ROAD_SENSORS_GAIN
    common = ("rural", 0, ["gpc"])
    with_gain, without = (
        run_synthetic(["mltm"], *common, sensors, duration_s=20.0)[0].estimate.final_sd["mass_kg"]
        for sensors in (ROAD_SENSORS_GAIN, ROAD_SENSORS)
    )
    # Four independent gains of 1 % move the mass by about 1 % / sqrt(4).
    assert with_gain == pytest.approx(1873.0 * 0.01 / 2.0, rel=0.1)
    assert without < 0.5 * with_gain


def test_seeds_give_errors_and_files_of_the_first(capsys, folder):
    arguments = ("mass-spring", "--seeds", "3", "--seed", "5", "--method", "full-germ,ukf", *SHORT)
    result = json.loads(inertia(capsys, *arguments, "--json"))
    assert [one["seed"] for one in result["estimates"]] == [5, 5, 6, 6, 7, 7]
    summary = {one["method"]: one for one in result["summary"]}
    mine = [one for one in result["estimates"] if one["method"] == "ukf"]
    errors = np.array([one["parameters"]["mass_kg"]["error"] for one in mine])
    assert summary["ukf"]["runs"] == 3
    assert summary["ukf"]["errors"]["mass_kg"]["worst"] == pytest.approx(np.abs(errors).max())
    assert summary["ukf"]["nees"]["mean"] == pytest.approx(np.mean([one["nees"] for one in mine]))
    files = tree(folder / "results/inertia")
    manifest = json.loads(files["manifest.json"])
    assert manifest["files"] == sorted(name for name, content in files.items() if content is not None)
    assert manifest["settings"]["methods"] == ["full_germ", "ukf"]
    assert {"mass-spring-ukf.nc", "summary.csv", "figures/mass-spring.png"} <= files.keys()
    assert len(files["summary.csv"].decode().splitlines()) == 7
    out = inertia(capsys, *arguments)
    assert "3 synthetic logs, seeds 5 to 7" in out
    assert "NEES" in out
    again = tree(folder / "results/inertia")
    assert [name for name in files if files[name] != again[name] and name != "result.json"] == []


def test_a_log_of_the_users_own_gives_what_the_estimator_gives(capsys, drive):
    write_log(drive)
    out = inertia(capsys, "load-transfer", "--data", "log.csv", *LENGTHS, "--method", "gpc", "--json")
    found = json.loads(out)
    assert found["data"]["samples"] == drive.time_s.size
    assert found["data"]["columns"]["force_fl"] == "Force FL [kN]"
    direct = estimate("mltm", drive, consider=ROAD_SENSORS_GAIN)
    for name, one in found["estimates"][0]["parameters"].items():
        assert one["value"] == pytest.approx(direct.final[name], rel=1e-6)
        assert one["sd"] == pytest.approx(direct.final_sd[name], rel=1e-4)
        assert one["truth"] is None


def test_names_of_the_users_own(capsys, drive):
    write_log(drive)
    text = Path("log.csv").read_text().replace("Force FL [kN]", "S1").replace("ay_mps2", "quer")
    Path("log.csv").write_text(text)
    arguments = ("load-transfer", "--data", "log.csv", *LENGTHS, "--method", "gpc")
    shown = run(capsys, "inertia", *arguments)
    assert shown.code == 2
    assert "there is no column for force_fl" in shown.err
    assert run(capsys, "inertia", *arguments, "--column", "force_fl=S1:kN").err.count("'quer'") == 1
    own = ("--column", "force_fl=S1:kN", "--column", "ay=quer:m/s2")
    assert json.loads(inertia(capsys, *arguments, *own, "--json"))["data"]["columns"]["ay"] == "quer"


def test_a_vehicle_far_from_the_prior_is_told_of(drive):
    def notes(method, **known):
        return " ".join(run_vehicle("mltm", drive, [method], **known)[0].estimate.notes)

    narrow = {"mass_kg": (1000.0, 200.0)}
    assert "outside the prior" in notes("gpc", prior=narrow)
    assert "--prior mass_kg=1" in notes("gpc", prior=narrow)
    assert "outside the prior" not in notes("gpc") + notes("rls-force", prior=narrow)


def test_a_mass_on_a_spring_from_a_log(capsys):
    log = simulate(seed=1, duration_s=20.0)
    table = np.column_stack([log.time_s, 1e3 * log.position_m])
    np.savetxt("log.csv", table, delimiter=",", header="t [s],x [mm]", comments="", fmt="%.12g")
    found = json.loads(inertia(capsys, "mass-spring", "--data", "log.csv", "--method", "ukf", "--json"))
    direct = run_mass_spring(log, ["ukf"])[0].estimate
    mass = found["estimates"][0]["parameters"]["mass_kg"]
    assert mass["value"] == pytest.approx(direct.final["mass_kg"], rel=1e-6)
    assert (found["estimates"][0]["nees"], found["summary"][0]["nees"]) == (None, None)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["ride", "--method", "gcp"], ["'gcp'", "did you mean 'gpc'?"]),
        (["ride", "--method", "ekf,EKF"], ["'EKF' twice"]),
        (["ride", "--scenario", "motorway"], ["'motorway'", "urban, rural"]),
        (["ride", "--road", "Z"], ["road class 'Z'"]),
        (["ride", "--duration", "0.1"], ["2 s to 10 h"]),
        (["ride", "--sensors", "gain=1"], ["'gain'", "strut_gain_sd"]),
        (["ride", "--sensors", "strut_gain_sd=1"], ["strut_gain_sd=1", "less than 0.3"]),
        (["ride", "--sensors", "strut_gain_sd"], ["KEY=VALUE"]),
        (["ride", "--geometry", "wheelbase_m=1"], ["wheelbase_m=1", "between the axles"]),
        (["ride", "--prior", "mass_kg=100"], ["--prior is 'mass_kg=100'", "CENTRE,HALF"]),
        (["ride", *SHORT, "--prior", "mass=100,50"], ["'mass'"]),
        (["ride", *SHORT, "--prior", "mass_kg=100,500"], ["prior of mass_kg"]),
        (["ride", "--column", "ax=a:g"], ["--column is for a log of your own"]),
        (["ride", "--data", "log.csv", "--seeds", "3"], ["--seeds is for a synthetic log"]),
        (["ride", "--data", "log.csv", "--column", "ax"], ["CHANNEL=NAME"]),
        (["ride", "--data", "log.csv"], ["lengths of your vehicle", "--geometry cg_from_left_m="]),
        (["load-transfer", "--data", "absent.csv", *LENGTHS], ["there is no file absent.csv"]),
        (["load-transfer", "--model", "ltn"], ["'ltn'", "did you mean 'ltm'?"]),
        (["mass-spring", "--set", "mass=3"], ["'mass'", "did you mean 'mass_kg'?"]),
        (["mass-spring", "--set", "order=9"], ["order=9", "less than or equal to 5"]),
        (["mass-spring", "--stiffness", "250"], ["resonance"]),
        (["mass-spring", "--duration", "nan"], ["duration_s"]),
        (["mass-spring", "--duration", "0"], ["duration_s must be positive"]),
        (
            ["ride", "--geometry", "wheelbase_m=2794"],
            ["wheelbase_m=2794", "equal to 30", "in m"],
        ),
        (["load-transfer", "--geometry", "track_m=1790"], ["track_m=1790", "equal to 10", "in m"]),
        (["mass-spring", "--out", "notes"], ["thesis.txt", "nothing was touched"]),
    ],
)
def test_what_cannot_be_used(capsys, folder, arguments, parts):
    (folder / "notes").mkdir()
    (folder / "notes" / "thesis.txt").write_text("years of work")
    before = tree(folder)
    shown = run(capsys, "inertia", *arguments)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("socwise: ")
    assert [part for part in parts if part not in shown.err] == []
    assert tree(folder) == before


def test_constant_signals_holes_and_gaps_are_told_of(capsys, drive):
    write_log(drive)
    arguments = ("load-transfer", "--data", "log.csv", *LENGTHS, "--method", "gpc")
    rows = Path("log.csv").read_text().splitlines()
    at = rows[0].split(",").index("Force FL [kN]")
    stuck = [rows[0]] + [
        ",".join(["4.7" if k == at else c for k, c in enumerate(row.split(","))]) for row in rows[1:]
    ]
    Path("log.csv").write_text("\n".join(stuck))
    shown = run(capsys, "inertia", *arguments)
    assert shown.code == 2
    assert "force_fl ('Force FL [kN]') is 4700 throughout" in shown.err
    cells = rows[50].split(",")
    cells[at] = ""
    Path("log.csv").write_text("\n".join([*rows[:50], ",".join(cells), *rows[51:1000], *rows[1800:]]))
    shown = run(capsys, "inertia", *arguments)
    assert shown.code == 0
    assert "truth" not in shown.out
    assert shown.out.startswith("log.csv: 2,200 samples in 30 s")
    assert "warning: 1 gap(s) in time, the longest 8.01 s" in shown.err
    assert (
        "note: 1 of 2201 rows lack a value of force_fl, the first in line 51; they were left out"
        in " ".join(shown.out.split())
    )


def test_a_thin_log_warns_of_its_heights(capsys, drive):
    write_log(drive)
    rows = Path("log.csv").read_text().splitlines()
    Path("log.csv").write_text("\n".join([rows[0], *rows[1::10]]))
    arguments = ("load-transfer", "--data", "log.csv", *LENGTHS, "--method", "gpc,ekf")
    text = " ".join(inertia(capsys, *arguments).split())
    assert text.count("samples per block of 1 s: 10; noise and sway that are left in ay and ax are") == 1
    found = json.loads(inertia(capsys, *arguments, "--json"))
    for one in found["estimates"]:
        assert any(note.startswith("samples per block of 1 s: 10;") for note in one["notes"])


def test_a_log_whose_z_points_down_is_refused(capsys, drive):
    write_log(replace(drive, corner_az_mps2=-drive.corner_az_mps2))
    shown = run(capsys, "inertia", "load-transfer", "--data", "log.csv", *LENGTHS)
    assert (shown.code, shown.out) == (2, "")
    assert "az_fl ('az_fl_mps2') is -9.81 m/s2 in the mean" in " ".join(shown.err.split())


def test_other_results_are_not_touched(capsys, folder):
    (folder / "results/inertia").mkdir(parents=True)
    (folder / "results/inertia/manifest.json").write_text('{"format": "socwise comparison", "files": []}')
    shown = run(capsys, "inertia", "mass-spring", *SHORT)
    assert shown.code == 2
    assert "holds a socwise comparison" in shown.err


def test_spread_and_honesty_by_hand():
    runs = [run_of(value, 20.0, 1000.0, seed) for seed, value in enumerate((1010.0, 970.0, 1020.0))]
    found = spread(runs, "mass_kg")
    assert (found.mean, found.worst, found.sd) == pytest.approx((0.0, 0.03, 0.02))
    assert found.rms == pytest.approx(np.sqrt((0.01**2 + 0.03**2 + 0.02**2) / 3))
    assert spread(runs, "cg_height_m") is None
    assert honesty(runs).mean == pytest.approx((0.25 + 2.25 + 1.0) / 3)
    assert honesty([run_of(1.0, 1.0, 1.0, covariance=0.0)]) is not None
    unknown = InertiaRun("ride", "", None, runs[0].estimate, {}, 0.1)
    assert honesty([unknown]) is None


def test_what_95_of_100_stay_below_leaves_out_one_of_20():
    errors = [0.001 * k for k in range(1, 21)]
    runs = [run_of(1000.0 * (1.0 + error), 1.0, 1000.0, k) for k, error in enumerate(errors)]
    assert spread(runs, "mass_kg").p95 == pytest.approx(0.019)


def test_runs_are_grouped_and_thinned_but_for_the_first():
    ticks = []

    def both(seed):
        return [run_of(1.0, 1.0, 1.0, seed, method) for method in ("gpc", "ekf")]

    runs = runs_over(range(3), both, lambda *done: ticks.append(done))
    assert ticks == [(1, 3), (2, 3), (3, 3)]
    assert [(key[2], len(several)) for key, several in grouped(runs).items()] == [("gpc", 3), ("ekf", 3)]
    long = run_mass_spring(simulate(duration_s=30.0), ["ekf"])[0]
    thin = lean(long, 100)
    assert thin.estimate.time_s.size <= 100
    assert thin.estimate.final == long.estimate.final
    assert thin.course["position_m"][-1] == long.course["position_m"][-1]


def test_json_knows_no_nan():
    result = to_json([run_of(1.0, 1.0, 2.0, covariance=0.0)], {"source": None})
    json.dumps(result, allow_nan=False)
    assert result["estimates"][0]["nees"] is None


def test_a_figure_shows_estimate_band_and_truth():
    runs = run_mass_spring(simulate(duration_s=20.0), ["full_germ", "ekf"])
    ax = plot_quantity(runs, "mass_kg")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "mass [kg]")
    assert [line.get_label() for line in ax.lines] == ["gPC-EKF, full germ ± 2 sd", "EKF ± 2 sd", "true"]
    np.testing.assert_array_equal(ax.lines[-1].get_ydata(), 250.0)
    low, high = ax.get_ylim()
    assert low < 250.0 < high
    moving = plot_quantity(runs, "position_m")
    true = runs[0].course["position_m"]
    assert moving.lines[-1].get_ydata().max() == true.max()
    assert plot_quantity(runs, "mass_kg", ax) is ax


def test_values_and_names_for_people():
    assert plus_minus(1873.123, 9.36) == "1873.1 ± 9.4"
    assert plus_minus(1873.123, 49.0) == "1873 ± 49"
    assert plus_minus(0.55, 0.00141) == "0.5500 ± 0.0014"
    assert plus_minus(None, 1.0) == "–"
    assert plus_minus(3.14159265, 0.0) == "3.1416"
    assert quantity_label("pitch_inertia_kgm2") == "pitch inertia [kg m²]"
    assert names_of("Full_Germ,ekf", "--method", MODES, MODES) == ["full_germ", "ekf"]
    assert names_of(None, "--method", METHODS, ("gpc",)) == ["gpc"]
    assert key_values(["a=1", "b=x", "c=true"], "--set") == {"a": 1, "b": "x", "c": True}


def test_the_documentation_holds(capsys):
    page = (Path(__file__).parents[1] / "docs" / "inertia.md").read_text(encoding="utf-8")
    example = re.search(
        r"```\{code-block\} text\n:caption: drive\.csv\n(.*?)^```$", page, re.DOTALL | re.MULTILINE
    )
    header, first, _ = example[1].splitlines()
    found = find_columns(header.split(","), REQUIRED["mltm"])
    assert len(found) == len(header.split(",")) == len(first.split(","))
    code = re.search(r"```\{code-block\} python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    exec(compile(code[1], "inertia.md", "exec"), {})
    mass, sd, true = (float(word) for word in capsys.readouterr().out.split()[:3])
    assert abs(mass - true) < 4.0 * sd
    for item in ("table1", "table6", "fig1", "fig22"):
        assert f"`mautc-{item}`" in page or f"`{item}`" in page
