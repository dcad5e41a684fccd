"""CVode (backward differentiation, dense Jacobian by differences) from the SUNDIALS that fmpy ships.

fmpy's own wrapper prints what goes wrong in a callback and goes on, frees a part of what it allocates, and
may step past the end of a communication step; this one ends on errors, frees everything, and stops where it
is told.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from bms.plants.fmu.errors import FmuError

BDF, ONE_STEP = 2, 2
ROOT = 2
"""What `Cvode.advance` answers at an event."""

_Double, _Pointer, _Int = ctypes.c_double, ctypes.c_void_p, ctypes.c_int
_Rhs = ctypes.CFUNCTYPE(_Int, _Double, _Pointer, _Pointer, _Pointer)
_Roots = _Rhs

SIGNATURES: dict[str, tuple[str, Any, tuple[Any, ...]]] = {
    "SUNContext_Create": ("core", _Int, (_Int, _Pointer)),
    "SUNContext_Free": ("core", _Int, (_Pointer,)),
    "SUNContext_ClearErrHandlers": ("core", _Int, (_Pointer,)),
    "SUNMatDestroy": ("core", None, (_Pointer,)),
    "SUNLinSolFree": ("core", _Int, (_Pointer,)),
    "N_VGetArrayPointer": ("core", _Pointer, (_Pointer,)),
    "N_VNew_Serial": ("nvecserial", _Pointer, (ctypes.c_int64, _Pointer)),
    "N_VDestroy_Serial": ("nvecserial", None, (_Pointer,)),
    "SUNDenseMatrix": ("sunmatrixdense", _Pointer, (ctypes.c_int64, ctypes.c_int64, _Pointer)),
    "SUNLinSol_Dense": ("sunlinsoldense", _Pointer, (_Pointer, _Pointer, _Pointer)),
    "CVodeCreate": ("cvode", _Pointer, (_Int, _Pointer)),
    "CVodeFree": ("cvode", None, (_Pointer,)),
    "CVodeInit": ("cvode", _Int, (_Pointer, _Rhs, _Double, _Pointer)),
    "CVodeReInit": ("cvode", _Int, (_Pointer, _Double, _Pointer)),
    "CVodeSVtolerances": ("cvode", _Int, (_Pointer, _Double, _Pointer)),
    "CVodeRootInit": ("cvode", _Int, (_Pointer, _Int, _Roots)),
    "CVodeSetNoInactiveRootWarn": ("cvode", _Int, (_Pointer,)),
    "CVodeSetLinearSolver": ("cvode", _Int, (_Pointer, _Pointer, _Pointer)),
    "CVodeSetStopTime": ("cvode", _Int, (_Pointer, _Double)),
    "CVode": ("cvode", _Int, (_Pointer, _Double, _Pointer, _Pointer, _Int)),
}
"""Library, result and arguments of the C functions that are used."""

Evaluate = Callable[[float, int, int], int]
"""Time, address of the states, address to fill; returns 0, or 1 to try a smaller step, or -1 to give up."""


class Cvode:
    """A solver for a fixed number of states and event indicators.

    Parameters
    ----------
    states, indicators : int
        At least one state; no indicators means no events.
    derivatives, crossings : callable
        See `Evaluate`.
    tolerance : float
        Relative; the absolute one is this times a state's nominal value.

    Raises
    ------
    FmuError
        When fmpy brings no solver for this platform.
    """

    def __init__(
        self, states: int, indicators: int, derivatives: Evaluate, crossings: Evaluate, tolerance: float
    ) -> None:
        self._c = _functions()
        c = self._c
        self._size, self._tolerance = states, tolerance
        self._context = _Pointer()
        c["SUNContext_Create"](0, ctypes.addressof(self._context))
        c["SUNContext_ClearErrHandlers"](self._context)
        self._x = c["N_VNew_Serial"](states, self._context)
        self._tolerances = c["N_VNew_Serial"](states, self._context)
        self.states = self._view(self._x)
        """The states, shared with the solver."""
        self.nominals = self._view(self._tolerances)
        """Nominal values, to be filled before `restart`, which makes tolerances of them."""
        self._raised: BaseException | None = None
        address = c["N_VGetArrayPointer"]

        def rhs(time: float, x: int, dx: int, _: int) -> int:
            try:
                return derivatives(time, address(x), address(dx))
            except BaseException as error:  # such as the user's Ctrl-C; it cannot pass through C
                self._raised = error
                return -1

        def roots(time: float, x: int, out: int, _: int) -> int:
            try:
                return crossings(time, address(x), out)
            except BaseException as error:
                self._raised = error
                return -1

        self._callbacks = _Rhs(rhs), _Roots(roots)
        self._memory = _Pointer(c["CVodeCreate"](BDF, self._context))
        c["CVodeInit"](self._memory, self._callbacks[0], 0.0, self._x)
        if indicators:
            c["CVodeRootInit"](self._memory, indicators, self._callbacks[1])
            c["CVodeSetNoInactiveRootWarn"](self._memory)
        self._matrix = c["SUNDenseMatrix"](states, states, self._context)
        self._linear = c["SUNLinSol_Dense"](self._x, self._matrix, self._context)
        self._reached = _Double(0.0)
        self._reached_at = ctypes.addressof(self._reached)
        self._scale_nominals(restart=False)
        c["CVodeSetLinearSolver"](self._memory, self._linear, self._matrix)

    def _view(self, vector: int) -> Any:
        data = self._c["N_VGetArrayPointer"](vector)
        return (_Double * self._size).from_address(data)

    def _scale_nominals(self, *, restart: bool) -> None:
        for at, nominal in enumerate(self.nominals):
            size = abs(nominal) if restart else 1.0
            # FMI's advice: states are often far below their nominal values, which are one by default
            self.nominals[at] = 0.01 * self._tolerance * (size if 0.0 < size < float("inf") else 1.0)
        self._c["CVodeSVtolerances"](self._memory, self._tolerance, self._tolerances)

    def restart(self, time: float) -> None:
        """Begin anew at a time, with ``states`` and ``nominals`` as they are."""
        self._scale_nominals(restart=True)
        self._c["CVodeReInit"](self._memory, time, self._x)

    def advance(self, until: float) -> tuple[int, float]:
        """Make one internal step, never past ``until``.

        Returns
        -------
        tuple of int and float
            Negative when the solver gave up, `ROOT` at an event, else 0 or 1; and the time it reached.
        """
        self._c["CVodeSetStopTime"](self._memory, until)
        flag = self._c["CVode"](self._memory, until, self._x, self._reached_at, ONE_STEP)
        if self._raised is not None:
            raised, self._raised = self._raised, None
            raise raised
        return flag, self._reached.value

    def close(self) -> None:
        """Free all of it; it may be called twice."""
        if not self._context:
            return
        c = self._c
        c["CVodeFree"](ctypes.addressof(self._memory))
        c["SUNLinSolFree"](self._linear)
        c["SUNMatDestroy"](self._matrix)
        for vector in (self._x, self._tolerances):
            c["N_VDestroy_Serial"](vector)
        c["SUNContext_Free"](ctypes.addressof(self._context))
        self._context = _Pointer()

    def __del__(self) -> None:
        if getattr(self, "_context", None):
            self.close()


def _functions() -> dict[str, Any]:
    try:
        from fmpy.sundials import libraries
    except Exception as error:
        raise FmuError(
            f"model exchange needs a solver, and fmpy brings none for this platform ({error}); use a"
            " co-simulation FMU here"
        ) from error
    found: dict[str, Any] = {}
    for name, (library, result, arguments) in SIGNATURES.items():
        function = getattr(libraries, f"sundials_{library}")[name]
        function.restype, function.argtypes = result, arguments
        found[name] = function
    return found
