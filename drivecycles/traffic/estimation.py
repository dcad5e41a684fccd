r"""Parameters of a fundamental diagram and the traffic between detectors, from their noisy speeds.

The state of the filter is :math:`x = (\theta, k_1 \ldots k_n)`: the unknown parameters of the diagram, such
as free-flow speed and jam density, and the density of every cell. A forecast runs Godunov's scheme from one
reading to the next; a reading is the equilibrium speed of a detector's cell,

.. math:: k(t + T) = \Phi_T\bigl(k(t), \theta\bigr), \qquad z_m = v(k_{c(m)}, \theta) + \nu,\;
          \nu \sim N(0, \sigma^2).

The parameters have germs, uniform about a first guess, and with them the densities that follow from them;
`gpc.ekf.GpcEkf` carries what no germ explains beside the chaos: what readings have taught, and a random walk
of the densities for a model that is not exact. The demand at the entrance, bottlenecks and initial densities
are known. What a reading teaches is shared by all cells through the covariance, so the state between
detectors comes with a standard deviation of its own.

Ranges of two parameters one of which must lie below the other, such as critical and jam density, may overlap.
A member in which they would cross is taken with the lower one drawn back, to half of the way from the guess's
ratio of both to 1.

The parameters are identifiable as far as traffic visits them: an empty road shows the free-flow speed alone,
and only where it is dense does the speed tell the jam density.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.advance import Advance
from drivecycles.traffic.detectors import Readings
from drivecycles.traffic.diagrams import Diagram
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.lwr import initial_density
from drivecycles.traffic.naming import suggest
from drivecycles.traffic.road import Demand, Road
from gpc import ChaosBelief, ChaosError, GpcEkf, Legendre, affine_coefficients, collocate, total_order
from gpc.ekf import Function

Array = NDArray[np.float64]

SPREAD = 0.35
"""Half of the range of a parameter, as a share of its first guess: a standard deviation of 20 %."""
WALK_PER_M = 5e-5
"""Standard deviation that a density gathers in one second: what schemes with other steps differ by."""
LEAST = 0.2
"""No parameter is believed below this share of its first guess."""


@dataclass(frozen=True, eq=False)
class TrafficEstimate:
    """What was believed after each reading.

    Attributes
    ----------
    names : tuple of str
        Unknown parameters, p of them, as the diagram calls them.
    time_s : ndarray, shape (n,)
        Times of the readings.
    mean, sd : ndarray, shape (n, p)
        Parameters and their standard deviations, in SI units.
    covariance : ndarray, shape (p, p)
        Of the parameters, at the end.
    position_m : ndarray, shape (cells,)
        Middles of the cells.
    density_per_m, density_sd_per_m, speed_mps, speed_sd_mps : ndarray, shape (n, cells)
        The state on the whole road, and its standard deviation.
    nis : ndarray, shape (n,)
        Normalised innovation squared; NaN where nothing was read.
    read : ndarray of int, shape (n,)
        Readings that were used each time: the degrees of freedom of the above.
    """

    names: tuple[str, ...]
    time_s: Array
    mean: Array
    sd: Array
    covariance: Array
    position_m: Array
    density_per_m: Array
    density_sd_per_m: Array
    speed_mps: Array
    speed_sd_mps: Array
    nis: Array
    read: NDArray[np.int64]


def estimate(
    readings: Readings,
    road: Road,
    guess: Diagram,
    *,
    demand: float | Demand,
    unknown: Sequence[str] | None = None,
    spread: float = SPREAD,
    initial: ArrayLike = 0.0,
    order: int = 2,
    walk_per_m: float = WALK_PER_M,
) -> TrafficEstimate:
    """Estimate parameters and state from readings, one after the other.

    Parameters
    ----------
    readings : Readings
        What detectors read, at multiples of the first time between two of them.
    road : Road
        With its cells and bottlenecks.
    guess : Diagram
        First guess: kind, and where the parameters start.
    demand : float or Demand
        Flow that wanted to enter, in vehicles per second.
    unknown : sequence of str, optional
        Parameters to estimate; default all.
    spread : float
        Half of the range of each about its guess, as a share of it.
    initial : array_like, scalar or shape (cells,)
        Density at time 0.
    order : int
        Of the expansions.
    walk_per_m : float
        Standard deviation that every density gathers in one second, for a model that is not exact. With 0 the
        filter trusts its scheme to the last digit, and grows over-confident on any other road.

    Raises
    ------
    TrafficError
        When a detector stands outside the road, a name is unknown, a number out of range, or readings do not
        come at multiples of one period.
    """
    problem = _Problem(readings, road, guess, _names(guess, unknown), demand, spread, walk_per_m)
    gpc, belief = problem.start(initial_density(road, initial, guess.full_per_m), order)
    trace, at = _Trace(), 0
    try:
        for row, ticks in zip(readings.speed_mps, problem.ticks(), strict=True):
            belief = problem.forecast(gpc, belief, at, ticks - at)
            at = ticks
            seen = np.flatnonzero(np.isfinite(row))
            nis = np.nan
            if seen.size:
                noise = readings.detectors.noise_mps**2
                belief, innovation = gpc.update(belief, row[seen], noise, problem.measure(seen))
                nis = innovation.nis
            trace.add(problem, gpc, belief, nis, seen.size)
    except (ChaosError, np.linalg.LinAlgError) as error:
        raise TrafficError(
            f"the estimate came apart at {at * problem.advance.step_s:g} s: the readings contradict the road,"
            " its demand or the first guess too much; check them, or give the detectors more noise"
        ) from error
    return trace.finish(problem, belief)


def _names(guess: Diagram, unknown: Sequence[str] | None) -> tuple[str, ...]:
    known = guess.parameter_names()
    names = known if unknown is None else tuple(unknown)
    for name in names:
        if name not in known:
            raise TrafficError(
                f"the {guess.kind} diagram has no parameter {name!r}; it has {', '.join(known)}"
                f"{suggest(name, known)}"
            )
    if not names or len(set(names)) < len(names):
        raise TrafficError(f"name one or more of {', '.join(known)} to estimate, each once")
    return names


class _Problem:
    """The traffic model as the filter sees it: rows of (parameters, densities)."""

    def __init__(
        self,
        readings: Readings,
        road: Road,
        guess: Diagram,
        names: tuple[str, ...],
        demand: float | Demand,
        spread: float,
        walk_per_m: float,
    ) -> None:
        if not 0.0 < spread <= 0.6:
            raise TrafficError(f"the spread is a share of the guess above 0 and up to 0.6, got {spread!r}")
        if not 0.0 <= walk_per_m < np.inf:
            raise TrafficError(f"the walk of the densities must be 0 or more, got {walk_per_m!r}")
        self.readings, self.road, self.names = readings, road, names
        self.kind, self.known = type(guess), guess.parameters()
        self.cells, self.walk, self.spread = readings.detectors.cells(road), walk_per_m, spread
        self.centre = np.array([self.known[name] for name in names])
        self.most_ratio = self._most_ratio(guess)
        fastest = max(d.fastest_wave_mps for d in self._corners())
        self.period_s = self._period()
        self.advance = Advance.fit(road, demand, self.period_s, fastest)

    def _period(self) -> float:
        times = self.readings.time_s
        period_s = float(np.diff(times).min()) if times.size > 1 else float(times[0])
        ratio = times / period_s
        if not period_s > 0.0 or np.any(np.abs(ratio - np.rint(ratio)) > 1e-6 * np.maximum(ratio, 1.0)):
            raise TrafficError(
                f"readings must come at multiples of one period, {period_s:g} s here, from the start of the"
                " traffic on; resample them"
            )
        return period_s

    def _corners(self) -> list[Diagram]:
        """Give the diagrams at the ends of the ranges."""
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * len(self.names), indexing="ij"), axis=-1)
        return self.diagrams(self.centre * (1.0 + self.spread * signs.reshape(-1, len(self.names))))

    def ticks(self) -> list[int]:
        """Give the number of steps of the scheme up to each reading."""
        return [round(float(time) / self.advance.step_s) for time in self.readings.time_s]

    def start(self, initial: Array, order: int) -> tuple[GpcEkf, ChaosBelief]:
        """Set up the filter and what it starts from."""
        p, n = len(self.names), self.road.cells
        families, indices = (Legendre(),) * p, total_order(p, order)
        lower = np.concatenate([LEAST * self.centre, np.zeros(n)])
        gpc = GpcEkf(collocate(families, indices), lower=lower)
        middle = np.concatenate([self.centre, initial])
        half = np.concatenate([self.spread * self.centre, np.zeros(n)])
        return gpc, gpc.start(affine_coefficients(families, indices, middle, half, [*range(p), *([0] * n)]))

    def _most_ratio(self, guess: Diagram) -> float:
        """Give the largest ratio of the ordered parameters: half of the way from the guess's to 1."""
        if guess.ordered is None:
            return 1.0
        low, high = (self.known[name] for name in guess.ordered)
        return 0.5 * (1.0 + low / high)

    def diagrams(self, parameters: Array) -> list[Diagram]:
        """Make the diagram of each row of parameters, the nearest one where there is none."""
        rows = [dict(zip(self.names, row, strict=True)) for row in parameters.tolist()]
        return [self.kind(**self._admissible({**self.known, **row})) for row in rows]

    def _admissible(self, values: dict[str, float]) -> dict[str, float]:
        """Draw back one of two ordered parameters, such as critical and jam density, where they cross."""
        if self.kind.ordered is not None:
            low, high = self.kind.ordered
            # The backward wave of a triangular diagram grows without a bound as both approach each other.
            if values[low] > self.most_ratio * values[high]:
                if low in self.names:
                    values[low] = self.most_ratio * values[high]
                else:
                    values[high] = values[low] / self.most_ratio
        return values

    def forecast(self, gpc: GpcEkf, belief: ChaosBelief, start: int, steps: int) -> ChaosBelief:
        """Run the scheme for all rows."""
        if steps == 0:
            return belief
        p = len(self.names)

        def model(states: Array) -> Array:
            density = self.advance(states[:, p:].T, self.diagrams(states[:, :p]), start, steps)
            return np.concatenate([states[:, :p], density.T], axis=1)

        if self.walk == 0.0:
            return gpc.forecast(belief, model)
        variance = np.zeros(belief.mean.size)
        variance[p:] = self.walk**2 * steps * self.advance.step_s
        return gpc.forecast(belief, model, variance)

    def speeds(self, states: Array, cells: NDArray[np.int64]) -> Array:
        """Evaluate the speed of some cells for all rows."""
        p = len(self.names)
        rows = zip(states[:, p + cells], self.diagrams(states[:, :p]), strict=True)
        return np.stack([d.speed_mps(np.clip(density, 0.0, d.full_per_m)) for density, d in rows])

    def measure(self, seen: NDArray[np.int64]) -> Function:
        """Give the speeds that detectors would read."""
        return lambda states: self.speeds(states, self.cells[seen])

    def road_speed(self, gpc: GpcEkf, belief: ChaosBelief) -> tuple[Array, Array]:
        """Mean and standard deviation of the speed of every cell."""
        p, n = len(self.names), self.road.cells
        every = np.arange(n)
        lower = np.asarray(gpc.lower)
        nodes = np.maximum(gpc.collocation.at_nodes(belief.coefficients), lower)
        found = gpc.collocation.project(self.speeds(nodes, every))
        mean, step = np.maximum(belief.mean, lower), 1e-4
        shift = np.concatenate([np.diag(step * self.centre), np.zeros((p, n))], axis=1)
        together = np.concatenate([np.zeros(p), np.full(n, step * 0.1)])
        points = np.concatenate([mean + shift, mean - shift, [mean + together, mean - together]])
        values = self.speeds(points, every)
        by_parameter = (values[:p] - values[p : 2 * p]) / (2.0 * step * self.centre[:, np.newaxis])
        gap = np.maximum(points[-2, p:], 0.0) - np.maximum(points[-1, p:], 0.0)
        by_density = (values[-2] - values[-1]) / gap
        rest = belief.remainder
        variance = np.einsum("ic,ij,jc->c", by_parameter, rest[:p, :p], by_parameter)
        variance += by_density**2 * np.diagonal(rest)[p:]
        variance += 2.0 * by_density * np.einsum("ic,ic->c", by_parameter, rest[:p, p:])
        variance += np.sum(found[1:] ** 2, axis=0)
        return found[0], np.sqrt(np.maximum(variance, 0.0))


class _Trace:
    """Beliefs after each reading, as they come."""

    def __init__(self) -> None:
        self.rows: list[tuple[Array, Array, Array, Array, float, int]] = []

    def add(self, problem: _Problem, gpc: GpcEkf, belief: ChaosBelief, nis: float, read: int) -> None:
        sd = np.sqrt(np.maximum(np.diagonal(belief.covariance), 0.0))
        self.rows.append((belief.mean.copy(), sd, *problem.road_speed(gpc, belief), nis, read))

    def finish(self, problem: _Problem, belief: ChaosBelief) -> TrafficEstimate:
        p = len(problem.names)
        mean, sd, speed, speed_sd, nis, read = (np.array(column) for column in zip(*self.rows, strict=True))
        return TrafficEstimate(
            names=problem.names,
            time_s=np.asarray(problem.readings.time_s),
            mean=mean[:, :p],
            sd=sd[:, :p],
            covariance=belief.covariance[:p, :p],
            position_m=problem.road.position_m,
            density_per_m=mean[:, p:],
            density_sd_per_m=sd[:, p:],
            speed_mps=speed,
            speed_sd_mps=speed_sd,
            nis=nis,
            read=read.astype(np.int64),
        )
