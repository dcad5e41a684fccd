"""The error of everything a user can get wrong about an energy-management problem."""

from __future__ import annotations


class EmsError(ValueError):
    """Bad input to a problem, a policy or a comparison: says what was given, what is allowed, what to do."""


class GridWarning(UserWarning):
    """A rollout left the grid that its policy was solved on, so the policy extrapolated."""
