r"""The report's recursive gPC estimator of charge, capacity and resistances ([M] eqs 57-87).

With the charge :math:`x_1 = \int I`, the cell of [M] eqs 55-56 reads (eqs 58-65)

.. math::

    \dot x_2 = -\sigma x_2 + I, \qquad
    V = V_0 + \alpha C_0 (x_{10} + x_1) + \beta x_2 + R I, \qquad
    \alpha = \tfrac1Q,\; \beta = \tfrac1{C_r},\; \sigma = \tfrac1{R_r C_r},

linearised at the present estimate of the SOC: :math:`C_0` is the slope of the OCV there and :math:`V_0 =
V_{oc} - C_0\,SOC`. The unknown :math:`\sigma = \sigma_0 + \sigma_1 \xi` is a random variable, uniform on
its bounds, and :math:`x_2 \approx \sum_i \varphi_i(\xi)\,q_i(t)` its Galerkin expansion in N Legendre
polynomials (eqs 66-77), so that the model is a sum of known signals times functions of the parameters:

.. math::

    V - V_0 = c(\theta)^T z, \quad z = [C_0,\; C_0 x_1,\; I,\; q_1 \ldots q_N], \quad
    c = [\alpha x_{10},\; \alpha,\; R,\; \beta \varphi_i(\xi)], \quad
    \theta = [\alpha, R, \beta, \xi, x_{10}] .

The cost :math:`J = \tfrac12 \int \lambda^{t-\tau} (V - V_m)^2` is then a quadratic form of :math:`c`,
kept as :math:`M = \int \lambda^{t-\tau} z z^T` and :math:`b = \int \lambda^{t-\tau} z (V_0 - V_m)`, and
the update laws of eqs 80-85 are (ERRATA.md)

.. math:: \dot\theta = -\Gamma\,\Bigl(\frac{\partial c}{\partial\theta}\Bigr)^T (M c + b) .

**The Galerkin system is solved in its eigenbasis.** For an orthonormal basis its matrix is symmetric,
with the eigenvalues :math:`-(\sigma_0 + \sigma_1 \xi_j)` at the N Gauss nodes :math:`\xi_j`; in the
eigenbasis it falls apart into N relaxations, moved exactly over any step, and :math:`\sum_i
\varphi_i(\xi) q_i` becomes :math:`\sum_j L_j(\xi)\,y_j` with the Lagrange polynomials through the nodes.
A test holds this against eqs 73-85 written out.

**Steps.** The gradient's gains are those of Table 8, scaled to the cell: a gain has the dimension of its
parameter squared over volt squared second squared, so it is multiplied with the square of the ratio of the
nominal values, and divided by the square of the cells in series, with which all volts grow. A step goes at
most to the minimum of the quadratic form along it, so no gain and no current makes it unstable.
`GpcGaussNewton` steps to the minimum of the linearised problem instead, with the parameters' prior. Old
samples were linearised at old estimates of the SOC; when a Gauss-Newton step moves the SOC, they are
forgotten by :math:`\exp(-|\Delta SOC| / 3\,\%)`.

**Variance.** Least squares on the same M, with the prior :math:`P_0` and the intensity :math:`s` of the
output error, has the covariance :math:`P = (D^T M D / s + P_0^{-1})^{-1}`, :math:`D = \partial c /
\partial\theta`. The error is white noise, what the residuals, :math:`J` over its weight, show beyond it, and
a small error of the model that they need not show; the last two are slow, so they count with their
correlation time. What a gradient still has to go to the least-squares solution is added to the deviation. So
the variance grows when model and cell differ.

**Wrong readings.** Voltages far from what is expected (eight standard deviations of recent residuals) are
refused, for up to five minutes; beyond ten seconds, which a spike may last, the counted charge is in doubt by
the current that would explain them, as the current may be the reading that is wrong. After that, and when
residuals have a mean that stands for five minutes (twice as long each time it comes back) though they had
none before, what was learnt is given up: M and b are emptied, the parameters start anew, and the SOC may be
anything, as doubt about :math:`x_1`. While the mean stands, that doubt grows by the current that would
explain it, as in `bms.estimators.joint`. A mean counts against the doubt as one error that lasts as long as
the mean is taken over, not as a new one with every sample: it may be the model's.

**Temperature.** Where it is not measured and the cell has a thermal node, the node is simulated from the heat
that the measured voltage shows, in surroundings of ``Sensors.ambient_C``.

**Rest and full charge** are measurements of the SOC: they enter M and b as samples of :math:`\alpha
(x_{10} + x_1)`, and the estimate at once. A charge that was not seen (a missing current, a gap) is a
doubt about :math:`x_1`, which a scalar Kalman step on the voltage resolves.

When to use: `gpc_gradient` to reproduce the report and for a slow, calm health estimate;
`gpc_gauss_newton` for health estimates within hours.
"""

from __future__ import annotations

from typing import ClassVar, Literal, final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms._ecm import parameters_at
from bms.belief import SocBelief
from bms.cell import Cell
from bms.circuit import tabulate
from bms.errors import BatteryError
from bms.estimators import _gate, _gpc_belief, _gpc_form, _gpc_gradient, _watch
from bms.estimators.base import LEADING, Kernel, KernelEstimator
from bms.estimators.gate import Sensors, gate_for, quiet_sd_A
from bms.estimators.joint import LOST_V
from gpc.basis import Legendre

Array = NDArray[np.float64]

PARAMETERS = ("capacity_Ah", "resistance_ohm", "relaxation_resistance_ohm", "relaxation_capacitance_F")
"""Parameters that are always estimated."""
LEAST_LOST_V = 1e-5
"""What a doubtful current leaves in the voltage of a cell is over below this."""


class Gains(BaseModel):
    """Gains of the gradient for the cell of [M] Table 7 (Table 8), or the user's own for his cell.

    In SI: charge in coulomb, alpha in 1/C, x10 in C, an update per second.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    alpha: float = Field(default=2e-14, ge=0.0, description="gain of 1 / Q")
    resistance: float = Field(default=1e-8, ge=0.0, description="gain of R")
    beta: float = Field(default=1e-10, ge=0.0, description="gain of 1 / C_r")
    xi: float = Field(default=1e-5, ge=0.0, description="gain of xi")
    x10: float = Field(default=100.0, ge=0.0, description="gain of the charge at the start")
    bias: float = Field(default=1e-8, ge=0.0, description="gain of the current sensor's offset")


class InitialGuess(BaseModel):
    """Parameters that the estimator starts from; the nominal cell's where left out."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    capacity_Ah: float | None = Field(default=None, gt=0.0, description="capacity, Ah")
    resistance_ohm: float | None = Field(default=None, gt=0.0, description="series resistance, ohm")
    relaxation_resistance_ohm: float | None = Field(default=None, gt=0.0, description="R_r, ohm")
    relaxation_capacitance_F: float | None = Field(default=None, gt=0.0, description="C_r, F")


class GpcGradientOptions(BaseModel):
    """Options of the recursive gPC estimators."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, protected_namespaces=())

    terms: int | None = Field(
        default=None,
        ge=1,
        le=8,
        description="terms N of the expansion; 1 is none; by default 3, and 5 for Gauss-Newton",
    )
    forgetting: float = Field(default=0.99999, gt=0.0, le=1.0, description="lambda, per second")
    sigma_per_s: tuple[float, float] | None = Field(
        default=None, description="bounds of 1 / (R_r C_r), 1/s; 0.6 to 1.8 times the nominal by default"
    )
    gains: Gains | Literal["scaled"] = Field(
        default="scaled", description="gains of the gradient; Table 8 scaled to the cell by default"
    )
    initial: InitialGuess = Field(default=InitialGuess(), description="what to start from")
    start_after_s: float = Field(default=0.0, ge=0.0, description="count charge only until then, s")
    current_bias: bool = Field(default=False, description="estimate the current sensor's offset")
    flat_slope_V: float = Field(
        default=0.0,
        ge=0.0,
        description="where the OCV is flatter than this per unit of SOC, samples count less",
    )
    every_s: float = Field(default=60.0, gt=0.0, description="time between Gauss-Newton steps, s")
    capacity_share: float = Field(default=0.15, gt=0.0, description="prior relative deviation of Q")
    resistance_share: float = Field(default=0.3, gt=0.0, description="the same of R and C_r")
    bias_sd_A: float = Field(default=0.05, gt=0.0, description="prior deviation of the offset, A")
    correlation_s: float = Field(
        default=7200.0, ge=0.0, description="correlation time of what residuals show beyond noise, s"
    )
    model_error_V: float = Field(
        default=0.001,
        ge=0.0,
        description="slow error of the model, per cell in series, that residuals need not show, V",
    )
    full_sd: float = Field(default=0.01, ge=0.0, description="error of the SOC at full charge")
    rest_doubt_V: float = Field(default=0.005, gt=0.0, description="error of the OCV curve and the rest, V")
    resets_at_rest: bool = Field(default=False, description="weigh the voltage after a long rest")
    resets_at_full: bool = Field(default=True, description="take the SOC for 1 at full charge")

    @model_validator(mode="after")
    def _check(self) -> GpcGradientOptions:
        if self.sigma_per_s is not None and not 0.0 < self.sigma_per_s[0] < self.sigma_per_s[1]:
            raise ValueError(f"sigma_per_s must be two rates, 0 < low < high, got {self.sigma_per_s}")
        return self


class _GpcLeastSquares(KernelEstimator):
    """What the two estimators share."""

    kernel: ClassVar[Kernel] = staticmethod(_gpc_gradient.run)
    newton: ClassVar[bool]
    usual_terms: ClassVar[int]

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        options: GpcGradientOptions | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        chosen, sensed = options or GpcGradientOptions(), sensors or Sensors()
        reference = _reference(cell)
        if chosen.terms is None:
            chosen = chosen.model_copy(update={"terms": self.usual_terms})
        terms = chosen.terms or self.usual_terms
        settings = _settings(cell, belief, chosen, sensed, reference, self.newton)
        width = terms + (4 if chosen.current_bias else 3)
        own = np.zeros(_gpc_belief.SCALARS)
        own[_gpc_belief.PATIENCE_S] = _watch.LEAST_PATIENCE_S
        memory = np.concatenate(
            [np.zeros(_gate.SIZE), own, settings.start, np.zeros(terms + width + width * width)]
        )
        memory[_gate.TEMPERATURE_C] = cell.reference_temperature_C
        names = (*PARAMETERS, "current_bias_A") if chosen.current_bias else PARAMETERS
        super().__init__(cell, gate_for(cell, sensed), settings, memory, names, belief)
        self._describe(settings)

    def _correlation(self) -> Array:
        """Correlation of the parameters as least squares with the prior sees it, shape (m, m)."""
        settings: _gpc_belief.Settings = self._settings
        n, nodes = settings.parameters, settings.node.size
        width = nodes + (3 if n < _gpc_form.THETA else 4)
        at = _gate.SIZE
        x = self._memory[at : at + _gpc_belief.SCALARS]
        theta = self._memory[at + _gpc_belief.SCALARS :][: _gpc_form.THETA]
        lower = self._memory[-width * width :].reshape(width, width)
        m = np.tril(lower) + np.tril(lower, -1).T
        value, slope = np.empty(nodes), np.empty(nodes)
        _gpc_form.lagrange(settings.node, settings.barycentric, theta[_gpc_form.XI], value, slope)
        rows = np.zeros((n, width))
        with_bias = n == _gpc_form.THETA
        for p in range(n):
            _gpc_form.push_forward(theta, value, slope, np.eye(_gpc_form.THETA)[p], with_bias, rows[p])
        scaled = rows.T * settings.prior_sd[:n]
        count = x[_gpc_belief.COUNT]
        noise_V2s = settings.noise_V2 * (x[_gpc_belief.WEIGHT_S] / count if count > 0.0 else 1.0)
        posterior = np.linalg.inv(scaled.T @ m @ scaled / noise_V2s + np.eye(n))
        told = self._told(theta) * settings.prior_sd[:n]
        covariance = told @ posterior @ told.T
        sd = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(sd, sd))

    def _told(self, theta: Array) -> Array:
        """Derivative of the reported parameters by theta, up to the factors on each, shape (m, n)."""
        settings: _gpc_belief.Settings = self._settings
        sigma = settings.sigma_mid_per_s + settings.sigma_half_per_s * theta[_gpc_form.XI]
        told = np.zeros((len(self._names), settings.parameters))
        told[0, _gpc_form.ALPHA] = -1.0 / theta[_gpc_form.ALPHA] ** 2
        told[1, _gpc_form.R] = 1.0
        told[2, _gpc_form.BETA] = 1.0 / sigma
        told[2, _gpc_form.XI] = -theta[_gpc_form.BETA] * settings.sigma_half_per_s / sigma**2
        told[3, _gpc_form.BETA] = -1.0 / theta[_gpc_form.BETA] ** 2
        if settings.parameters == _gpc_form.THETA:
            told[4, _gpc_form.BIAS] = 1.0
        return told

    def _describe(self, settings: _gpc_belief.Settings) -> None:
        """Fill the row with what is believed before any sample."""
        theta, sd = settings.start, settings.prior_sd
        sigma = settings.sigma_mid_per_s + settings.sigma_half_per_s * theta[_gpc_form.XI]
        beta = theta[_gpc_form.BETA]
        values = [1.0 / (3600.0 * theta[0]), theta[1], beta / sigma, 1.0 / beta, 0.0]
        shares = [sd[0] / theta[0], sd[1] / theta[1], sd[2] / beta, sd[2] / beta]
        deviations = [value * share for value, share in zip(values, shares, strict=False)] + [sd[5]]
        n = len(self._names)
        self._row[LEADING:] = values[:n] + deviations[:n]


@final
class GpcGradient(_GpcLeastSquares):
    """The report's estimator: a gradient step for every sample.

    Parameters
    ----------
    cell : Cell
        Nominal cell, with a relaxation pair.
    belief : SocBelief
        Belief at the start.
    options : GpcGradientOptions
        Expansion, gains, bounds.
    sensors : Sensors
        The sensors.

    Raises
    ------
    BatteryError
        When the cell has no relaxation pair, or a guess lies outside the bounds.
    """

    name: ClassVar[str] = "gpc_gradient"
    newton: ClassVar[bool] = False
    usual_terms: ClassVar[int] = 3


@final
class GpcGaussNewton(_GpcLeastSquares):
    """The same cost, with Gauss-Newton steps; parameters and errors as for `GpcGradient`."""

    name: ClassVar[str] = "gpc_gauss_newton"
    newton: ClassVar[bool] = True
    usual_terms: ClassVar[int] = 5


def _reference(cell: Cell) -> Array:
    """R, R1, tau1, R2, tau2 of the cell at half charge and its reference temperature."""
    if not cell.relaxation:
        raise BatteryError(
            f"the cell {cell.name!r} has no relaxation pair, which the gPC estimators expand;"
            " add [[relaxation]] with resistance_ohm and time_constant_s, or choose ekf"
        )
    circuit = tabulate(cell)
    values = parameters_at(
        circuit.table,
        circuit.temperature_C,
        circuit.activation_K,
        circuit.reference_K,
        0.5,
        cell.reference_temperature_C,
    )
    return np.array(values[:5])


def _settings(
    cell: Cell, belief: SocBelief, chosen: GpcGradientOptions, sensed: Sensors, reference: Array, newton: bool
) -> _gpc_belief.Settings:
    guess = chosen.initial
    capacity_C = 3600.0 * (guess.capacity_Ah or cell.capacity_Ah)
    ohm = guess.resistance_ohm or float(reference[0])
    relaxation_ohm = guess.relaxation_resistance_ohm or float(reference[1])
    capacitance_F = guess.relaxation_capacitance_F or float(reference[2] / reference[1])
    sigma = 1.0 / (relaxation_ohm * capacitance_F)
    low_sigma, high_sigma = chosen.sigma_per_s or (0.6 * sigma, 1.8 * sigma)
    if not low_sigma <= sigma <= high_sigma:
        raise BatteryError(
            f"the guess of 1 / (R_r C_r), {sigma:.4g} 1/s, lies outside sigma_per_s ="
            f" ({low_sigma:g}, {high_sigma:g}); move the bounds or the guess"
        )
    middle, half = 0.5 * (low_sigma + high_sigma), 0.5 * (high_sigma - low_sigma)
    start = np.array(
        [1.0 / capacity_C, ohm, 1.0 / capacitance_F, (sigma - middle) / half, belief.mean * capacity_C, 0.0]
    )
    share, ohm_share = chosen.capacity_share, chosen.resistance_share
    soc_sd = max(belief.variance**0.5, 1e-4)
    prior = np.array(
        [share * start[0], ohm_share * ohm, ohm_share * start[2], 1.0, soc_sd * capacity_C, chosen.bias_sd_A]
    )
    node, _ = Legendre().gauss(chosen.terms or 3)
    apart = node[:, None] - node[None, :] + np.eye(node.size)
    return _gpc_belief.Settings(
        node=node,
        barycentric=1.0 / np.prod(apart, axis=1),
        low=np.array([0.4, 0.05, 0.05, 0.0, 0.0, 0.0]) * start
        + np.array([0, 0, 0, -1.0, 0, -10 * chosen.bias_sd_A]),
        high=np.array([2.5, 20.0, 20.0, 0.0, 0.0, 0.0]) * start
        + np.array([0, 0, 0, 1.0, 0, 10 * chosen.bias_sd_A]),
        gain=_gains(chosen, cell),
        prior_sd=prior,
        start=start,
        sigma_mid_per_s=middle,
        sigma_half_per_s=half,
        log_forgetting_per_s=float(np.log(chosen.forgetting)),
        start_after_s=chosen.start_after_s,
        noise_V2=sensed.voltage_sd_V**2 + (ohm * sensed.current_sd_A) ** 2,
        limit_A=gate_for(cell, sensed).current_limit_A,
        model_error_V2=(cell.series * chosen.model_error_V) ** 2,
        current_sd_A=sensed.current_sd_A,
        still_A=3.0 * quiet_sd_A(cell, sensed),
        lately_V=cell.series * LOST_V,
        least_lost_V=cell.series * LEAST_LOST_V,
        correlation_s=chosen.correlation_s,
        flat_slope_V=cell.series * chosen.flat_slope_V,
        reference=reference,
        parameters=6 if chosen.current_bias else 5,
        newton_every_s=chosen.every_s if newton else 0.0,
        full_sd=chosen.full_sd,
        rest_doubt_V=cell.series * chosen.rest_doubt_V,
        resets_at_rest=chosen.resets_at_rest,
        resets_at_full=chosen.resets_at_full,
    )


TABLE_7 = {"capacity_C": 7200.0, "resistance_ohm": 0.008, "capacitance_F": 2700.0}
"""The cell that the gains of Table 8 belong to."""


def _gains(chosen: GpcGradientOptions, cell: Cell) -> Array:
    """Gains in the order of theta; Table 8 scaled by the squares of the ratios of nominal values.

    They belong to the volts of one cell; those of a pack are more by the cells in series.
    """
    own = chosen.gains if isinstance(chosen.gains, Gains) else Gains()
    gains = np.array([own.alpha, own.resistance, own.beta, own.xi, own.x10, own.bias])
    if not chosen.current_bias:
        gains[_gpc_form.BIAS] = 0.0
    if isinstance(chosen.gains, Gains):
        return gains
    reference = _reference(cell)
    more_C = cell.capacity_C / TABLE_7["capacity_C"]
    more_ohm = reference[0] / TABLE_7["resistance_ohm"]
    more_F = reference[2] / reference[1] / TABLE_7["capacitance_F"]
    ratios = np.array([1.0 / more_C, more_ohm, 1.0 / more_F, 1.0, more_C, more_C]) / cell.series
    return np.asarray(gains * np.square(ratios))
