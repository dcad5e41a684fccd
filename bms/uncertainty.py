r"""How well a battery-management system knows its SOC: the model of [L] section 2.1.

The true SOC ``x`` and the estimate ``s`` with error variance ``p`` evolve over a step of length ``h`` as

.. math::

    x' &= x + h i / Q + d, & d &\sim N(0, h (\gamma + \beta |i|))  && \text{[L] 1, 3} \\
    y &= x + w, & w &\sim N(0, \mu\,\alpha(x))                     && \text{[L] 2, 4} \\
    s' &= s + h i / Q + K (y - s), & K &= p / (p + \sigma_w^2)     && \text{[L] 5, 8} \\
    p' &= p \sigma_w^2 / (p + \sigma_w^2) + h (\gamma + \beta |i|) &&&& \text{[L] 9}

with :math:`\sigma_w^2 = E[\mu\,\alpha(x)]` over a Beta distribution of mean ``s`` and variance ``p``
([L] 10-13).
``gamma`` and ``beta`` are variances per second; [L] tabulates them for h = 1 s.

The innovation ``y - s`` has variance ``p + sigma_w^2``, so the estimate moves by ``K nu`` with standard
deviation ``p / sqrt(p + sigma_w^2)``: what is learnt is what the estimate moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field

from bms.piecewise import PiecewiseLinear

Array = NDArray[np.float64]


class UncertaintyModel(BaseModel):
    """The three tuning parameters of [L] eqs 3 and 4.

    Raises
    ------
    pydantic.ValidationError
        When a parameter is negative or not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    gamma: float = Field(default=1e-6, ge=0.0, allow_inf_nan=False, description="drift variance, 1/s")
    beta: float = Field(
        default=3.9e-7, ge=0.0, allow_inf_nan=False, description="drift variance per ampere, 1/(A s)"
    )
    mu: float = Field(
        default=2e-3, ge=0.0, allow_inf_nan=False, description="measurement variance where alpha is 1"
    )

    def process_variance(self, current_A: ArrayLike, step_s: float) -> Array:
        """Variance of ``d`` over one step, [L] eq 3."""
        return np.asarray(step_s * (self.gamma + self.beta * np.abs(current_A)), dtype=np.float64)

    def measurement_variance(self, mean: ArrayLike, variance: ArrayLike, alpha: PiecewiseLinear) -> Array:
        """Give the expected variance of ``w`` under the Beta belief, [L] eq 10."""
        return self.mu * alpha.expectation(mean, variance)


def gain(variance: ArrayLike, measurement_variance: ArrayLike) -> Array:
    """Gain K of [L] eq 8; zero where both variances vanish (nothing to learn, nothing measured)."""
    p, total = np.asarray(variance, np.float64), np.add(variance, measurement_variance, dtype=np.float64)
    return np.divide(p, total, out=np.zeros_like(total), where=total > 0.0)


def posterior_variance(variance: ArrayLike, measurement_variance: ArrayLike) -> Array:
    """Variance after the measurement, before the drift: the first term of [L] eq 9."""
    return gain(variance, measurement_variance) * np.asarray(measurement_variance, np.float64)


def next_variance(variance: ArrayLike, measurement_variance: ArrayLike, process_variance: ArrayLike) -> Array:
    """Variance one step later, [L] eq 9."""
    return posterior_variance(variance, measurement_variance) + np.asarray(process_variance, np.float64)


def innovation_spread(variance: ArrayLike, measurement_variance: ArrayLike) -> Array:
    """Give the deviation ``p / sqrt(p + sigma_w^2)`` by which a measurement moves the estimate."""
    return np.sqrt(gain(variance, measurement_variance) * np.asarray(variance, np.float64))


def steady_variance(measurement_variance: ArrayLike, process_variance: ArrayLike) -> Array:
    """Solve [L] eq 9 for its fixed point at constant current: ``p^2 = sigma_d^2 (p + sigma_w^2)``."""
    drift = np.asarray(process_variance, np.float64)
    return 0.5 * drift + np.sqrt(0.25 * drift**2 + drift * np.asarray(measurement_variance, np.float64))
