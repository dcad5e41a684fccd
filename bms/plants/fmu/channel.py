"""The narrow way into a running FMU: start values in, one number in and a few out at every step.

Everything here is in the FMU's own units and signs; `bms.plants.fmu.plant` knows what they mean. What is on
the other side, a library in this process or one in a child's, does not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

Kind = Literal["co-simulation", "model-exchange"]


@dataclass(frozen=True, slots=True)
class Wiring:
    """What a channel is connected to, by the names of the FMU's variables.

    Parameters
    ----------
    kind : {"co-simulation", "model-exchange"}
        Which of the FMU's interfaces is used.
    input : str
        The variable that is set before every step.
    outputs : tuple of str
        The variables that are read after every step.
    starts : tuple of str
        Parameters and start values that are set at the start of every realization, see `Channel.start`.
    inputs : tuple of (str, float)
        Other inputs, constant.
    parameters : tuple of (str, float)
        Parameters and start values that are the same for every realization.
    step_s : float
        Communication step; a longer step is made of several.
    tolerance : float
        Relative tolerance of the solver (model exchange), or what a co-simulation FMU is told.
    """

    kind: Kind
    input: str
    outputs: tuple[str, ...]
    starts: tuple[str, ...] = ()
    inputs: tuple[tuple[str, float], ...] = ()
    parameters: tuple[tuple[str, float], ...] = ()
    step_s: float = 1.0
    tolerance: float = 1e-8


class Channel(Protocol):
    """A running FMU, one realization after the other."""

    def start(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Begin a realization at time zero.

        Parameters
        ----------
        values : tuple of float
            Start values, in the order of `Wiring.starts`.

        Returns
        -------
        tuple of float
            The outputs after initialisation; an FMU may give zeros here.

        Raises
        ------
        FmuCrash
            When the FMU does not survive it.
        """

    def step(self, value: float, steps: int) -> tuple[float, ...]:
        """Hold the input over a number of communication steps.

        Parameters
        ----------
        value : float
            The input.
        steps : int
            Communication steps, at least one.

        Returns
        -------
        tuple of float
            The outputs at the end.

        Raises
        ------
        FmuCrash
            When the FMU refuses, crashes, hangs, or answers NaN.
        """

    def close(self) -> None:
        """Free what the channel holds; it may be called twice."""
