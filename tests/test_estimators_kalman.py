"""The Kalman-type estimators against independent filters, closed forms and each other."""

import math

import numpy as np
import pytest

from bms.belief import SocBelief
from bms.cell import Cell
from bms.cells import load_cell
from bms.errors import BatteryError
from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.estimators.gpc_ekf import GpcEkf, GpcEkfOptions
from bms.estimators.ukf import sigma_weights
from bms.flags import Flag
from bms.simulation import CellState, simulate, simulate_members
from gpc.basis import Legendre
from gpc.collocation import collocate
from gpc.ekf import GpcEkf as ChaosFilter
from gpc.index_set import total_order

KINDS = ("ekf", "ukf", "gpc_ekf")
EXACT = {"model_error_V": 0.0, "watches": False, "resets_at_rest": False, "resets_at_full": False}
EVERYTHING = ("capacity_Ah", "resistance_ohm", "relaxation_resistance_ohm", "relaxation_capacitance_F")


def straight_cell(**changes):
    values = {
        "name": "straight",
        "source": "test",
        "capacity_Ah": 2.0,
        "soc": (0.0, 0.5, 1.0),
        "ocv_V": (3.0, 3.4, 3.8),
        "resistance_ohm": 0.01,
        "relaxation": [{"resistance_ohm": 0.012, "time_constant_s": 30.0}],
        "voltage_min_V": 2.5,
        "voltage_max_V": 4.2,
        "discharge_limit_A": 20.0,
        "charge_limit_A": 20.0,
    }
    return Cell(**(values | changes))


def rich_cell(**changes):
    """Two pairs and hysteresis, and a curve that bends."""
    return straight_cell(
        soc=(0.0, 0.2, 0.5, 0.8, 1.0),
        ocv_V=(3.0, 3.3, 3.4, 3.6, 3.9),
        relaxation=[
            {"resistance_ohm": 0.012, "time_constant_s": 30.0},
            {"resistance_ohm": 0.006, "time_constant_s": 300.0},
        ],
        hysteresis={"voltage_V": 0.01, "rate": 20.0},
        **changes,
    )


def pulses(cell, n, generator, mean_C=0.0):
    """Pulses of ten seconds about a mean, both in multiples of the capacity."""
    rows = generator.normal(mean_C, 1.0, n // 10 + 1).clip(-3.0, 1.5) * cell.capacity_Ah
    return np.repeat(rows, 10)[:n]


def measured(plant, current_A, generator, soc=0.5, current_sd_A=0.01, voltage_sd_V=0.002, **state):
    run = simulate(plant, current_A, 1.0, state=CellState(soc, **state))
    noisy = current_A + generator.normal(0.0, current_sd_A, current_A.size)
    return run, noisy, run.voltage_V + generator.normal(0.0, voltage_sd_V, current_A.size)


def kalman(cell, current_A, voltage_V, soc, variance, drift):
    """The textbook filter for SOC and one relaxation voltage on a straight curve, dense matrices."""
    base, slope = cell.ocv_V[0], cell.ocv_V[-1] - cell.ocv_V[0]
    pair, r, sensors = cell.relaxation[0], cell.resistance_ohm, Sensors()
    e = math.exp(-1.0 / pair.time_constant_s)
    step = np.diag([1.0, e])
    drive = np.array([1.0 / cell.capacity_C, pair.resistance_ohm * (1.0 - e)])
    process = np.outer(drive, drive) * sensors.current_sd_A**2 + np.diag([drift, 0.0])
    h = np.array([slope, 1.0])
    noise = sensors.voltage_sd_V**2 + (r * sensors.current_sd_A) ** 2
    x, p, means, variances = np.array([soc, 0.0]), np.diag([variance, 0.005**2]), [], []
    for k in range(current_A.size):
        if k > 0:
            x, p = step @ x + drive * current_A[k - 1], step @ p @ step.T + process
        gain = p @ h / (h @ p @ h + noise)
        x = x + gain * (voltage_V[k] - base - h @ x - r * current_A[k])
        p = p - np.outer(gain, h @ p)
        means.append(x[0])
        variances.append(p[0, 0])
    return np.array(means), np.array(variances)


@pytest.mark.parametrize("kind", KINDS)
def test_on_a_straight_curve_each_is_the_kalman_filter(kind):
    cell, generator = straight_cell(), np.random.default_rng(1)
    current = pulses(cell, 400, generator)
    _, noisy, voltage = measured(cell, current, generator)
    filtered = make_estimator(kind, cell, soc=0.55, soc_sd=0.08, estimate=(), **EXACT).run(noisy, voltage)
    mean, variance = kalman(cell, noisy, voltage, 0.55, 0.08**2, 0.001**2 / 86400.0)
    np.testing.assert_allclose(filtered.soc, mean, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(filtered.variance, variance, rtol=1e-9)


class Dense:
    """A joint filter with dense matrices and slopes by differences, for a cell with constant parameters.

    The state is SOC, the relaxation voltages, hysteresis, logarithms of the four factors.
    """

    def __init__(self, cell, soc, sd, error_V):
        self.cell, self.error = cell, error_V**2
        self.x = np.zeros(8)
        self.x[0] = soc
        self.p = np.diag([sd, 0.005, 0.005, 0.577, 0.05, 0.2, 0.3, 0.3]) ** 2
        self.own, self.shared = np.zeros((8, 8)), np.zeros(8)
        self.drift = np.array([0.001, 0.0, 0.0, 0.0, 0.001, 0.02, 0.02, 0.02]) ** 2 / 86400.0

    def move(self, x, current):
        cell, out = self.cell, x.copy()
        q, _, r, c = np.exp(x[4:])
        moved = current / (cell.capacity_C * q)
        out[0] += moved
        for at, pair in enumerate(cell.relaxation):
            e = math.exp(-1.0 / (pair.time_constant_s * r * c))
            out[1 + at] = e * x[1 + at] + pair.resistance_ohm * r * (1.0 - e) * current
        if abs(current) > 0.03:
            f = math.exp(-cell.hysteresis.rate * abs(moved))
            out[3] = f * x[3] + (1.0 - f) * math.copysign(1.0, current)
        return out

    def voltage(self, x, current):
        cell = self.cell
        v = float(cell.ocv(x[0])) + x[1] + x[2] + cell.hysteresis.voltage_V * x[3]
        return v + cell.resistance_ohm * math.exp(x[5]) * current

    def step(self, before, current, voltage):
        if before is not None:
            f = slopes(lambda x: self.move(x, before), self.x)
            g = (
                slopes(lambda i: self.move(self.x, before + i[0]), np.zeros(1))[:, 0]
                * np.r_[1, 1, 1, [0] * 5]
            )
            self.x = self.move(self.x, before)
            self.p = f @ self.p @ f.T + 1e-4 * np.outer(g, g) + np.diag(self.drift)
            self.own = f @ self.own @ f.T
            fades = min(1.0 / 3600.0, abs(before) / self.cell.capacity_C / 0.1)
            self.shared = (1.0 - fades) * f @ self.shared
        h = slopes(lambda x: np.array([self.voltage(x, current)]), self.x)[0]
        w = self.own @ h + self.shared
        unit = h @ w + h @ self.shared + 1.0
        noise = 4e-6 + (self.cell.resistance_ohm * math.exp(self.x[5]) * 0.01) ** 2 + 0.25 * self.error * 61.0
        # The table of the OCV is off by 0.3 % along the SOC, for ten minutes at a time.
        noise += 601.0 * (0.003 * h[0]) ** 2
        total = h @ self.p @ h + self.error * unit + noise
        gain = (self.p @ h + self.error * w) / total
        gain[0] = max(gain[0], min((self.p @ h)[0] / total, 0.0))
        self.x = self.x + gain * (voltage - self.voltage(self.x, current))
        keep = np.eye(8) - np.outer(gain, h)
        self.p = keep @ self.p @ keep.T + noise * np.outer(gain, gain)
        crossed = np.outer(keep @ self.shared, gain)
        self.own = keep @ self.own @ keep.T - crossed - crossed.T + np.outer(gain, gain)
        self.shared = keep @ self.shared - gain


def slopes(function, x):
    columns = []
    for at in range(x.size):
        reach = np.zeros(x.size)
        reach[at] = 1e-5
        columns.append((function(x + reach) - function(x - reach)) / 2e-5)
    return np.array(columns).T


def test_the_joint_filter_is_its_dense_twin():
    """All parameters, hysteresis and a considered model error; the twin knows no place for anything."""
    cell, generator = rich_cell(), np.random.default_rng(2)
    current = pulses(cell, 300, generator)
    _, noisy, voltage = measured(cell, current, generator, soc=0.62, hysteresis=0.3)
    options = EXACT | {"model_error_V": 0.003}
    ekf = make_estimator("ekf", cell, soc=0.618, soc_sd=0.009, estimate=EVERYTHING, **options)
    twin = Dense(cell, 0.618, 0.009, 0.003)
    for k in range(current.size):
        belief = ekf.update(noisy[k], voltage[k], 1.0)
        twin.step(noisy[k - 1] if k else None, noisy[k], voltage[k])
        total = twin.p + twin.error * twin.own
        assert belief.mean == pytest.approx(twin.x[0], abs=1e-8)
        assert belief.variance == pytest.approx(total[0, 0], rel=1e-5)
    nominal = (2.0, 0.01, 0.012, 2500.0)
    for at, (name, estimate) in enumerate(ekf.parameters.items()):
        assert name == EVERYTHING[at]
        assert estimate.value == pytest.approx(nominal[at] * math.exp(twin.x[4 + at]), rel=1e-6)
        assert estimate.sd == pytest.approx(estimate.value * math.sqrt(total[4 + at, 4 + at]), rel=1e-5)
    assert belief.variance > 1.1 * twin.p[0, 0]


class Unscented:
    """The scaled unscented filter from its definition: points, sums, and P - K S K'."""

    def __init__(self, dense, alpha, beta):
        self.dense, n = dense, dense.x.size
        self.spread = alpha**2 * 3.0
        self.w = np.full(2 * n + 1, 0.5 / self.spread)
        self.w[0] = 1.0 - n / self.spread
        self.c = self.w.copy()
        self.c[0] += 1.0 - alpha**2 + beta

    def points(self):
        root = np.linalg.cholesky(self.dense.p) * math.sqrt(self.spread)
        return np.vstack([self.dense.x, *(self.dense.x + s * c for c in root.T for s in (1, -1))])

    def step(self, before, current, voltage):
        d = self.dense
        if before is not None:
            g = slopes(lambda i: d.move(d.x, before + i[0]), np.zeros(1))[:, 0] * np.r_[1, 1, 1, [0] * 5]
            moved = np.array([d.move(point, before) for point in self.points()])
            d.x = self.w @ moved
            d.p = (moved - d.x).T * self.c @ (moved - d.x) + 1e-4 * np.outer(g, g) + np.diag(d.drift)
            d.x[3] = min(max(d.x[3], -1.0), 1.0)
        points = self.points()
        seen = np.array([d.voltage(point, current) for point in points])
        mean = self.w @ seen
        spread = self.c @ (seen - mean) ** 2
        cross = (points - d.x).T * self.c @ (seen - mean)
        left = max(spread - cross @ np.linalg.solve(d.p, cross), 0.0)
        noise = 4e-6 + (d.cell.resistance_ohm * math.exp(d.x[5]) * 0.01) ** 2 + 601.0 * left
        total = spread - left + noise
        gain = cross / total
        d.x = d.x + gain * (voltage - mean)
        d.x[3] = min(max(d.x[3], -1.0), 1.0)
        d.p = d.p - np.outer(gain, gain) * total


def test_the_unscented_filter_is_its_definition():
    cell, generator = rich_cell(), np.random.default_rng(3)
    current = pulses(cell, 120, generator)
    _, noisy, voltage = measured(cell, current, generator, soc=0.5, hysteresis=-0.3)
    ukf = make_estimator("ukf", cell, soc=0.55, soc_sd=0.1, estimate=EVERYTHING, **EXACT)
    twin = Unscented(Dense(cell, 0.55, 0.1, 0.0), 0.5, 2.0)
    for k in range(current.size):
        belief = ukf.update(noisy[k], voltage[k], 1.0)
        twin.step(noisy[k - 1] if k else None, noisy[k], voltage[k])
        assert belief.mean == pytest.approx(twin.dense.x[0], abs=1e-7)
        assert belief.variance == pytest.approx(twin.dense.p[0, 0], rel=1e-4)
    weights = sigma_weights(8, 0.5, 2.0, None)
    assert weights.centre + 16 * weights.outer == pytest.approx(1.0)
    assert weights.reach == pytest.approx(math.sqrt(0.75))


def test_the_chaos_filter_is_that_of_the_core():
    """As `gpc.ekf`, which knows no cell and takes its slopes by differences."""
    cell, generator = straight_cell(ocv_V=(3.0, 3.3, 3.8)), np.random.default_rng(4)
    current = pulses(cell, 60, generator)
    _, noisy, voltage = measured(cell, current, generator, soc=0.62)
    names = ("capacity_Ah", "resistance_ohm")
    options = GpcEkfOptions(
        estimate=names,
        capacity_drift=0.0,
        resistance_drift=0.0,
        soc_drift=0.0,
        capacity_sd=0.005,
        resistance_sd=0.01,
        **EXACT,
    )
    ours = GpcEkf(cell, SocBelief(0.618, 0.009**2), options, Sensors())
    core = ChaosFilter(collocate([Legendre()] * 3, total_order(3, 2)))
    start = np.zeros((10, 4))
    start[0, 0], start[1, 0], start[2, 2], start[3, 3] = 0.618, 0.009, 0.005, 0.01
    belief = core.start(start, np.diag([0.0, 0.005**2, 0.0, 0.0]))
    pair, r = cell.relaxation[0], cell.resistance_ohm
    e = math.exp(-1.0 / pair.time_constant_s)

    def move(x, i):
        charge = i / (cell.capacity_C * np.exp(x[:, 2]))
        v = e * x[:, 1] + pair.resistance_ohm * (1.0 - e) * i
        return np.stack([x[:, 0] + charge, v, x[:, 2], x[:, 3]], axis=1)

    def see(x, i):
        return (cell.ocv(x[:, 0]) + x[:, 1] + r * np.exp(x[:, 3]) * i)[:, np.newaxis]

    for k in range(current.size):
        if k:
            q = math.exp(float(belief.mean[2]))
            g = np.array([1.0 / cell.capacity_C / q, pair.resistance_ohm * (1.0 - e), 0.0, 0.0])
            belief = core.forecast(belief, lambda x, i=noisy[k - 1]: move(x, i), 1e-4 * np.outer(g, g))
        noise = 4e-6 + (r * math.exp(float(belief.mean[3])) * 0.01) ** 2
        belief, _ = core.update(belief, [voltage[k]], noise, lambda x, i=noisy[k]: see(x, i))
        ours.update(noisy[k], voltage[k], 1.0)
        np.testing.assert_allclose(ours.coefficients[0], belief.mean, rtol=2e-4, atol=2e-7)
        assert ours.belief.variance == pytest.approx(belief.covariance[0, 0], rel=1e-3)


def test_the_quick_kernel_of_two_states_equals_the_general_one():
    """Also through faults, a rest and a full charge."""
    cell, generator = load_cell("lfp-2ah"), np.random.default_rng(5)
    current = pulses(cell, 6000, generator)
    current[4000:5200] = 0.0
    _, noisy, voltage = measured(cell, current, generator, soc=0.6)
    voltage[1000], voltage[2000:2030], voltage[3000:3100] = 3.9, 3.0, np.nan
    noisy[3500:3700] = np.nan
    steps = np.ones(6000)
    steps[3800], steps[3900] = 200.0, 4000.0
    sensors = Sensors(rest_after_s=600.0)
    quick = make_estimator("ekf", cell, soc=0.3, estimate=(), sensors=sensors)
    general = quick.copy()
    assert quick._settings.plain
    general._settings = general._settings._replace(plain=False)
    a, b = quick.run(noisy, voltage, steps), general.run(noisy, voltage, steps)
    np.testing.assert_allclose(a.soc, b.soc, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(a.variance, b.variance, rtol=1e-8)
    np.testing.assert_array_equal(a.flags, b.flags)
    assert np.any(a.flags & Flag.REST) and np.any(a.flags & Flag.OUTLIER) and np.any(a.flags & Flag.GAP)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("options", [{}, {"estimate": ()}, {"estimate": EVERYTHING, "current_bias": True}])
def test_a_batch_equals_single_updates_to_the_bit(kind, options):
    cell, generator = load_cell("a123-26650" if options else "lfp-2ah"), np.random.default_rng(6)
    current = pulses(cell, 500, generator)
    run, noisy, voltage = measured(cell, current, generator, soc=0.6)
    noisy[100:110], voltage[200:205], voltage[300] = np.nan, np.nan, 3.9
    batch = make_estimator(kind, cell, soc=0.4, **options)
    single = batch.copy()
    trace = batch.run(noisy, voltage, 1.0, run.temperature_C)
    for k in range(current.size):
        belief = single.update(noisy[k], voltage[k], 1.0, run.temperature_C[k])
        assert (belief.mean, belief.variance) == (trace.soc[k], trace.variance[k])
    assert {name: (e.value, e.sd) for name, e in single.parameters.items()} == {
        name: (e.value, e.sd) for name, e in batch.parameters.items()
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("name", "within", "seconds"), [("nmc-lgm50", 0.02, 60), ("lfp-2ah", 0.05, 600)])
def test_joint_filters_converge_from_a_soc_that_is_wrong_by_three_tenths(kind, name, within, seconds):
    cell = load_cell(name)
    for soc, offset in ((0.25, 0.3), (0.35, -0.3), (0.65, 0.3), (0.75, -0.3)):
        generator = np.random.default_rng(7)
        current = pulses(cell, 2400, generator, mean_C=0.4 if soc < 0.5 else -0.4)
        run, noisy, voltage = measured(cell, current, generator, soc=soc)
        estimator = make_estimator(kind, cell, soc=soc + offset, model_error_V=0.003)
        trace = estimator.run(noisy, voltage, 1.0, run.temperature_C)
        assert np.all(np.abs(trace.soc - run.soc)[seconds:] < within)


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_are_found_with_an_error_they_admit(kind):
    cell, generator = load_cell("nmc-lgm50"), np.random.default_rng(8)
    pair = cell.relaxation[0]
    plant = cell.with_values(
        capacity_Ah=cell.capacity_Ah * 0.95,
        resistance_ohm=cell.resistance_ohm * 1.15,
        relaxation=[
            {"resistance_ohm": p.resistance_ohm * 1.2, "time_constant_s": p.time_constant_s * 1.2}
            for p in cell.relaxation
        ],
    )
    current = np.concatenate([pulses(cell, 8000, generator, -0.2), pulses(cell, 8000, generator, 0.2)])
    current = current.clip(-5.0, 3.0)
    run, noisy, voltage = measured(plant, current, generator, soc=0.8)
    estimator = make_estimator(kind, cell, soc=0.7, model_error_V=0.0)
    estimator.run(noisy, voltage, 1.0, run.temperature_C, every=1000)
    truth = {
        "capacity_Ah": plant.capacity_Ah,
        "resistance_ohm": plant.resistance_ohm,
        "relaxation_resistance_ohm": pair.resistance_ohm * 1.2,
    }
    assert set(estimator.parameters) == set(truth)
    for name, value in truth.items():
        found = estimator.parameters[name]
        assert found.value == pytest.approx(value, rel=0.01)
        assert abs(found.value - value) < 4.0 * found.sd


@pytest.mark.parametrize("kind", KINDS)
def test_an_offset_of_the_current_sensor_is_found(kind):
    cell, generator = load_cell("nmc-lgm50"), np.random.default_rng(9)
    current = pulses(cell, 20000, generator).clip(-3.0, 3.0)
    current -= current.mean()
    run, noisy, voltage = measured(cell, current, generator, soc=0.5)
    options = {"estimate": (), "current_bias": True, "current_bias_sd_A": 0.1, "model_error_V": 0.0}
    estimator = make_estimator(kind, cell, soc=0.5, **options)
    estimator.run(noisy + 0.1, voltage, 1.0, run.temperature_C, every=1000)
    found = estimator.parameters["current_bias_A"]
    assert found.value == pytest.approx(0.1, abs=0.005)
    assert abs(found.value - 0.1) < 4.0 * found.sd


def test_chaos_of_order_0_is_the_deterministic_model_and_higher_ones_have_its_moments():
    """Without voltage nothing is learnt: SOC against the simulation of the mean, then of many cells."""
    cell, generator = straight_cell(), np.random.default_rng(10)
    current = np.full(3000, 1.0)
    quiet = Sensors(current_sd_A=0.0)
    options = {
        "estimate": ("capacity_Ah", "relaxation_resistance_ohm"),
        "capacity_sd": 0.15,
        "soc_drift": 0.0,
    }
    options |= {"capacity_drift": 0.0, "relaxation_drift": 0.0, "relaxation_start_V": 0.0}
    gone = np.full(current.size, np.nan)
    run = simulate(cell, current, 1.0, soc=0.3)
    flat = make_estimator("gpc_ekf", cell, soc=0.3, soc_sd=0.1, sensors=quiet, order=0, **options)
    np.testing.assert_allclose(flat.run(current, gone).soc, run.soc, rtol=0.0, atol=1e-12)
    assert flat.coefficients[0, 1] == pytest.approx(run.relaxation_V[-1, 0], rel=1e-12)

    wide = make_estimator("gpc_ekf", cell, soc=0.3, soc_sd=0.1, sensors=quiet, order=4, **options)
    wide.run(current, gone)
    m = 200_000
    soc, ln_q, ln_r = (s * math.sqrt(3.0) * generator.uniform(-1, 1, m) for s in (0.1, 0.15, 0.3))
    # The model is exact in closed form, so that a million steps are one.
    end = 0.3 + soc + 2999.0 / (cell.capacity_C * np.exp(ln_q))
    v = 0.012 * np.exp(ln_r) * (1.0 - np.exp(-2999.0 / (30.0 * np.exp(ln_r))))
    few = simulate_members(cell, current, 1.0, soc=(0.3 + soc[:5]), capacity_factor=np.exp(ln_q[:5]))
    np.testing.assert_allclose(few.soc[:, -1], end[:5], rtol=1e-12)
    chaos = wide.coefficients
    assert chaos[0, 0] == pytest.approx(end.mean(), abs=4.0 * end.std() / math.sqrt(m))
    assert np.sum(chaos[1:, 0] ** 2) == pytest.approx(end.var(), rel=0.02)
    assert wide.belief.variance == pytest.approx(end.var(), rel=0.02)
    assert chaos[0, 1] == pytest.approx(v.mean(), abs=4.0 * v.std() / math.sqrt(m))
    assert np.sum(chaos[1:, 1] ** 2) == pytest.approx(v.var(), rel=0.02)
    assert end.mean() - run.soc[-1] > 0.004


@pytest.mark.parametrize("kind", KINDS)
def test_a_full_charge_and_a_rest_set_a_lost_soc_right(kind):
    cell = load_cell("lfp-2ah")
    n = 1200
    current = np.full(n, 0.08)
    voltage = np.full(n, 3.6) + 1e-4 * np.random.default_rng(11).normal(size=n)
    full = make_estimator(kind, cell, soc=0.7, soc_sd=0.02, model_error_V=0.005)
    trace = full.run(current, voltage, 1.0)
    assert np.any(trace.flags & Flag.FULL)
    assert full.belief.mean == pytest.approx(1.0, abs=0.02)

    sensors = Sensors(rest_after_s=600.0)
    at_rest = float(cell.ocv(0.15)) + 1e-3 * np.random.default_rng(12).normal(size=n)
    resting = make_estimator(kind, cell, soc=0.22, soc_sd=0.05, sensors=sensors)
    trace = resting.run(np.zeros(n), at_rest, 1.0)
    assert np.any(trace.flags & Flag.REST)
    assert abs(resting.belief.mean - 0.15) < 2.0 * math.sqrt(resting.belief.variance) < 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_a_spike_is_refused_and_a_wrong_belief_is_given_up(kind):
    cell, generator = load_cell("nmc-lgm50"), np.random.default_rng(13)
    current = pulses(cell, 3000, generator).clip(-5.0, 3.0)
    run, noisy, voltage = measured(cell, current, generator, soc=0.5)
    spiked = voltage.copy()
    spiked[1500] += 0.2
    calm, hit = (make_estimator(kind, cell, soc=0.5) for _ in range(2))
    a, b = calm.run(noisy, voltage, 1.0, run.temperature_C), hit.run(noisy, spiked, 1.0, run.temperature_C)
    assert b.flags[1500] & Flag.OUTLIER and not a.flags[1500] & Flag.OUTLIER
    assert abs(b.soc[1500] - a.soc[1500]) < 1e-3

    sure = make_estimator(kind, cell, soc=0.9, soc_sd=0.005)
    trace = sure.run(noisy, voltage, 1.0, run.temperature_C)
    assert trace.flags[0] & Flag.OUTLIER
    assert np.all(np.abs(trace.soc - run.soc)[300:] < 0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_the_gain_is_held_back_where_the_curve_is_flat(kind):
    """A voltage on the plateau moves the SOC less, one on the slope nearly as before."""
    cell = load_cell("lfp-2ah")
    for soc, ratio in ((0.5, 0.3), (0.03, 0.999)):
        free, held = (
            make_estimator(kind, cell, soc=soc, soc_sd=0.005, estimate=(), flat_slope_V=flat, **EXACT)
            for flat in (0.0, 0.2)
        )
        voltage = float(cell.ocv(soc)) + 0.002
        for estimator in (free, held):
            estimator.update(0.0, voltage, 1.0)
        moved = (held.belief.mean - soc) / (free.belief.mean - soc)
        assert 0.0 < moved < ratio if ratio < 0.5 else moved > 0.95
        assert held.belief.variance > free.belief.variance


@pytest.mark.parametrize("kind", KINDS)
def test_a_gap_and_missing_currents_raise_the_variance_but_never_beyond_ignorance(kind):
    cell, generator = load_cell("lfp-2ah"), np.random.default_rng(14)
    current = pulses(cell, 1200, generator)
    _, noisy, voltage = measured(cell, current, generator, soc=0.5)
    estimator = make_estimator(kind, cell, soc=0.5, soc_sd=0.02)
    estimator.run(noisy, voltage, 1.0)
    before = estimator.belief.variance
    blind = estimator.copy()
    blind.update(1.0, np.nan, 1500.0)
    assert blind.belief.variance > 2.0 * before
    for _ in range(50):
        blind.update(np.nan, np.nan, 50.0)
    assert blind.belief.variance == pytest.approx(1.0 / 12.0)
    assert not blind.trusted


def test_wrong_options_are_told():
    cell = load_cell("lfp-2ah")
    with pytest.raises(BatteryError, match="estimate"):
        make_estimator("ekf", cell, estimate=("capacity",))
    with pytest.raises(BatteryError, match="order"):
        make_estimator("gpc_ekf", cell, order=9)
    with pytest.raises(BatteryError, match="kappa"):
        make_estimator("ukf", cell, kappa=-9.0)
    nodes = make_estimator("gpc_ekf", cell, nodes="tensor").collocation.nodes
    assert nodes.shape == (81, 4)
