"""Synthetic comparisons: records of the right shape with plausible, reproducible numbers; no physics."""

import dataclasses
import itertools

import numpy as np

from ems.records import Case, Comparison, Rollout
from socwise.results import write_case
from socwise.store import case_files, read, write

POLICIES = ("stochastic", "certainty_equivalent", "perfect_information", "rule_based")
EXTRA_PENALTY_kg = {"stochastic": 0.04, "certainty_equivalent": 0.30, "perfect_information": 0.0}
PAIRS = (
    ("stochastic", "certainty_equivalent"),
    ("stochastic", "perfect_information"),
    ("stochastic", "rule_based"),
)


def make_comparison(
    concepts=("hev", "phev"), mus=(0.0007, 0.006), policies=POLICIES[:3], steps=200, realizations=6, seed=1
):
    """Every policy gets the same noise, so paired differences are narrower than the cases' own spread."""
    time_s = np.arange(steps + 1, dtype=float)
    speed_mps = np.round(12.0 * np.abs(np.sin(time_s / 40.0)) + 8.0 * np.sin(time_s / 170.0) ** 2, 6)
    altitude_m = np.round(40.0 + 15.0 * np.sin(2.0 * np.pi * time_s / steps), 6)
    distance_m = float(np.sum(0.5 * (speed_mps[1:] + speed_mps[:-1])))
    cases = tuple(
        _make_case(concept, mu, policy, time_s, speed_mps, realizations, seed)
        for concept, mu, policy in itertools.product(concepts, mus, policies)
    )
    settings = {"step_s": 1.0, "concepts": list(concepts), "grid": {"soc": 321, "sqrt_p": 13}}
    return Comparison(seed, "synthetic", time_s, speed_mps, altitude_m, distance_m, cases, settings)


def _make_case(concept, mu, policy, time_s, speed_mps, realizations, seed):
    rng = np.random.default_rng(seed)
    steps = time_s.size - 1
    plug_in = concept == "phev"
    start, target = (0.9, 0.28) if plug_in else (0.65, 0.65)
    spread = np.full(time_s.size, 0.4 * np.sqrt(mu) * 0.5)
    if policy == "perfect_information":
        spread = np.zeros(time_s.size)
    noise = rng.standard_normal((realizations, time_s.size))
    error = np.zeros_like(noise)
    for k in range(1, time_s.size):
        error[:, k] = 0.98 * error[:, k - 1] + np.sqrt(1 - 0.98**2) * spread[k] * noise[:, k]
    wander = 0.04 * np.cumsum(rng.standard_normal((realizations, time_s.size)), axis=1) / np.sqrt(steps)
    swing = (0.03 if policy == "stochastic" else 0.05) * np.sin(time_s / 90.0)
    soc = start + (target - start) * time_s / steps + swing + wander
    current = 25.0 * np.sin(time_s[:-1] / 15.0) + 8.0 * rng.standard_normal((realizations, steps))
    engine = np.broadcast_to(speed_mps > 11.0, soc.shape).copy()
    fuel_rate = np.where(engine[:, :-1], 6e-4, 0.0) * np.ones((realizations, 1))
    extra = EXTRA_PENALTY_kg.get(policy, 0.15) * np.sqrt(mu / 0.006)
    fuel_kg = 0.95 + 0.01 * rng.standard_normal(realizations) + (0.002 if policy == "stochastic" else 0.0)
    penalty_kg = 0.02 + extra * (1.0 + 0.2 * rng.standard_normal(realizations))
    starts = np.count_nonzero(np.diff(engine.astype(int), axis=1) == 1, axis=1)
    window = (0.25, 0.9) if plug_in else (0.55, 0.75)
    believed = spread * (1.0 + 0.1 * np.cos(time_s / 200.0))
    rollout = Rollout(
        time_s=time_s,
        soc=soc.astype(np.float32),
        soc_estimate=(soc + error).astype(np.float32),
        variance=np.broadcast_to(believed**2, soc.shape).astype(np.float32),
        engine_on=engine,
        current_A=current.astype(np.float32),
        engine_torque_Nm=np.where(engine[:, :-1], 60.0, 0.0).astype(np.float32),
        fuel_kgps=fuel_rate.astype(np.float32),
        fuel_kg=fuel_kg,
        penalty_kg=penalty_kg,
        shortfall_kg=np.zeros(realizations),
        mean_abs_current_A=np.abs(current).mean(axis=1),
        engine_starts=starts.astype(np.int64),
        outside_window=np.mean((soc < window[0]) | (soc > window[1]), axis=1),
    )
    value_kg = None if policy == "rule_based" else float(np.mean(rollout.cost_kg))
    return Case(concept, mu, policy, rollout, value_kg, 5.4 * fuel_kg, 0.25, window, target)


def make_result(comparison):
    """The JSON object that belongs to a comparison, in the shape that DESIGN.md section 4 fixes."""
    by_key = {(case.concept, case.mu, case.policy): case for case in comparison.cases}
    settings = dict.fromkeys((case.concept, case.mu) for case in comparison.cases)
    return {
        "schema": 1,
        "seed": comparison.seed,
        "cycle": {
            "name": comparison.cycle_name,
            "duration_s": float(np.ptp(comparison.time_s)),
            "distance_km": comparison.distance_m / 1e3,
        },
        "cases": [_row(case) for case in comparison.cases],
        "paired": [
            _pair(by_key[concept, mu, one], by_key[concept, mu, other])
            for concept, mu in settings
            for one, other in PAIRS
            if (concept, mu, one) in by_key and (concept, mu, other) in by_key
        ],
    }


def store_without_figures(comparison, folder):
    """Return results on disk that lack the figures of their cases, which take the most time to write."""
    write(dataclasses.replace(comparison, cases=()), {**make_result(comparison), "cases": []}, folder)
    empty = read(folder)
    entries = []
    for case, name in zip(comparison.cases, case_files(comparison.cases), strict=True):
        write_case(case, comparison.seed, folder / name)
        entries.append({"concept": case.concept, "mu": case.mu, "policy": case.policy, "file": name})
    manifest = {**empty.manifest, "cases": entries}
    return dataclasses.replace(empty, result=make_result(comparison), manifest=manifest)


def _mean(values):
    values = np.asarray(values, dtype=float)
    error = float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else None
    return {"mean": float(values.mean()), "se": error}


def _row(case):
    rollout = case.rollout
    spread = np.sqrt(rollout.variance)
    return {
        "concept": case.concept,
        "mu": case.mu,
        "policy": case.policy,
        "realizations": len(rollout.fuel_kg),
        "value_kg": case.value_kg,
        "cost_kg": _mean(rollout.cost_kg),
        "fuel_l_per_100km": _mean(case.fuel_l_per_100km),
        "penalty_kg": _mean(rollout.penalty_kg),
        "final_soc": _mean(rollout.soc[:, -1]),
        "final_soc_estimate": _mean(rollout.soc_estimate[:, -1]),
        "mean_abs_current_A": _mean(rollout.mean_abs_current_A),
        "sqrt_p": {"mean": float(spread.mean()), "final": float(spread[:, -1].mean())},
        "soc_rmse": float(np.sqrt(np.mean((rollout.soc_estimate - rollout.soc) ** 2))),
        "window_violation": float(rollout.outside_window.mean()),
        "engine_starts": _mean(rollout.engine_starts),
        "solve_s": case.solve_s,
    }


def _pair(one, other):
    return {
        "concept": one.concept,
        "mu": one.mu,
        "policy": one.policy,
        "versus": other.policy,
        "cost_kg": _difference(one.rollout.cost_kg, other.rollout.cost_kg),
        "fuel_l_per_100km": _difference(one.fuel_l_per_100km, other.fuel_l_per_100km),
    }


def _difference(one, other):
    paired = _mean(one - other)
    mean, error = paired["mean"], paired["se"]
    return {"mean": mean, "ci95": None if error is None else [mean - 1.96 * error, mean + 1.96 * error]}
