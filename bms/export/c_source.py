r"""An estimator as C99 source.

The compiled kernel that an estimator runs in Python is translated (`bms.export.translate`) for the cell,
the settings and the shapes of this one estimator, one sample at a time. What the kernel keeps in its memory
is the state of the block. The state it has now is the start: a fresh estimator is exported as such, one that
has learnt with what it learnt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms._ecm import ocv_at
from bms.estimators import _gate
from bms.estimators.base import LEADING, KernelEstimator
from bms.estimators.coulomb import Coulomb
from bms.estimators.gpc_ekf import GpcEkf
from bms.estimators.gpc_gradient import GpcGaussNewton, GpcGradient
from bms.estimators.joint import JointEstimator
from bms.export import restart
from bms.export.block import CSource, Port, checked_name
from bms.export.program import Function, Program
from bms.export.templates import Layout, header_of, source_of
from bms.export.translate import translate
from bms.export.values import Record, Thing, Value, View, array, literal, variable

Array = NDArray[np.float64]

NOT_MEASURED_C = -300.0
"""A temperature below absolute zero stands for none, where NaN cannot be given."""

_UNITS = {"_A": "A", "_Ah": "Ah", "_ohm": "ohm", "_F": "F"}
_SAMPLE = ("current_A", "voltage_V", "step_s", "temperature_C")


@dataclass(frozen=True, slots=True)
class _Parts:
    """The translated functions, and what is kept beside the memory."""

    program: Program
    update: Function
    start: Function
    beside: dict[str, Array]


def export_c(estimator: KernelEstimator, name: str) -> CSource:
    """Write an estimator as C99 source.

    Parameters
    ----------
    estimator : KernelEstimator
        Any of `bms.estimators.catalogue`; it is exported as it stands.
    name : str
        Prefix of all that the block declares, a C identifier.

    Returns
    -------
    CSource
        Header and source: ``NAME_init``, ``NAME_start``, ``NAME_update``, ``NAME_read`` on a ``NAME_state``.

    Raises
    ------
    BatteryError
        When the name is no C identifier.
    """
    checked_name(name)
    parts = _translated(estimator)
    memory, row = estimator._memory, estimator._row
    soc, soc_sd = float(row[0]), math.sqrt(float(row[1]))
    outputs, parameters = _outputs(estimator), _parameters(soc, soc_sd)
    layout = Layout(
        name=name,
        title=f"{estimator.name} estimator of the SOC, cell {estimator.cell.name}",
        looks_back=estimator._gate.looks_back,
        arrays={"memory": memory, "row": row, **parts.beside},
        outputs=outputs,
        soc=soc,
        soc_sd=soc_sd,
        pending=_gate.PENDING,
        update=_call(parts.update),
        start=_call(parts.start),
    )
    return CSource(
        name=name,
        header=header_of(layout),
        source=source_of(layout, parts.program.text(parts.update, parts.start)),
        state_bytes=8 * sum(values.size for values in layout.arrays.values()),
        description=layout.title,
        inputs=_inputs(estimator, soc),
        outputs=outputs,
        parameters=parameters,
        start_call=f"{name}_start(&w->state, w->soc_start, w->soc_sd_start)",
        update_call=(
            f"{name}_update(&w->state, w->current_A, w->voltage_V, w->step_s, w->temperature_C, &w->out)"
        ),
        read_call=f"{name}_read(&w->state, &w->out)",
    )


def _translated(estimator: KernelEstimator) -> _Parts:
    program = Program()
    memory, row = array("memory", (estimator._memory.size,)), array("row", (estimator._row.size,))
    settings: Value = Thing(estimator._settings, "settings")
    beside: dict[str, Array] = {}
    if isinstance(estimator, GpcGradient | GpcGaussNewton):
        beside = {"start": estimator._settings.start, "prior_sd": estimator._settings.prior_sd}
        settings = _with_arrays(program, estimator._settings, beside)
    arguments: list[Value] = [
        Thing(estimator._circuit, "circuit"),
        Thing(estimator._gate, "gate"),
        settings,
        memory,
        *(_one(each) for each in _SAMPLE),
        literal(1),
        array("rows", (0, estimator._row.size)),
        row,
    ]
    update = translate(program, type(estimator).kernel, arguments)
    given: list[Value] = [memory, row, variable("double", "soc"), variable("double", "variance")]
    if isinstance(estimator, Coulomb):
        start = translate(program, restart.start_coulomb, given)
    elif isinstance(estimator, GpcEkf):
        start = translate(program, restart.start_chaos, [settings, *given])
    elif isinstance(estimator, JointEstimator):
        joint = Thing(estimator._joint, "settings")
        start = translate(program, restart.start_joint, [joint, *given])
    else:
        fresh = _fresh(estimator)
        described = program.array_of("described", fresh._row)
        around = literal(float(fresh._memory[_gate.TEMPERATURE_C]))
        own: list[Value] = [array(each, values.shape) for each, values in beside.items()]
        start = translate(program, restart.start_recursive, [*own, described, around, *given])
    return _Parts(program, update, start, beside)


def _fresh(estimator: KernelEstimator) -> KernelEstimator:
    """A copy of a recursive estimator that reports what it did before any sample."""
    copy = estimator.copy()
    copy._memory[_gate.TEMPERATURE_C] = copy.cell.reference_temperature_C
    copy._row[2:LEADING] = math.nan, 0.0
    if isinstance(copy, GpcGradient | GpcGaussNewton):
        copy._describe(copy._settings)
    return copy


def _one(name: str) -> View:
    """One sample, where the kernel takes an array of them."""
    return View(name, literal(0), (1,), (1,), "double", element=variable("double", name))


def _with_arrays(program: Program, settings: Any, own: dict[str, Array]) -> Record:
    """Settings of which some arrays are not constant but stand in the state."""
    items: list[Value] = []
    for member in settings._fields:
        if member in own:
            items.append(array(member, own[member].shape))
        else:
            note = program.note(type(settings), member)
            items.append(program.thing(getattr(settings, member), f"settings_{member}", note))
    return Record(tuple(items), settings._fields, type(settings).__name__)


def _call(function: Function) -> str:
    """The call of a translated function, its arrays in the state ``s``."""
    names = [each.name for each in function.parameters if each.used]
    given = [f"s->{name}" if name in ("memory", "row", "start", "prior_sd") else name for name in names]
    return f"{function.name}({', '.join(given)})"


def _inputs(estimator: KernelEstimator, soc: float) -> tuple[Port, ...]:
    circuit = estimator._circuit
    flows = "since the sample before" if estimator._gate.looks_back else "from this sample to the next one"
    return (
        Port("current_A", "A", f"current, > 0 charges; it flows {flows}; NaN: missing", "current_A", 0.0),
        Port(
            "voltage_V",
            "V",
            "terminal voltage with that current flowing; NaN: missing",
            "voltage_V",
            float(ocv_at(circuit.guide, circuit.knot, circuit.cubic, soc)),
        ),
        Port(
            "temperature_C",
            "degC",
            "temperature of the cell; NaN or below absolute zero: not measured",
            "temperature_C",
            NOT_MEASURED_C,
        ),
    )


def _outputs(estimator: KernelEstimator) -> tuple[Port, ...]:
    row = estimator._row
    ports = [
        Port("soc", "1", "state of charge", "soc", float(row[0])),
        Port("soc_variance", "1", "variance of its error", "soc_variance", float(row[1])),
        Port(
            "residual_V",
            "V",
            "measured minus expected voltage; NaN where it was not usable",
            "residual_V",
            float(row[2]),
        ),
        Port("flags", "1", "what is to be said of the sample, a sum of bits", "flags", row[3], "integer"),
    ]
    count = len(estimator._names)
    for i, each in enumerate(estimator._names):
        unit = next(unit for end, unit in _UNITS.items() if each.endswith(end))
        said = each.removesuffix(f"_{unit}").replace("_", " ")
        ports.append(Port(each, unit, said, each, float(row[LEADING + i])))
        sd = float(row[LEADING + count + i])
        ports.append(Port(f"{each}_sd", unit, f"standard deviation of the {said}", f"{each}_sd", sd))
    return tuple(ports)


def _parameters(soc: float, soc_sd: float) -> tuple[Port, ...]:
    return (
        Port("soc_start", "1", "SOC believed at the start", "soc_start", soc),
        Port("soc_sd_start", "1", "standard deviation of its error", "soc_sd_start", soc_sd),
    )
