"""Draw estimators.png and write the tables of docs/estimators.md: `python docs/images/estimators.py`."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bms.cell import Cell
from bms.cells import cell_names, load_cell
from bms.cycling import cycling_profile
from bms.estimators.base import Trace
from bms.estimators.catalogue import estimator_names, make_estimator
from bms.logged_data import LoggedData, read_log
from bms.simulation import simulate
from socwise.figures.estimate_style import estimator_color, estimator_label
from socwise.figures.style import INK, finish

PAGE = Path(__file__).parents[1] / "estimators.md"
PICTURE = Path(__file__).with_suffix(".png")
HOUR_s = 3600.0
DRAWN_h = 6.0
EVERY = 60


def page_log(folder: Path) -> LoggedData:
    """Write the log of the page as its own example does, and read it."""
    code = re.search(r"```\{code-block\} python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code
    path = str(folder / "drive.csv")
    exec(compile(code[1].replace('"drive.csv"', repr(path)), "estimators.md", "exec"), {})
    return read_log(path)


def preset_log(name: str) -> LoggedData:
    """Drive and charge a worn copy of a preset for a day, as the page does with the A123."""
    nominal = load_cell(name)
    worn = nominal.with_values(
        capacity_Ah=0.92 * nominal.capacity_Ah, resistance_ohm=1.25 * nominal.resistance_ohm
    )
    rng = np.random.default_rng(1)
    drive_A = nominal.capacity_Ah * np.repeat(rng.normal(-0.3, 0.6, 360), 10)
    drive_A = drive_A.clip(-0.9 * nominal.discharge_limit_A, 0.9 * nominal.charge_limit_A)
    charge_A = 0.5 * nominal.capacity_Ah
    profile = cycling_profile(
        worn.capacity_Ah, drive_A, 86400.0, low=0.2, high=0.85, charge_current_A=charge_A
    )
    run = simulate(worn, profile.current_A, soc=0.7)
    return LoggedData(
        run.time_s,
        run.current_A + rng.normal(0.0, 0.01, run.time_s.size),
        run.voltage_V + rng.normal(0.0, 0.002, run.time_s.size),
        run.temperature_C,
        run.soc,
    )


def believe(name: str, cell: Cell, log: LoggedData) -> Trace:
    """Run an estimator with its defaults from 0.5 +- 0.3."""
    estimator = make_estimator(name, cell)
    return estimator.run(
        log.current_A, log.voltage_V, temperature_C=log.temperature_C, time_s=log.time_s, every=EVERY
    )


def within(trace: Trace, error: np.ndarray, limit: float) -> str:
    """Time from which on the error stays within a limit."""
    beyond = np.flatnonzero(np.abs(error) > limit)
    if beyond.size == 0:
        return "0 min"
    if beyond[-1] == error.size - 1:
        return "never"
    time_s = trace.time_s[beyond[-1] + 1]
    return f"{time_s / 60.0:.0f} min" if time_s < 2.0 * HOUR_s else f"{time_s / HOUR_s:.1f} h"


def errors(trace: Trace, log: LoggedData) -> np.ndarray:
    """Error of the SOC at the rows of a trace."""
    return np.asarray(trace.soc - log.soc_true[::EVERY])


def row(name: str, trace: Trace, log: LoggedData) -> list[str]:
    """Describe how an estimator did, as a row of a table."""
    error, sd = errors(trace, log), np.sqrt(trace.variance)
    late = trace.time_s > 12.0 * HOUR_s
    cells = [
        f"`{name}`",
        within(trace, error, 0.02),
        within(trace, error, 0.01),
        f"{100.0 * np.sqrt(np.mean(error[late] ** 2)):.2f}",
        f"{100.0 * sd[late].mean():.2f}",
        f"{100.0 * np.mean(np.abs(error) <= 2.0 * sd):.0f}",
        f"{100.0 * np.mean(trace.flags == 0):.0f}",
    ]
    for key, scale, digits in (("capacity_Ah", 1.0, 3), ("resistance_ohm", 1e3, 2)):
        value, spread = (d.get(key, [np.nan])[-1] * scale for d in (trace.parameters, trace.deviations))
        cells.append("" if np.isnan(value) else f"{value:.{digits}f} ± {spread:.{digits}f}")
    return cells


HEADER = [
    "",
    "SOC within 2 % from",
    "1 % from",
    "after 12 h: rms error, %",
    "sd, %",
    "inside 2 sd, %",
    "not flagged, %",
    "capacity, Ah",
    "R, mΩ",
]


def write_table(key: str, rows: list[list[str]]) -> None:
    """Put a table between its comments on the page."""
    head, *body = [f"| {' | '.join(cells)} |" for cells in rows]
    text = "\n".join([head, "|" + "---|" * len(rows[0]), *body])
    page, found = re.subn(
        rf"(% table: {key}\n).*?(\n% end)",
        lambda old: f"{old[1]}\n{text}\n{old[2]}",
        PAGE.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if found != 1:
        raise SystemExit(f"{PAGE} has no place for the table {key}")
    PAGE.write_text(page, encoding="utf-8")


def write_times(presets: list[str]) -> None:
    """Write the times on worn copies of presets."""
    rows = [["", *(f"{preset}: within {limit}" for preset in presets for limit in ("2 %", "1 %"))]]
    logs = {preset: preset_log(preset) for preset in presets}
    for name in estimator_names():
        cells = [f"`{name}`"]
        for preset, log in logs.items():
            trace = believe(name, load_cell(preset), log)
            cells += [within(trace, errors(trace, log), limit) for limit in (0.02, 0.01)]
        rows.append(cells)
    write_table("presets", rows)


def draw(traces: dict[str, Trace], log: LoggedData) -> None:
    """Draw a panel for each estimator."""
    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    for ax, (name, trace) in zip(axes.flat, traces.items(), strict=False):
        color = estimator_color(name)
        hours, soc, sd = trace.time_s / HOUR_s, 100.0 * trace.soc, 100.0 * np.sqrt(trace.variance)
        low, high = np.clip((soc - 2.0 * sd, soc + 2.0 * sd), 0.0, 100.0)
        ax.fill_between(hours, low, high, color=color, alpha=0.25, linewidth=0.0)
        ax.plot(hours, soc, color=color, linewidth=1.4, label="estimate ± 2 sd")
        ax.plot(hours, 100.0 * log.soc_true[::EVERY], "--", color=INK, linewidth=0.9, label="true")
        ax.set(title=estimator_label(name), xlim=(0.0, DRAWN_h), ylim=(0.0, 100.0))
        ax.title.set_size(10)
        finish(ax)
    for ax in axes.flat[len(traces) :]:
        ax.set_axis_off()
    for ax in axes[1]:
        ax.set_xlabel("time [h]")
    for ax in axes[:, 0]:
        ax.set_ylabel("SOC [%]")
    figure.savefig(PICTURE, dpi=100)


def main() -> None:
    """Run all estimators on all logs."""
    with tempfile.TemporaryDirectory() as folder:
        log = page_log(Path(folder))
    nominal = load_cell("a123-26650")
    for key, cell in (("page", nominal), ("no hysteresis", nominal.with_values(hysteresis=None))):
        traces = {name: believe(name, cell, log) for name in estimator_names()}
        write_table(key, [HEADER, *(row(name, trace, log) for name, trace in traces.items())])
        if cell is nominal:
            draw(traces, log)
    write_times([name for name in cell_names() if name != "a123-26650"])


if __name__ == "__main__":
    main()
