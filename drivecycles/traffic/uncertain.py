"""A diagram some of whose parameters are uncertain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.distributions import Distribution
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.naming import suggest
from gpc import Family, Hermite

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class UncertainDiagram:
    """A diagram, and distributions of some of its parameters.

    Parameters
    ----------
    diagram : Diagram
        Its parameters hold where nothing is uncertain.
    distributions : mapping of str to Distribution
        By the name of a parameter, d of them.
    correlation : array_like, shape (d, d), optional
        Correlation of the normal germs, in the order of the distributions; independent if absent.

    Raises
    ------
    TrafficError
        When there is no distribution, a parameter is unknown, or the correlation is not one.
    """

    diagram: Diagram
    distributions: Mapping[str, Distribution]
    correlation: ArrayLike | None = None
    factor: Array | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        known = self.diagram.parameter_names()
        for name in self.distributions:
            if name not in known:
                raise TrafficError(
                    f"the {self.diagram.kind} diagram has no parameter {name!r}; it has {', '.join(known)}"
                    f"{suggest(name, known)}"
                )
        if not self.distributions:
            raise TrafficError(f"nothing is uncertain; give a distribution of one of {', '.join(known)}")
        object.__setattr__(self, "factor", self._factor())

    def _factor(self) -> Array | None:
        if self.correlation is None:
            return None
        matrix, size = np.asarray(self.correlation, dtype=np.float64), len(self.distributions)
        if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T) or not _is_one(np.diag(matrix)):
            raise TrafficError(
                f"a correlation of {size} parameters is a symmetric {size} x {size} matrix with ones on its"
                f" diagonal, got shape {matrix.shape}"
            )
        try:
            return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise TrafficError(
                "the correlation is not positive definite: the parameters contradict each other, or one"
                " follows from the others; bring correlations nearer to 0"
            ) from None

    @property
    def correlated(self) -> bool:
        """Whether a parameter depends on another one."""
        return self.factor is not None and bool(np.any(np.tril(self.factor, -1)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the uncertain parameters."""
        return tuple(self.distributions)

    @property
    def families(self) -> tuple[Family, ...]:
        """Polynomials of the germs, one per uncertain parameter; all normal where they are correlated."""
        if self.factor is not None:
            return tuple(Hermite() for _ in self.distributions)
        return tuple(each.family for each in self.distributions.values())

    def germs(self, share: ArrayLike) -> Array:
        """Turn variables uniform on (0, 1), shape (n, d), into germs."""
        shares = np.asarray(share, dtype=np.float64)
        if self.factor is not None:
            from scipy.special import ndtri

            return np.asarray(ndtri(shares), dtype=np.float64)
        columns = [each.germ_of_share(shares[:, k]) for k, each in enumerate(self.distributions.values())]
        return np.stack(columns, axis=-1)

    def values(self, germs: ArrayLike) -> Array:
        """Turn germs, shape (n, d), into values of the uncertain parameters, shape (n, d)."""
        points = np.asarray(germs, dtype=np.float64)
        if self.factor is not None:
            normal = points @ self.factor.T
            columns = [each.of_normal(normal[:, k]) for k, each in enumerate(self.distributions.values())]
        else:
            columns = [each.of_germ(points[:, k]) for k, each in enumerate(self.distributions.values())]
        return np.stack(columns, axis=-1)

    def diagrams(self, values: ArrayLike) -> list[Diagram]:
        """Make one diagram per row of values, shape (n, d).

        Raises
        ------
        TrafficError
            When a row does not make a diagram; says which.
        """
        known, made = self.diagram.parameters(), []
        rows = np.asarray(values, dtype=np.float64)
        for at, row in enumerate(rows):
            try:
                made.append(
                    type(self.diagram)(**(known | dict(zip(self.names, map(float, row), strict=True))))
                )
            except TrafficError as problem:
                raise TrafficError(f"member {at} of {len(rows)} cannot be: {problem}") from None
        return made


def _is_one(diagonal: Array) -> bool:
    return bool(np.allclose(diagonal, 1.0))
