"""Whether the Kalman-type estimators know how wrong they are, with the right model and with a wrong one.

NEES: squared error over reported variance; over m independent runs its sum is chi-square with m degrees.
"""

import numpy as np
import pytest
from scipy import stats

from bms.cells import load_cell
from bms.estimators.catalogue import make_estimator
from bms.flags import Flag
from bms.simulation import CellState, simulate

KINDS = ("ekf", "ukf", "gpc_ekf")
RIGHT = {"model_error_V": 0.0, "soc_drift": 0.0, "relaxation_start_V": 0.0}
"""Nothing that the simulated plant does not do: no slow model error, no drift, a start at rest."""


def drive(n, cell, generator, soc):
    """Pulses of 5 to 40 s, stretches of steady charge, pauses; the SOC stays within 5 and 95 %."""
    rate = cell.capacity_Ah
    most, least = min(cell.charge_limit_A / rate, 3.0), -min(cell.discharge_limit_A / rate, 4.0)
    current_A, k, way = np.zeros(n), 0, -1.0
    while k < n:
        way = 1.0 if soc < 0.15 else -1.0 if soc > 0.85 else way
        kind = generator.random()
        if kind < 0.03:
            length, value = int(generator.uniform(60, 1200)), 0.0
        elif way > 0 and kind < 0.3:
            length, value = int(generator.uniform(60, 600)), 0.4
        else:
            length = int(generator.uniform(5, 40))
            value = float(np.clip(0.35 * way + generator.normal(0.0, 0.8), least, most))
        length = min(length, n - k)
        if not 0.05 < soc + value * length / 3600.0 < 0.95:
            value = 0.0
        current_A[k : k + length] = value * rate
        soc += value * length / 3600.0
        k += length
        if generator.random() < 0.01:
            way = -way
    return current_A


def runs(kind, cell, plant_of, seeds, n, start=(0.5, 0.3), every=60, **options):
    """Errors, reported variances and flags, shape (seeds, n / every)."""
    errors, variances, flags = [], [], []
    for seed in range(seeds):
        generator = np.random.default_rng([seed, 3])
        soc = float(np.clip(generator.normal(*start), 0.08, 0.92))
        plant = plant_of(generator)
        current_A = drive(n, cell, generator, soc)
        hysteresis = generator.uniform(-1.0, 1.0) if plant.hysteresis else 0.0
        run = simulate(plant, current_A, 1.0, state=CellState(soc, hysteresis=hysteresis))
        estimator = make_estimator(kind, cell, soc=start[0], soc_sd=start[1], **options)
        trace = estimator.run(
            current_A + generator.normal(0.0, 0.01, n),
            run.voltage_V + generator.normal(0.0, 0.002, n),
            1.0,
            run.temperature_C,
            every=every,
        )
        errors.append(run.soc[::every] - trace.soc)
        variances.append(trace.variance)
        flags.append(trace.flags)
    return np.array(errors), np.array(variances), np.array(flags)


def check_band(errors, variances, share=0.95):
    """Hold the mean NEES at a few times against the band of so many independent runs."""
    seeds, count = errors.shape
    low, high = stats.chi2.ppf([0.5 - share / 2, 0.5 + share / 2], seeds) / seeds
    nees = np.mean(errors**2 / variances, axis=0)
    at = [count // 3, 2 * count // 3, count - 1]
    assert np.all((low < nees[at]) & (nees[at] < high)), nees[at]


def scattered(cell):
    """Plants whose parameters are drawn from the filter's own priors."""

    def draw(generator):
        q, r, relaxation = np.exp(generator.normal(0.0, [0.05, 0.2, 0.3]))
        pairs = [
            {"resistance_ohm": p.resistance_ohm * relaxation, "time_constant_s": tau * relaxation}
            for p in cell.relaxation
            for tau in [p.time_constant_s or p.resistance_ohm * p.capacitance_F]
        ]
        return cell.with_values(
            capacity_Ah=cell.capacity_Ah * q, resistance_ohm=cell.resistance_ohm * r, relaxation=pairs
        )

    return draw


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["lfp-2ah", "nmc-lgm50"])
def test_with_the_right_model_the_variance_is_that_of_the_error(kind, name):
    """From any SOC; a belief that is neither too sure nor too modest, and no mismatch is seen."""
    cell = load_cell(name)
    errors, variances, flags = runs(kind, cell, lambda _: cell, 100, 4000, estimate=(), **RIGHT)
    check_band(errors, variances)
    assert np.mean(flags & Flag.MISMATCH > 0) < 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_with_hysteresis_modelled_too(kind):
    cell = load_cell("a123-26650")
    errors, variances, _ = runs(
        kind, cell, lambda _: cell, 100, 4000, start=(0.5, 0.05), estimate=(), **RIGHT
    )
    check_band(errors, variances)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["lfp-2ah", "nmc-lgm50"])
def test_unknown_parameters_are_paid_for(kind, name):
    """Capacity, resistance and relaxation differ from cell to cell as the priors say."""
    cell = load_cell(name)
    still = {"capacity_drift": 0.0, "resistance_drift": 0.0, "relaxation_drift": 0.0}
    start = (0.5, 0.1)
    errors, variances, _ = runs(kind, cell, scattered(cell), 100, 6000, start, **RIGHT, **still)
    check_band(errors, variances)


def wrong(name):
    """A filter's cell of one pair, no hysteresis; a plant with two, hysteresis and 5 % more resistance."""
    cell = load_cell(name)
    ohm = cell.resistance_ohm * 1.05
    if name == "lfp-2ah":
        pairs = [{"resistance_ohm": 0.011, "capacitance_F": 2700.0}]
        more = {"resistance_ohm": 0.006, "time_constant_s": 300.0}
        turning = {"voltage_V": 0.02, "rate": 20.0}
        plant = cell.with_values(resistance_ohm=ohm, relaxation=[*pairs, more], hysteresis=turning)
        return cell, plant
    if name == "a123-26650":
        pairs = [pair.model_dump() for pair in cell.relaxation]
        more = {"resistance_ohm": 0.006, "time_constant_s": 300.0}
        return cell.with_values(hysteresis=None), cell.with_values(
            resistance_ohm=ohm, relaxation=[*pairs, more]
        )
    one = cell.with_values(relaxation=[{"resistance_ohm": 0.0196, "time_constant_s": 100.0}])
    return one, cell.with_values(resistance_ohm=ohm, hysteresis={"voltage_V": 0.008, "rate": 20.0})


def covers(errors, variances):
    """At least 95 % of the errors are within two standard deviations, and the mean NEES is not above 1."""
    square = errors**2 / variances
    return np.mean(square < 4.0) >= 0.95 and np.mean(square[:, 5:]) < 1.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["lfp-2ah", "a123-26650", "nmc-lgm50"])
@pytest.mark.parametrize("options", [{}, {"estimate": ()}])
def test_with_a_wrong_model_the_variance_covers_the_error(kind, name, options):
    """By default, for three chemistries, with parameters estimated and without."""
    cell, plant = wrong(name)
    errors, variances, _ = runs(kind, cell, lambda _: plant, 12, 8000, **options)
    assert covers(errors, variances)


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_model_is_seen_and_the_variance_grows(kind):
    """Told that the model is right to 3 mV, the filter learns otherwise: it says so and is far less sure."""
    cell, plant = wrong("lfp-2ah")
    options = {"model_error_V": 0.003, "estimate": ()}
    args = (8, 12000)
    errors, variances, flags = runs(kind, cell, lambda _: plant, *args, **options)
    _, right, calm = runs(kind, cell, lambda _: cell, *args, **options)
    _, blind, _ = runs(kind, cell, lambda _: plant, *args, watches=False, **options)
    late = slice(errors.shape[1] // 2, None)
    assert np.mean(flags[:, late] & Flag.MISMATCH > 0) > 0.95
    assert np.mean(calm & Flag.MISMATCH > 0) < 0.02
    assert np.sqrt(np.mean(variances[:, late])) > 3.0 * np.sqrt(np.mean(right[:, late]))
    # Without the watch nothing tells it.
    assert np.median(variances[:, late] / blind[:, late]) > 4.0


@pytest.mark.parametrize("kind", KINDS)
def test_by_default_a_right_model_is_not_distrusted_without_bound(kind):
    """The default model error costs sureness, but the SOC of an NMC cell stays known to 3 %."""
    cell = load_cell("nmc-lgm50")
    errors, variances, flags = runs(kind, cell, lambda _: cell, 8, 4000)
    assert covers(errors, variances)
    assert np.sqrt(variances[:, 10:].max()) < 0.03
    assert np.sqrt(np.mean(errors[:, 10:] ** 2)) < 0.01
    assert np.mean(flags & Flag.MISMATCH > 0) < 0.02
