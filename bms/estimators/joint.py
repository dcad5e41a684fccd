r"""What the Kalman-type filters share: state, options, and how they stay honest when the model is wrong.

**State.** SOC, one or two relaxation voltages, hysteresis where the cell has it, an offset of the current
sensor if wanted, and :math:`\theta = \ln(p / p_{nominal})` of each estimated parameter p, so that
parameters stay positive and keep the nominal cell's dependence on SOC and temperature. All relaxation pairs
share one factor on their resistances and one on their capacitances; what is reported is the first pair, at
50 % SOC and the reference temperature. Parameters and offset walk at random (joint estimation: Plett, J.
Power Sources 134, 2004, parts 2, 3). The model is that of `bms.cell`, moved exactly over a step; the noise
of the current sensor drives all states at once. A voltage has the variance :math:`r = \sigma_V^2 + R^2
\sigma_I^2`, more where the current is in doubt.

**Any gain.** Covariances go through an update by Joseph's form, :math:`(1 - k h^T) P (1 - k h^T)^T + k r
k^T`, which holds for any gain k: one held back where the OCV is flat (`flat_slope_V`; Schmidt's partial
update), one cut off, one that is optimal for other assumptions.

**Model error.** No circuit is a cell. The voltage of the model is off by a slow error :math:`e \sim N(0,
s_e^2)` (wrong OCV, hysteresis, resistance), which a state filter mistakes for SOC: over and over the same
error is averaged as if it were noise. Here e is *considered*, not estimated (Schmidt, Adv. Control Syst. 3,
1966): beside P, the covariance of everything else, the filter carries U, the covariance of the state due to
an e of unit variance, and :math:`u = cov(x, e) / s_e^2`. Over a step :math:`U \leftarrow \Phi U \Phi^T`,
:math:`u \leftarrow \rho\,\Phi u` with :math:`\rho = 1 - \min(h / \tau_e, |I| h / (Q\,\delta_e))`: an error
is forgotten when both time and charge have passed. At a voltage

.. math::

    w = U h + u, \quad k = \frac{P h + s_e^2 w}{h^T P h + s_e^2 (h^T w + h^T u + 1) + r}, \quad
    u \leftarrow u - k\,(h^T u + 1), \quad
    U \leftarrow U - k w^T - w k^T + k k^T (h^T w + h^T u + 1) .

What is reported is :math:`P + s_e^2 U`. Since U is kept per unit of variance, an :math:`s_e` that grows is
felt at once in all that was learnt before it did. The gain on the SOC is never negative: that would be a
bet on an error that stays as it was, and hysteresis turns. A quarter of the error's variance is taken to
change within a minute, which keeps parameters from following the error.

**Watch.** The innovations :math:`\nu` of a right model are white. Their mean over some five minutes has a
known variance (white noise, and the slow part :math:`h^T P h + s_e^2 \ldots`); where it is larger by far,
its square is the new :math:`s_e^2`, which is forgotten over half a day. Squares beyond their expectation are
added to r. Either is a mismatch, which may be the current's: while the mean :math:`\bar\nu` stands beyond
what was given, the variance of the SOC grows by :math:`d'^2 - d^2`, :math:`d' = d + |\bar\nu| h / (R + R_1
+ R_2)`, as over missing currents.

**Giving up.** A refused voltage (an innovation beyond `outlier_sigmas`) leaves the count alone. Refused for
as long as voltages were believed before, between ten seconds and five minutes, or with a mean that no
believable error explains, they are held to be right and the belief wrong. It is given up, as it is when a
mismatch stands for five minutes, and twice as long each time it comes back: parameters, hysteresis and their
variances are again those before the first sample, for nothing tells what the wrong voltages taught, and the
SOC may be anything. `Flag.MISMATCH` stands some minutes longer than what called for it, and 20 minutes after
refused voltages.

**Wide beliefs.** Where the SOC is uncertain by more than 1 %, the curve is seen by differences over a
standard deviation, and the variance that its bend leaves out counts as noise that lasts for a minute (ten
with hysteresis, which hides where on the curve the cell stands).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bms._ecm import parameters_at
from bms.belief import SocBelief
from bms.cell import Cell
from bms.circuit import tabulate
from bms.estimators import _gate, _joint, _report, _watch
from bms.estimators._joint import Noise, Places, Settings
from bms.estimators._watch import Watch
from bms.estimators.base import KernelEstimator
from bms.estimators.gate import Sensors, gate_for, quiet_sd_A

Array = NDArray[np.float64]

Name = Literal["capacity_Ah", "resistance_ohm", "relaxation_resistance_ohm", "relaxation_capacitance_F"]

DAY_S = 86400.0
LARGEST_ERROR_V = 0.05
"""A model error up to this (or three times the given one) is believed before the belief is given up."""
ERROR_WITH_V, ERROR_WITHOUT_V = 0.005, 0.02
"""Model error by default, for a cell with and without hysteresis: measured LFP cells turn by 14 to 25 mV."""
LOST_V = 0.02
"""Standard deviation of the relaxation voltages of a cell when a belief is given up."""
BEND_WITH_S, BEND_WITHOUT_S = 600.0, 60.0
"""How long the error of a bent curve lasts; hysteresis hides where on the curve a wide belief stands."""
MOST_CAPACITY, MOST_OHM = math.log(2.0), math.log(5.0)
"""Logarithms of the largest factors that are believed."""


class JointOptions(BaseModel):
    """Options that `ekf`, `ukf` and `gpc_ekf` share."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, protected_namespaces=())

    estimate: tuple[Name, ...] = Field(
        default=("capacity_Ah", "resistance_ohm", "relaxation_resistance_ohm"),
        description="parameters to estimate with the SOC; none leaves the states alone",
    )
    current_bias: bool = Field(default=False, description="estimate an offset of the current sensor")
    capacity_sd: float = Field(default=0.05, gt=0.0, description="relative error of the nominal capacity")
    resistance_sd: float = Field(default=0.2, gt=0.0, description="... of the series resistance")
    relaxation_sd: float = Field(default=0.3, gt=0.0, description="... of relaxation resistance, capacitance")
    current_bias_sd_A: float = Field(default=0.02, gt=0.0, description="offset of the current sensor, A")
    capacity_drift: float = Field(default=0.001, ge=0.0, description="relative change in a day")
    resistance_drift: float = Field(default=0.02, ge=0.0, description="relative change in a day")
    relaxation_drift: float = Field(default=0.02, ge=0.0, description="relative change in a day")
    current_bias_drift_A: float = Field(default=0.002, ge=0.0, description="change in a day, A")
    soc_drift: float = Field(default=0.001, ge=0.0, description="change unseen by the current in a day")
    relaxation_start_V: float = Field(default=0.005, ge=0.0, description="relaxation voltage at the start, V")
    hysteresis_start: float = Field(default=0.577, ge=0.0, le=1.0, description="hysteresis at the start")
    model_error_V: float | None = Field(
        default=None,
        ge=0.0,
        description="slow error of the modelled voltage, V; 0.005 for a cell with hysteresis, 0.02 without",
    )
    model_error_s: float = Field(default=3600.0, gt=0.0, description="time over which it changes, s, ...")
    model_error_soc: float = Field(default=0.1, gt=0.0, description="... and charge, as a share of SOC")
    watches: bool = Field(default=True, description="raise the model error when innovations show more")
    outlier_sigmas: float = Field(default=6.0, ge=3.0, description="innovations beyond are refused")
    flat_slope_V: float = Field(
        default=0.0, ge=0.0, description="OCV slope below which the gain on the SOC is held back, V"
    )
    full_sd: float = Field(default=0.01, gt=0.0, description="error of the SOC at full charge")
    rest_doubt_V: float = Field(default=0.005, gt=0.0, description="error of the OCV curve and the rest, V")
    resets_at_rest: bool = Field(default=True, description="weigh the voltage after a long rest")
    resets_at_full: bool = Field(default=True, description="set the SOC to 1 at full charge")


def places_of(cell: Cell, options: JointOptions) -> Places:
    """Lay out the state of a cell."""
    moving = 2
    v2 = moving if len(cell.relaxation) == 2 else -1
    moving += v2 >= 0
    hysteresis = moving if cell.hysteresis else -1
    moving += hysteresis >= 0
    size = moving
    chosen = {
        "bias": options.current_bias,
        "capacity": "capacity_Ah" in options.estimate,
        "resistance": "resistance_ohm" in options.estimate,
        "relaxation": "relaxation_resistance_ohm" in options.estimate and bool(cell.relaxation),
        "capacitance": "relaxation_capacitance_F" in options.estimate and bool(cell.relaxation),
    }
    found = {}
    for name, wanted in chosen.items():
        found[name] = size if wanted else -1
        size += wanted
    return Places(size=size, moving=moving, v2=v2, hysteresis=hysteresis, **found)


def settings_of(cell: Cell, options: JointOptions, sensors: Sensors, places: Places) -> Settings:
    """Turn options into what the kernels take."""
    hysteresis_V = float(np.max(cell.hysteresis.voltage_V)) if cell.hysteresis else 0.0
    noise = Noise(
        current_A2=sensors.current_sd_A**2,
        voltage_V2=sensors.voltage_sd_V**2,
        error_per_s=1.0 / options.model_error_s,
        error_per_soc=1.0 / options.model_error_soc,
        limit_A=gate_for(cell, sensors).current_limit_A,
        full_variance=options.full_sd**2,
        rest_V=math.hypot(cell.series * options.rest_doubt_V, hysteresis_V),
        flat_V=cell.series * options.flat_slope_V,
        bend_s=BEND_WITH_S if cell.hysteresis else BEND_WITHOUT_S,
        still_A=3.0 * quiet_sd_A(cell, sensors),
        resets_at_rest=options.resets_at_rest,
        resets_at_full=options.resets_at_full,
    )
    watch = Watch(
        error_V2=model_error_of(cell, options) ** 2,
        most_V2=max(cell.series * LARGEST_ERROR_V, 3.0 * model_error_of(cell, options)) ** 2,
        outlier=options.outlier_sigmas**2,
        active=options.watches,
        lost_V2=(cell.series * LOST_V) ** 2,
        seen_V2=(0.5 * sensors.voltage_sd_V) ** 2,
    )
    plain = places.size == 2 and not tabulate(cell).varies
    return Settings(places, noise, watch, nominal_of(cell, places), plain)


def model_error_of(cell: Cell, options: JointOptions) -> float:
    """Slow error of the modelled voltage; most of it is hysteresis where the cell's model has none."""
    if options.model_error_V is not None:
        return cell.series * options.model_error_V
    return cell.series * (ERROR_WITH_V if cell.hysteresis else ERROR_WITHOUT_V)


def names_of(places: Places) -> tuple[str, ...]:
    """Names of the parameters that a filter reports, in its order."""
    named = {
        "current_bias_A": places.bias,
        "capacity_Ah": places.capacity,
        "resistance_ohm": places.resistance,
        "relaxation_resistance_ohm": places.relaxation,
        "relaxation_capacitance_F": places.capacitance,
    }
    return tuple(name for name, at in named.items() if at >= 0)


def nominal_of(cell: Cell, places: Places) -> Array:
    """Say what a factor of 1 on each parameter means, at 50 % SOC and the reference temperature."""
    circuit = tabulate(cell)
    r, r1, tau1, *_ = parameters_at(
        circuit.table,
        circuit.temperature_C,
        circuit.activation_K,
        circuit.reference_K,
        0.5,
        cell.reference_temperature_C,
    )
    nominal = {
        places.bias: 0.0,
        places.capacity: cell.capacity_Ah,
        places.resistance: r,
        places.relaxation: r1,
        places.capacitance: tau1 / r1 if r1 else 1.0,
    }
    return np.array([nominal[at] for at in range(places.moving, places.size)])


def start_of(cell: Cell, belief: SocBelief, options: JointOptions, places: Places) -> Array:
    """Lay out the memory of a filter before its first sample."""
    n = places.size
    memory = np.zeros(_watch.END + _joint.rows_of(n) * n)
    memory[_gate.TEMPERATURE_C] = cell.reference_temperature_C
    memory[_watch.TRUST_S] = _watch.LEAST_TRUST_S
    memory[_watch.PATIENCE_S] = _watch.LEAST_PATIENCE_S
    memory[_watch.ERROR_V2] = model_error_of(cell, options) ** 2
    m = memory[_watch.END :].reshape(-1, n)
    m[_joint.STATE, 0] = belief.mean
    m[_joint.LOWER], m[_joint.UPPER] = -np.inf, np.inf
    relaxes, day = bool(cell.relaxation), DAY_S
    for at, sd, drift, lower, upper in (
        (0, math.sqrt(belief.variance), options.soc_drift, 0.0, 1.0),
        (1, cell.series * options.relaxation_start_V if relaxes else 0.0, 0.0, -math.inf, math.inf),
        (places.v2, cell.series * options.relaxation_start_V, 0.0, -math.inf, math.inf),
        (places.hysteresis, options.hysteresis_start, 0.0, -1.0, 1.0),
        (places.bias, options.current_bias_sd_A, options.current_bias_drift_A, -math.inf, math.inf),
        (places.capacity, options.capacity_sd, options.capacity_drift, -MOST_CAPACITY, MOST_CAPACITY),
        (places.resistance, options.resistance_sd, options.resistance_drift, -MOST_OHM, MOST_OHM),
        (places.relaxation, options.relaxation_sd, options.relaxation_drift, -MOST_OHM, MOST_OHM),
        (places.capacitance, options.relaxation_sd, options.relaxation_drift, -MOST_OHM, MOST_OHM),
    ):
        if at >= 0:
            m[_joint.MOVED + n + at, at] = m[_joint.PRIOR, at] = sd**2
            m[_joint.DRIFT, at] = drift**2 / day
            m[_joint.LOWER, at], m[_joint.UPPER, at] = lower, upper
    return memory


class JointEstimator(KernelEstimator):
    """Base of the Kalman-type estimators: what they report of their memory.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    belief : SocBelief
        Belief at the start.
    sensors : Sensors
        The sensors.
    joint : Settings
        Settings that the filters share.
    settings : NamedTuple
        Settings of the kernel, which hold those.
    memory : ndarray
        Memory from `start_of`, and what a filter keeps behind it.
    terms : int
        Rows of chaos coefficients at the end of the memory.
    """

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        sensors: Sensors,
        joint: Settings,
        settings: Any,
        memory: Array,
        terms: int = 0,
    ) -> None:
        self._joint, self._terms = joint, terms
        super().__init__(cell, gate_for(cell, sensors), settings, memory, names_of(joint.places), belief)
        error_V2 = float(memory[_watch.ERROR_V2])
        m, chaos = self._beliefs()
        _report.report(joint.places, m, chaos, joint.nominal, error_V2, self._row)

    def _beliefs(self) -> tuple[Array, Array]:
        """Views of the belief's rows and of the chaos coefficients."""
        n = self._joint.places.size
        rows = self._memory[_watch.END :].reshape(-1, n)
        count = _joint.rows_of(n)
        return rows[:count], rows[count : count + self._terms]

    def _correlation(self) -> Array:
        """Correlation of the parameters; that of their logarithms is the same to first order."""
        n, first = self._joint.places.size, self._joint.places.moving
        m, chaos = self._beliefs()
        top = _joint.MOVED + n
        covariance = m[top : top + n] + self._memory[_watch.ERROR_V2] * m[top + n : top + 2 * n]
        covariance = (covariance + chaos[1:].T @ chaos[1:])[first:, first:]
        sd = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(sd, sd))
