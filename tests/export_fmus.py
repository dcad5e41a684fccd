"""A small block, and ways to run what was exported: as C through ctypes, as an FMU where socwise is not."""

import ctypes
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from bms.export.block import CSource, Port
from bms.export.fmu import write_fmu

STRICT = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-pedantic")

HEADER = """
#ifndef NAME_H
#define NAME_H
typedef struct { double sum; long count; } NAME_state;
typedef struct { double sum; long count; int odd; double time_s; } NAME_output;
int NAME_start(NAME_state *s, double sum, long count, int negative);
int NAME_update(NAME_state *s, double u, double step_s, double time_s, int skip, NAME_output *out);
void NAME_read(const NAME_state *s, NAME_output *out);
#endif
"""

SOURCE = """
#include "NAME.h"
int NAME_start(NAME_state *s, double sum, long count, int negative)
{
    if (count < 0) { return 1; }
    s->sum = negative ? -sum : sum;
    s->count = count;
    return 0;
}
int NAME_update(NAME_state *s, double u, double step_s, double time_s, int skip, NAME_output *out)
{
    if (u > 100.0) { return 1; }
    if (u < -100.0) { return 7; }
    if (!skip) { s->sum += u * step_s; }
    s->count += 1;
    NAME_read(s, out);
    out->time_s = time_s;
    return 0;
}
void NAME_read(const NAME_state *s, NAME_output *out)
{
    out->sum = s->sum;
    out->count = s->count;
    out->odd = s->count % 2 != 0;
}
"""

REFUSALS = ("u is more than 100",)


def adder(name="adder"):
    """A block that adds up its input, with ports of every kind."""
    return CSource(
        name=name,
        header=HEADER.replace("NAME", name),
        source=SOURCE.replace("NAME", name),
        state_bytes=16,
        description='adds up <u> & "counts"',
        inputs=(
            Port("u", "A", "what is added", "u", 0.0),
            Port("skip", "1", "whether to leave it out", "skip", 0.0, "boolean"),
        ),
        outputs=(
            Port("sum", "Ah", "the sum", "sum", 0.0),
            Port("count", "1", "steps", "count", 0.0, "integer"),
            Port("odd", "1", "whether these are odd", "odd", 0.0, "boolean"),
        ),
        parameters=(
            Port("sum_start", "Ah", "sum at the start", "sum_start", 2.5),
            Port("count_start", "1", "steps at the start", "count_start", 3.0, "integer"),
            Port("negative", "1", "whether the start counts as negative", "negative", 0.0, "boolean"),
        ),
        start_call=f"{name}_start(&w->state, w->sum_start, (long)w->count_start, w->negative != 0.0)",
        update_call=f"{name}_update(&w->state, w->u, w->step_s, w->time_s, w->skip != 0.0, &w->out)",
        read_call=f"{name}_read(&w->state, &w->out)",
    )


def adder_with_data():
    """The same with constant data, of which it takes the first eight bytes as a number to start from."""
    plain = adder("reader")
    return replace(
        plain,
        start_call=plain.start_call.replace("w->sum_start", "*(const double *)w->data"),
        data=np.array([40.0, 2.0]).tobytes(),
    )


def compile_c(folder, sources, output, *flags):
    """Compile, warnings being errors."""
    command = ["cc", *STRICT, *flags, "-o", str(output), *map(str, sources), "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return output


def load_block(block, folder):
    """Compile a block alone, and load it."""
    block.write(folder)
    library = compile_c(folder, [f"{block.name}.c"], folder / f"{block.name}.so", "-shared", "-fPIC")
    return ctypes.CDLL(str(library))


def undefined_symbols(path):
    """What an object file wants from outside; names without decoration."""
    done = subprocess.run(["nm", "-u", str(path)], capture_output=True, text=True, check=True)
    return {re.sub(r"@.*", "", line.split()[-1]) for line in done.stdout.splitlines() if line.strip()}


ALONE = """
import importlib.abc, json, sys
sys.path.insert(0, sys.argv[1])
OURS = {"gpc", "drivecycles", "vehicle", "bms", "ems", "socwise", "numba", "casadi"}
class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in OURS:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
import fmpy, numpy as np
from fmpy.validation import validate_fmu
job = json.loads(sys.stdin.read())
signals = None
if job["inputs"]:
    signals = np.zeros(len(job["inputs"]["time"]), dtype=[(name, float) for name in job["inputs"]])
    for name, values in job["inputs"].items():
        signals[name] = values
result = fmpy.simulate_fmu(job["fmu"], stop_time=job["stop"], output_interval=job["step"], input=signals,
                           start_values=job["starts"], validate=True)
for name in OURS:
    assert name not in sys.modules
    try:
        __import__(name)
    except ModuleNotFoundError:
        pass
    else:
        raise AssertionError(name)
with open(sys.argv[2], "w") as answer:
    json.dump({"problems": validate_fmu(job["fmu"]),
               "result": {n: result[n].astype(float).tolist() for n in result.dtype.names}}, answer)
"""


def run_alone(fmu, folder, inputs=None, stop=10.0, step=1.0, starts=None):
    """Run an FMU with fmpy's simulate_fmu in a Python that has fmpy and nothing of ours.

    Returns the problems that fmpy's validation finds, and the outputs at the start and after each step.
    """
    import fmpy

    job = {
        "fmu": str(fmu),
        "inputs": None if inputs is None else {k: np.asarray(v).tolist() for k, v in inputs.items()},
        "stop": stop,
        "step": step,
        "starts": starts or {},
    }
    answer = folder / "answer.json"
    site = str(Path(fmpy.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", ALONE, site, str(answer)],
        input=json.dumps(job),
        capture_output=True,
        text=True,
        cwd=folder,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads(answer.read_text())
    return told["problems"], {name: np.array(values) for name, values in told["result"].items()}


_BUILT = {}


def fmu_of(block, version, folder_factory, **options):
    """Build an FMU once per process."""
    key = (block.name, block.header, block.source, hash(block.data), version)
    if key not in _BUILT:
        path = folder_factory.mktemp("fmu") / f"{block.name}{version}.fmu"
        _BUILT[key] = write_fmu(block, path, version, **options)
    return _BUILT[key]


class Slave:
    """An FMU through fmpy's low-level calls, the same for both versions; collects its messages."""

    def __init__(self, path, version, folder, guid=None):
        import fmpy
        from fmpy import fmi2, fmi3

        self.version, self.messages = version, []
        description = fmpy.read_model_description(str(path))
        self.variables = {v.name: v for v in description.modelVariables}
        fmpy.extract(str(path), unzipdir=str(folder))
        kind = fmi2.FMU2Slave if version == 2 else fmi3.FMU3Slave
        self.fmu = kind(
            instanceName="one",
            guid=guid or description.guid,
            modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=str(folder),
        )
        self._fmi2 = fmi2

    def _log2(self, _environment, _name, status, _category, message):
        self.messages.append((status, message.decode()))

    def _log3(self, _environment, status, _category, message):
        self.messages.append((status, message.decode()))

    def instantiate(self):
        if self.version == 2:
            callbacks = self._fmi2.fmi2CallbackFunctions()
            callbacks.logger = self._fmi2.fmi2CallbackLoggerTYPE(self._log2)
            self.callbacks = callbacks
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=self._log3)
        return self

    def start(self, start_time=0.0, stop_time=None, **values):
        self.begin(start_time, stop_time, **values)
        self.fmu.exitInitializationMode()
        return self

    def begin(self, start_time=0.0, stop_time=None, **values):
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start_time, stopTime=stop_time)
        self.set(**values)
        if self.version == 2:
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start_time, stopTime=stop_time)

    def _accessor(self, verb, name):
        kind = self.variables[name].type
        return getattr(self.fmu, f"{verb}{kind}"), self.variables[name].valueReference

    def set(self, **values):
        for name, value in values.items():
            setter, reference = self._accessor("set", name)
            setter([reference], [value])

    def get(self, name):
        getter, reference = self._accessor("get", name)
        return getter([reference])[0]

    def step(self, time, step):
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def call(self, name, *arguments):
        """Call a function of the library itself, without fmpy's check of the status."""
        return getattr(self.fmu.dll, f"fmi{self.version}{name}")(*arguments)

    @property
    def state_methods(self):
        spelling = "FMUstate" if self.version == 2 else "FMUState"
        return tuple(getattr(self.fmu, f"{verb}{spelling}") for verb in ("get", "set", "free"))

    def serialize(self, state):
        f = self.fmu
        return f.serializeFMUstate(state) if self.version == 2 else f.serializeFMUState(state)

    def deserialize(self, data):
        f = self.fmu
        return f.deSerializeFMUstate(data) if self.version == 2 else f.deserializeFMUState(data)
