"""Synthetic studies on disk: folders of the right shape with plausible, reproducible numbers; no physics."""

import itertools
import json

import numpy as np

from ems.statistics import half_width
from socwise.study.layout import FORMAT, SCHEMA, case_file, error_file

POLICIES = ("stochastic", "certainty_equivalent", "perfect_information")
REALIZATIONS = 50


def factorial(**values):
    """Every combination, the last factor fastest."""
    return [dict(zip(values, point, strict=True)) for point in itertools.product(*values.values())]


def scattered(count, seed=3):
    """Points over ranges of two numbers, for both concepts."""
    rng = np.random.default_rng(seed)
    mus, widths = 10 ** rng.uniform(-3.5, -2.0, count), rng.uniform(0.1, 0.6, count)
    return [
        {"concept": ("hev", "phev")[k % 2], "mu": float(mu), "window_width": float(width)}
        for k, (mu, width) in enumerate(zip(mus, widths, strict=True))
    ]


def write_study(folder, points, *, failed=(), missing=(), losses=None, warnings=None):
    """Write a study whose loss in per cent is given for each point, or made up."""
    (folder / "cases").mkdir(parents=True)
    (folder / "study.toml").write_text('name = "synthetic"\n', encoding="utf-8")
    entries = []
    for number, point in enumerate(points, 1):
        key = f"{number:064x}"
        entries.append({"key": key, "factors": point})
        if number in failed:
            error = {"error": {"kind": "EmsError", "message": "the cycle <b>is</b> too steep"}}
            error_file(folder, key).write_text(json.dumps(error), encoding="utf-8")
        elif number not in missing:
            loss = losses[number - 1] if losses else _loss(point, number)
            said = (warnings or {}).get(number, [])
            done = {"result": _result(point, *loss), "resolved": {}, "warnings": said}
            case_file(folder, key).write_text(json.dumps(done), encoding="utf-8")
    manifest = {
        "format": FORMAT,
        "schema": SCHEMA,
        "name": "synthetic",
        "seed": 0,
        "realizations": REALIZATIONS,
        "policies": list(POLICIES),
        "design": {"kind": "factorial"},
        "packages": {"socwise": "0"},
        "code_sha256": "0" * 64,
        "python": "3",
        "settings": {},
        "cases": entries,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def _loss(point, number):
    """Loss in per cent, and half its interval."""
    steep, width = float(point.get("penalty_steepness", 1.0)), float(point.get("window_width", 0.3))
    size = 40.0 * steep * (0.2 / width) ** 2 * (2.0 if point.get("concept") == "phev" else 1.0)
    size *= (float(point.get("mu", 0.002)) / 0.002) ** 0.5
    return size - 0.5, 0.3 + 0.25 * size * (1.0 + 0.5 * np.sin(7.0 * number))


def _result(point, percent, half):
    """The stochastic policy costs exactly 1 kg, so that per cent of it are hundredths of a kilogram."""
    concept, mu = point.get("concept", "hev"), point.get("mu", 0.002)
    costs = dict(zip(POLICIES, (1.0, 1.0 + percent / 100.0, 0.95), strict=True))
    error = half / 100.0 / half_width(1.0, REALIZATIONS)
    rows = [
        {
            "concept": concept,
            "mu": mu,
            "policy": policy,
            "realizations": REALIZATIONS,
            "value_kg": cost,
            "cost_kg": {"mean": cost, "se": 0.0 if policy == POLICIES[0] else error},
            "fuel_l_per_100km": {"mean": 4.0 + 0.01 * place, "se": 0.0 if place == 0 else 0.002},
            "window_violation": 0.01 * place,
        }
        for place, (policy, cost) in enumerate(costs.items())
    ]
    pairs = [
        {
            "concept": concept,
            "mu": mu,
            "policy": POLICIES[0],
            "versus": other,
            "cost_kg": _interval(1.0 - costs[other], half / 100.0),
            "fuel_l_per_100km": _interval(-0.01 * place, 0.004),
        }
        for place, other in enumerate(POLICIES[1:], 1)
    ]
    cycle = {"name": str(point.get("cycle", "larsson")), "duration_s": 4268.0, "distance_km": 57.0}
    return {"schema": 1, "seed": 0, "cycle": cycle, "cases": rows, "paired": pairs}


def _interval(mean, half):
    return {"mean": mean, "ci95": [mean - half, mean + half]}
