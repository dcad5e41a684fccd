r"""From uncertain parameters of a diagram to the spread of the traffic that follows.

`propagate` runs the road for every member of a design and says, for every time and place that is kept: mean,
standard deviation, quantiles, Sobol indices, and how far the mean may be off. The design is a sample (see
`drivecycles.traffic.sampling`) or the nodes of a polynomial chaos, ``gpc``: a Gauss grid of order + 1 points
per germ, projected on the terms of the total order (`gpc.quadrature`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.distributions import Distribution
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.lwr import MemberFields, simulate_members
from drivecycles.traffic.road import Demand, Road
from drivecycles.traffic.sampling import SAMPLERS, Design, design, even_points
from drivecycles.traffic.summary import HIGHEST_FIT, of_chaos, of_sample
from drivecycles.traffic.uncertain import UncertainDiagram
from gpc import Collocation, Expansion, quadrature, total_order

Array = NDArray[np.float64]

METHODS = (*SAMPLERS, "gpc")
QUANTITIES = ("speed", "density")
QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False)
class Spread:
    """What is known of speed (m/s) or density (1/m) at r times in c cells, from M members.

    Attributes
    ----------
    method, quantity : str
        How, and of what.
    names : tuple of str
        Uncertain parameters, d of them.
    values : ndarray, shape (M, d)
        Their values in each member.
    outcome : ndarray, shape (r, c, M)
        The quantity in each member.
    time_s, position_m : ndarray, shapes (r,) and (c,)
        When and where.
    mean, sd, error : ndarray, shape (r, c)
        Mean and standard deviation, and the error of the mean.
    quantile_levels : tuple of float
        Levels, q of them.
    quantiles : ndarray, shape (q, r, c)
        Quantiles.
    first_order, total : ndarray or None, shape (d, r, c)
        Sobol indices; None where there are too few members, or parameters are correlated.
    explained : ndarray or None, shape (r, c)
        Part of the members' variance that the fitted chaos holds.
    congested : int
        Members whose capacity is below the largest demand.
    cut : float
        Largest probability that truncation took away from a distribution.
    expansion : Expansion or None
        The chaos itself, for ``gpc``; outputs of shape (r, c).
    """

    method: str
    quantity: str
    names: tuple[str, ...]
    values: Array
    outcome: Array
    time_s: Array
    position_m: Array
    mean: Array
    sd: Array
    error: Array
    quantile_levels: tuple[float, ...]
    quantiles: Array
    first_order: Array | None
    total: Array | None
    explained: Array | None
    congested: int
    cut: float
    expansion: Expansion | None = None

    @property
    def runs(self) -> int:
        """Number of model runs."""
        return int(self.values.shape[0])


def propagate(
    road: Road,
    diagram: Diagram,
    distributions: Mapping[str, Distribution],
    *,
    demand: float | Demand,
    duration_s: float,
    correlation: ArrayLike | None = None,
    initial: ArrayLike = 0.0,
    scheme: str = "godunov",
    step_s: float | None = None,
    method: str = "sobol",
    runs: int = 1024,
    order: int | None = None,
    seed: int | np.random.SeedSequence = 0,
    time_s: ArrayLike | None = None,
    position_m: ArrayLike | None = None,
    cells: ArrayLike | None = None,
    quantity: str = "speed",
    quantiles: Sequence[float] = QUANTILES,
) -> Spread:
    """Propagate uncertain parameters through the kinematic-wave model.

    Parameters
    ----------
    road, demand, duration_s, initial, scheme, step_s, time_s, position_m, cells
        As in `drivecycles.traffic.lwr.simulate_members`.
    diagram : Diagram
        How traffic drives where nothing is uncertain.
    distributions : mapping of str to Distribution
        By the name of a parameter of the diagram.
    correlation : array_like, shape (d, d), optional
        Correlation of the parameters' normal scores.
    method : str
        ``mc``, ``antithetic``, ``lhs``, ``sobol`` or ``gpc``.
    runs : int
        Most model runs; `Spread.runs` says how many there were.
    order : int, optional
        Order of the chaos, for ``gpc``; the highest up to 4 whose grid ``runs`` allow if absent.
    seed : int or SeedSequence
        Of the design.
    quantity : str
        ``speed`` or ``density``.
    quantiles : sequence of float
        Levels between 0 and 1.

    Returns
    -------
    Spread

    Raises
    ------
    TrafficError
        When something is unknown or out of range, a member cannot be run, or one blew up.
    """
    if quantity not in QUANTITIES:
        raise TrafficError(f"there is no quantity {quantity!r}; known are {', '.join(QUANTITIES)}")
    levels = tuple(float(level) for level in quantiles)
    if not all(0.0 < level < 1.0 for level in levels):
        raise TrafficError(f"quantiles lie between 0 and 1, got {levels}")
    uncertain = UncertainDiagram(diagram, distributions, correlation)
    generator = np.random.default_rng(seed)
    plan = _plan(uncertain, method, runs, order, generator)
    germs = plan.nodes if isinstance(plan, Collocation) else uncertain.germs(plan.share)
    values = uncertain.values(germs)
    members = uncertain.diagrams(values)
    fields = simulate_members(
        road, members, demand=demand, duration_s=duration_s, initial=initial, scheme=scheme, step_s=step_s,
        time_s=time_s, position_m=position_m, cells=cells,
    )  # fmt: skip
    outcome = _outcome(fields, quantity, scheme)
    if isinstance(plan, Collocation):
        said = of_chaos(plan, outcome, levels, uncertain.germs(even_points(len(uncertain.names), generator)))
    else:
        said = of_sample(uncertain.families, plan, germs, outcome, levels)
    # The germs of correlated parameters are not the parameters, and depend on their order.
    indices = (None, None) if uncertain.correlated else (said.first_order, said.total)
    peak = float(Demand.of(demand).flow_per_s.max())
    return Spread(
        method=method,
        quantity=quantity,
        names=uncertain.names,
        values=values,
        outcome=outcome,
        time_s=fields.time_s,
        position_m=fields.position_m,
        quantile_levels=levels,
        congested=sum(member.capacity_per_s < peak for member in members),
        cut=max(each.cut for each in distributions.values()),
        mean=said.mean,
        sd=said.sd,
        error=said.error,
        quantiles=said.quantiles,
        first_order=indices[0],
        total=indices[1],
        explained=said.explained,
        expansion=said.expansion,
    )


def _plan(
    uncertain: UncertainDiagram, method: str, runs: int, order: int | None, generator: np.random.Generator
) -> Design | Collocation:
    dimension = len(uncertain.names)
    if method != "gpc":
        if order is not None:
            raise TrafficError(f"only the method 'gpc' has an order, not {method!r}")
        return design(method, runs, dimension, generator)
    affordable = int(runs ** (1.0 / dimension) * (1.0 + 1e-12)) - 1 if runs > 0 else 0
    wanted = min(affordable, HIGHEST_FIT) if order is None else order
    if not 1 <= wanted <= affordable:
        raise TrafficError(
            f"a chaos of order p in {dimension} uncertain parameters takes (p + 1)^{dimension} runs, and p is"
            f" 1 or more; {runs} runs allow no order {wanted}"
        )
    return quadrature(uncertain.families, total_order(dimension, wanted))


def _outcome(fields: MemberFields, quantity: str, scheme: str) -> Array:
    outcome = fields.speed_mps if quantity == "speed" else fields.density_per_m
    lost = int(np.sum(~np.isfinite(outcome).all(axis=(0, 1))))
    if lost:
        raise TrafficError(
            f"{lost} of {outcome.shape[2]} members blew up under the scheme {scheme!r}: their capacity is"
            " below the demand; take 'godunov', or truncate the distributions nearer to their means"
        )
    return outcome
