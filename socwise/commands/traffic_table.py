"""What the commands of ``socwise traffic`` show on the screen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from drivecycles.traffic.plot import SHOWN
from socwise.commands.screen import new_table

if TYPE_CHECKING:
    from rich.console import RenderableType

_KMH = 3.6
_VEHPH = 3600.0
_PER_CENT = 100.0
_ABSENT = "–"


def run_table(result: Mapping[str, Any]) -> list[RenderableType]:
    """Say what a run was and what became of its vehicles; a row for each location."""
    demand, vehicles = result["demand_per_s"], result["vehicles"]
    table = new_table("position\nkm", "start\nkm/h", "mean\nkm/h", "least\nkm/h", "end\nkm/h", left=0)
    for one in result["locations"]:
        speeds = (one["speed_mps"][key] for key in ("start", "mean", "least", "end"))
        table.add_row(f"{one['position_m'] / 1e3:.3f}", *(f"{_KMH * speed:.2f}" for speed in speeds))
    return [
        f"{result['scenario']}: {result['model']}, {result['scheme']}, {result['duration_s']:g} s in steps of"
        f" {result['step_s']:.4g} s, Courant number {result['courant']:.3f}",
        f"Capacity {_VEHPH * result['capacity_per_s']:.0f} veh/h, demand {_VEHPH * demand['mean']:.0f} veh/h"
        f" on average, {_VEHPH * demand['most']:.0f} at most;"
        f" {result['refused_veh']:.1f} vehicles found no room",
        f"Vehicles on the road: {vehicles['start']:.1f} at the start, {vehicles['end']:.1f} at the end;"
        f" the balance is off by {result['imbalance_veh']:.1e}",
        "",
        table,
        "",
    ]


def spread_tables(result: Mapping[str, Any]) -> list[RenderableType]:
    """Show the speed at the end of each location, a table for each method."""
    shown: list[RenderableType] = []
    for one in result["results"]:
        names = () if result["notes"] else result["parameters"]
        heads = (f"S {SHOWN[name][0].rpartition(' [')[0]}\n%" for name in names)
        quantiles = list(one["locations"][0]["quantiles_mps"])
        table = new_table(
            "position\nkm", "mean\nkm/h", "sd\nkm/h", "error\nkm/h",
            *(f"{_PER_CENT * float(level):g} %\nkm/h" for level in quantiles), *heads, left=0,
        )  # fmt: skip
        for place in one["locations"]:
            sobol = place["sobol"]
            table.add_row(
                f"{place['position_m'] / 1e3:.3f}",
                f"{_KMH * place['mean_mps']:.3f}",
                f"{_KMH * place['sd_mps']:.3f}",
                f"{_KMH * place['error_mps']:.2g}",
                *(f"{_KMH * place['quantiles_mps'][level]:.2f}" for level in quantiles),
                *(_ABSENT if sobol is None else f"{_PER_CENT * sobol[name]['total']:.1f}" for name in names),
            )
        said = [f"{one['method']}, {one['runs']} runs: speed at the end"]
        if one["congested"]:
            said.append(f"in {one['congested']} of them the demand exceeds the capacity")
        if one["cut"] > 0.0:
            said.append(f"truncation cut {one['cut']:.2g} of the probability")
        shown += ["; ".join(said), "", table, ""]
    for name, curve in result.get("errors", {}).items():
        pairs = zip(curve["runs"], curve["rms_error_kmh"], strict=True)
        shown.append(f"{name}: " + ", ".join(f"{off:.3g} km/h at {runs:.0f}" for runs, off in pairs))
    shown += [f"note: {note}" for note in result["notes"]]
    error = "error: of the mean"
    return [*shown, error if result["notes"] else f"S: total Sobol index at the end; {error}", ""]


def estimate_tables(result: Mapping[str, Any]) -> list[RenderableType]:
    """Show the estimates: values of a single one, errors over several seeds."""
    runs = result["estimates"]
    first = runs[0]
    many = len(runs) > 1
    heads = ("worst error\n%", "rms error\n%", "claimed sd\n%") if many else ("estimate", "truth", "error\n%")
    table = new_table("", "guess", *heads)
    for name, one in first["parameters"].items():
        label, scale = SHOWN[name]
        if many:
            errors = [_PER_CENT * abs(run["parameters"][name]["error"]) for run in runs]
            claimed = [run["parameters"][name] for run in runs]
            sds = [_PER_CENT * each["sd"] / each["value"] for each in claimed]
            rms = (sum(error**2 for error in errors) / len(errors)) ** 0.5
            cells = (f"{max(errors):.2f}", f"{rms:.2f}", f"{sum(sds) / len(sds):.2f}")
        else:
            truth, error = one["truth"], one["error"]
            cells = (
                f"{scale * one['value']:.3f} ± {scale * one['sd']:.3f}",
                _ABSENT if truth is None else f"{scale * truth:.3f}",
                _ABSENT if error is None else f"{_PER_CENT * error:+.2f}",
            )
        table.add_row(label, f"{scale * one['guess']:.3f}", *cells)
    source = result["source"] or (
        f"{len(runs)} synthetic logs" if many else f"a synthetic log, seed {first['seed']}"
    )
    said: list[RenderableType] = [f"{source}: {first['readings']} readings", "", table, ""]
    judged = result["nees"]
    if judged is not None and many:
        said.append(
            f"NEES {judged['mean']:.2f}, an honest filter's lies in {judged['low']:.2f} to"
            f" {judged['high']:.2f}: {judged['verdict']}"
        )
    if first["speed_rmse_mps"] is not None:
        off = (sum(run["speed_rmse_mps"] ** 2 for run in runs) / len(runs)) ** 0.5
        said.append(
            f"Speed on the whole road, second half: {_KMH * off:.2f} km/h rms off,"
            f" {_KMH * first['speed_sd_mps']:.2f} claimed"
        )
    said += [f"note: {note}" for note in result["notes"]]
    return [*said, "±: one standard deviation"]


def cycles_table(result: Mapping[str, Any]) -> list[RenderableType]:
    """Show the planned cycle and all members, a row each."""
    table = new_table("cycle", "s", "km", "mean\nkm/h", "least a\nm/s²", "largest a\nm/s²", "stops")
    for one in (result["planned"], *result["members"]):
        planned = one is result["planned"]
        table.add_row(
            f"planned ({result['plan']})" if planned else one["name"],
            f"{one['duration_s']:.0f}",
            f"{one['distance_km']:.2f}",
            f"{_KMH * one['mean_speed_mps']:.1f}",
            f"{one['min_acceleration_mps2']:.2f}",
            f"{one['max_acceleration_mps2']:.2f}",
            str(one["stops"]),
        )
    return [table, ""]
