"""A policy to compare: a name, and how to solve a problem for it; one of ours, or one of the user's own."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from ems.errors import EmsError
from ems.policies.base import Policy
from ems.problem import Problem

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class PolicyKind:
    """A policy of the user's own, wherever a comparison takes a policy's name.

    Parameters
    ----------
    name : str
        Its name in results: small letters, digits and underscores.
    build : callable
        Makes the policy for a problem, ``build(problem)``. A class whose constructor takes a problem will do.
        To be told the true SOC, as perfect information is, the policy carries ``acts_on = TRUTH``; a
        ``value_kg`` is taken for what it promises at the start.
    depends_on_mu : bool
        Whether it has to be made anew for every mu.

    Raises
    ------
    EmsError
        When the name is no name, or ``build`` cannot be called.
    """

    name: str
    build: Callable[[Problem], Policy]
    depends_on_mu: bool = True

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise EmsError(
                f"{self.name!r} is no name for a policy; take small letters, digits and underscores,"
                " like 'thermostat'"
            )
        if not callable(self.build):
            raise EmsError(
                f"the policy {self.name!r} cannot be built: {self.build!r} is no function or class that takes"
                " a problem"
            )
