"""A policy as a block of C99: ``NAME.h`` and ``NAME.c``, its tables beside them.

``NAME_decide`` is the policy itself, a pure function of step, SOC, variance and engine state.
``NAME_update`` adds the sample and hold: it finds the step from the time, remembers the engine state, and
decides once per step. The tables are a constant structure that the caller hands in, from a file
(``NAME.bin``) or linked (``NAME_data.c``).

The C is written by hand after `ems._choose` and `ems._rules`, operation by operation; sizes and scalars are
constants of the compiler.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bms.export.block import CSource, Port, checked_name
from bms.export.fmu_description import Timing
from ems._choose import CERTAIN, ESTIMATE, POINT, TRUTH
from ems._rules import AVOID_SHORTFALL_W_PER_KG, KEEP_RUNNING, Rules
from ems.errors import EmsError
from ems.export.layout import Layout, Member
from ems.export.tables import LookAhead, PolicyTables, tables_of
from ems.policies import AnyPolicy

TEMPLATES = Path(__file__).parent / "c"
TOLERANCE = 1e-6

REFUSALS = (
    "the SOC must be in 0 to 1 and its variance zero or positive",
    "there is no such step: the trip that the policy was computed for begins at time 0 and ends earlier",
    "the step is longer than the policy's, or goes across the begin of the next",
    "these are not the tables of this policy",
)
"""What the codes 1, 2, ... of the C functions mean."""

_CODES = ("OK", "BAD_INPUT", "BEYOND_TRIP", "LONG_STEP", "WRONG_TABLE")
_ACTS_ON = {
    ESTIMATE: "an estimate of the SOC and its variance",
    CERTAIN: "an estimate of the SOC",
    TRUTH: "the true SOC",
}


@dataclass(frozen=True, eq=False)
class PolicySource:
    """A policy as C.

    Parameters
    ----------
    block : CSource
        The source; ``block.data`` holds the tables.
    layout : Layout
        The tables.
    timing : Timing
        How it is to be stepped.
    """

    block: CSource
    layout: Layout
    timing: Timing

    def data_source(self) -> Iterator[str]:
        """Write ``NAME_data.c``, the tables as a constant, in pieces."""
        return self.layout.initialiser(self.block.name)


def export_policy(policy: AnyPolicy | PolicyTables, name: str = "ems") -> PolicySource:
    """Write a policy as C.

    Parameters
    ----------
    policy : CostToGoPolicy, RuleBasedPolicy or PolicyTables
        The policy, or its tables.
    name : str
        Prefix of everything that the C declares.

    Raises
    ------
    BatteryError
        When the name is not one in C.
    EmsError
        When the grid is too coarse for the look-ups: below four nodes or, with a variance, three rows.
    """
    checked_name(name)
    tables = policy if isinstance(policy, PolicyTables) else tables_of(policy)
    if isinstance(tables.basis, Rules):
        constants, members = _rules(tables, tables.basis)
        template, acts_on = "rules.c", _ACTS_ON[CERTAIN]
    else:
        constants, members = _look_ahead(tables, tables.basis)
        template, acts_on = "cost_to_go.c", _ACTS_ON[tables.basis.acts_on]
    layout = Layout(tuple(members))
    description = (
        f"{tables.policy} energy management of {tables.concept} on {tables.cycle}, acts on {acts_on}"
    )
    description = "".join(c if c.isascii() and c.isprintable() else "?" for c in description)
    image = layout.image()
    header = _header(name, description, tables, constants, layout)
    source = _source(name, description, template, len(image))
    variance = isinstance(tables.basis, LookAhead) and tables.basis.acts_on == ESTIMATE
    block = CSource(
        name=name,
        header=header,
        source=source,
        state_bytes=48,
        description=description,
        inputs=_inputs(acts_on, variance),
        outputs=_OUTPUTS,
        parameters=(
            Port(
                "engine_on_start",
                "1",
                "whether the engine runs in the first step",
                "engine_on_start",
                0.0,
                "boolean",
            ),
        ),
        start_call=f"{name}_start(&w->state, w->data, w->engine_on_start != 0.0)",
        update_call=(
            f"{name}_update(&w->state, w->data, w->time_s, w->step_s, w->soc, w->soc_variance, &w->out)"
        ),
        read_call=f"{name}_read(&w->state, &w->out)",
        data=image,
    )
    return PolicySource(block, layout, Timing(tables.step_s, fixed=True, stop_s=tables.steps * tables.step_s))


_OUTPUTS = (
    Port("control", "1", "number of the control, 0 is engine off, 1 idling", "control", 0.0, "integer"),
    Port("engine_torque_Nm", "N.m", "engine torque at the crank", "engine_torque_Nm", 0.0),
    Port(
        "battery_power_W", "W", "power asked of the battery's terminals, > 0 charges", "battery_power_W", 0.0
    ),
    Port("fuel_kgps", "kg/s", "fuel rate that this control takes", "fuel_kgps", 0.0),
    Port("engine_on", "1", "whether the engine runs in this step", "engine_on", 0.0, "boolean"),
    Port("engine_next", "1", "whether it is to run in the next", "engine_next", 0.0, "boolean"),
)


def _inputs(acts_on: str, variance: bool) -> tuple[Port, ...]:
    unused = "" if variance else "; this policy does not use it"
    return (
        Port(
            "soc", "1", f"state of charge at the begin of the step, the policy acts on {acts_on}", "soc", 0.5
        ),
        Port("soc_variance", "1", f"variance of the error of the SOC{unused}", "soc_variance", 0.0),
    )


def _choices(tables: PolicyTables, keep_all: bool) -> list[Member]:
    """Controls of every step in one row, without those that repeat the one before."""
    stages = tables.stages
    power_W, cost_kg = stages.power_W, stages.cost_kg
    kept = np.ones(power_W.shape, dtype=np.bool_)
    if not keep_all:
        same = (power_W[:, 2:] == power_W[:, 1:-1]) & (cost_kg[:, 2:] == cost_kg[:, 1:-1])
        kept[:, 2:] = ~same
    first = np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(np.int32)
    control = np.broadcast_to(np.arange(power_W.shape[1], dtype=np.int32), power_W.shape)[kept]
    return [
        Member("power_W", power_W[kept], "battery power of each choice, > 0 charges"),
        Member("cost_kg", cost_kg[kept], "fuel and price of missing power"),
        Member("torque_Nm", stages.engine_torque_Nm[kept], "engine torque"),
        Member("fuel_kgps", stages.fuel_kgps[kept], "fuel rate"),
        Member("first_choice", first, "of step k; the engine is off in the first, on in the others"),
        Member("control", control, "number of the control of each choice"),
    ]


def _look_ahead(tables: PolicyTables, basis: LookAhead) -> tuple[dict[str, str], list[Member]]:
    nodes, rows = basis.soc.size, basis.level.size
    if nodes < 4 or rows == 2:
        raise EmsError(f"a grid of {nodes} nodes and {rows} rows is too coarse to be exported; refine it")
    scalars = basis.scalars
    constants = {
        "ESTIMATE": str(ESTIMATE),
        "CERTAIN": str(CERTAIN),
        "TRUTH": str(TRUTH),
        "ACTS_ON": str(basis.acts_on),
        "CUBIC": str(int(basis.cubic)),
        "NODES": str(nodes),
        "ROWS": str(rows),
        "SOC_FIRST": _number(basis.soc[0]),
        "SOC_STEP": _number(basis.soc_step),
        "CHARGE_TO_SOC": _number(scalars.charge_to_soc),
        "DRIFT": _number(scalars.drift),
        "DRIFT_PER_A": _number(scalars.drift_per_A),
        "START_KG": _number(scalars.start_cost_kg),
        "SHORTFALL_KG_PER_J": _number(scalars.shortfall_kg_per_J),
        "ROOT_3": _number(POINT),
        "MINUS_ROOT_3": f"({_number(-POINT)})",
    }
    members = [
        Member("ocv_V", basis.ocv_V, "open-circuit voltage"),
        Member("discharge_ohm", basis.discharge_ohm, "resistance, discharge"),
        Member("charge_ohm", basis.charge_ohm, "resistance, charge"),
        Member("least_current_A", basis.current_low_A, "strongest discharge, negative"),
        Member("greatest_current_A", basis.current_high_A, "strongest charge"),
    ]
    if rows > 1:
        constants["LEVEL_STEP"] = _number(np.sqrt(basis.level[-1]) / (rows - 1))
        members.append(Member("variance", basis.level, "of the rows, uniform in their root"))
    if basis.known is not None:
        known = basis.known
        constants |= {
            "FILTER_LEVELS": str(known.level.size),
            "FILTER_NODES": str(known.measured.shape[1]),
            "FILTER_LEVEL_STEP": _number(known.level_step),
        }
        members += [
            Member("filter_variance", known.level, "levels, uniform in their root"),
            Member("filter_measured", known.measured, "variance expected of a measurement, SOC from 0 to 1"),
        ]
    after = basis.cost_to_go_kg
    members += _choices(tables, keep_all=False)
    members.append(Member("cost_to_go_kg", after, "after step k, engine off and on, variance, SOC"))
    return constants, members


def _rules(tables: PolicyTables, rules: Rules) -> tuple[dict[str, str], list[Member]]:
    shortfall_kg = tables.stages.shortfall_kg
    if shortfall_kg is None:
        raise EmsError("the rules need the price of missing power; give StageTables.shortfall_kg")
    constants = {
        "SUSTAIN_SOC": _number(rules.sustain_soc),
        "BAND": _number(rules.band),
        "START_POWER_W": _number(rules.start_power_W),
        "DEPLETE_POWER_W": _number(rules.deplete_power_W),
        "CHARGE_POWER_W": _number(rules.charge_power_W),
        "KEEP_RUNNING": _number(KEEP_RUNNING),
        "AVOID_SHORTFALL_W_PER_KG": _number(AVOID_SHORTFALL_W_PER_KG),
    }
    members = [
        Member("wheel_power_W", rules.wheel_power_W, "power at the wheels in each step"),
        Member("needs_engine", rules.needs_engine.astype(np.int32), "whether the motor alone cannot follow"),
        Member("shortfall_kg", shortfall_kg.ravel(), "price of missing power of each choice"),
        *_choices(tables, keep_all=True),
    ]
    return constants, members


def _header(
    name: str, description: str, tables: PolicyTables, constants: dict[str, str], layout: Layout
) -> str:
    every = {"STEPS": str(tables.steps), "STEP_S": _number(tables.step_s), **constants}
    every |= {"TOLERANCE": _number(TOLERANCE), "CHECK": f"UINT64_C({layout.check:#018x})"}
    defines = "".join(f"#define NAME_{key} {value}\n" for key, value in every.items())
    codes = ", ".join(f"NAME_{code} = {place}" for place, code in enumerate(_CODES))
    text = (TEMPLATES / "policy.h").read_text(encoding="ascii")
    for mark, value in (
        ("DESCRIPTION", description.replace("*/", "* /")),
        ("CODES", codes),
        ("CONSTANTS\n", defines),
        ("TABLE\n", layout.declaration("NAME")),
    ):
        text = text.replace(f"@{mark}", value)
    return _named(text, name)


def _source(name: str, description: str, template: str, image_bytes: int) -> str:
    parts = [
        f"/* {description.replace('*/', '* /')}, see NAME.h. */\n",
        '#include "NAME.h"\n\n#include <math.h>\n#include <stddef.h>\n\n',
        "/* The tables in memory are what they are in NAME.bin: no padding. */\n",
        f"typedef char NAME_table_fits[sizeof(NAME_table) == {image_bytes}u ? 1 : -1];\n\n",
        *(
            (TEMPLATES / part).read_text(encoding="ascii") + "\n"
            for part in ("report.c", template, "sampling.c")
        ),
    ]
    return _named("".join(parts).rstrip() + "\n", name)


def _named(text: str, name: str) -> str:
    """Put the block's name for NAME: in capitals for constants, as it is for the rest."""
    text = re.sub(r"\bNAME_(?=[A-Z0-9_]+\b)", f"{name.upper()}_", text)
    return re.sub(r"\bNAME(?=[_.])", name, text)


def _number(value: float) -> str:
    return repr(float(value))
