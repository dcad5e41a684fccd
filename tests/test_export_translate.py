"""The translator: C does what Python does, and what it does not know it refuses."""

import ctypes
import math
import subprocess
from typing import NamedTuple

import numpy as np
import pytest
from export_cases import STRICT
from fmu_files import COMPILER, needs_compiler

from bms.export.program import Program
from bms.export.translate import translate
from bms.export.values import Thing, TranslationError, array, literal, variable

LIMIT = 0.75
TURNS = 5


class Options(NamedTuple):
    gain: float  # what it is multiplied with
    squares: bool
    table: np.ndarray


class Room(NamedTuple):
    first: np.ndarray
    second: np.ndarray


OPTIONS = Options(1.5, False, np.array([[1.0, 2.0], [4.0, 8.0], [16.0, 32.0]]))


def clip(x, y, v):
    return min(max(x, y), LIMIT) + max(y, x, 0.25)


def truncate(x, y, v):
    return float(int(x * 10.0)) + y / 3.0


def decide(x, y, v):
    total = 0.0
    if -0.5 < x <= y < 2.0 or not y > x:
        total += 1.0
    elif x != y and (math.isnan(x) or math.isfinite(y)):
        total -= 2.0
    else:
        total = total * 3.0 - (x + y)
    return total if x > 0.0 else -total


def swap(x, y, v):
    a, b = x, y
    for _ in range(TURNS):
        a, b = b, a - b * 0.5
    v[0], v[1], v[2] = v[2], v[0] + v[1], v[1]
    v[3] -= v[0] - v[1] - a
    return a


def pivot(x, y, v):
    """Leaves from within two loops."""
    for i in range(v.size):
        for j in range(i + 1):
            if v[i] + v[j] > x:
                return v[i] - v[j] * y
    return -1.0


def backwards(x, y, v):
    for i in range(v.size - 2, -1, -1):
        v[i] += x * v[i + 1]
    k = 0
    while k < v.size - 1 and v[k] < y:
        k += 1
    v[:2] = 0.5
    return v[k]


def reshape_and_copy(x, y, v):
    m = v[2:].reshape(-1, 2)
    before = m.copy() if False else v.copy()
    work = np.zeros((2, 2))
    work[1:, 0] = x
    for i in range(m.shape[0]):
        m[i, 1] = m[i, 0] = y + before[2 * i] * work[i, 0]
    return m[1, 1] + before[5]


def both(x, y):
    return x * 2.0, (y, x - y)


def pair(x, y, v):
    a, (b, c) = both(x, y)[0], both(x, y)[1]
    ohm = (a, b, c, 0.5)
    total = 0.0
    for k in range(2):
        at = 1 if k == 0 else -1
        if at >= 0:
            total += ohm[1 + 2 * k] * ohm[2 * k] + v[at]
    return total


def flags(x, y, v):
    seen = 0
    if x > 0.0:
        seen |= 4
    if y > 0.0:
        seen |= 16
    fresh = seen & ~int(v[0])
    if fresh & 4:
        return 1.0
    return 2.0 if fresh else 3.0


def first_is_known(settings, x):
    weight = settings.gain * 2.0
    if settings.squares:
        return x**2 * 12345.0
    total = 0.0
    for row in range(settings.table.shape[0]):
        total += weight * settings.table[row, 1] * x
    return total + settings.gain * settings.table[2, 0]


def fill(room, value):
    room.first[0] = value
    room.second[:] = room.first
    return value > 0.0


def rooms(x, y, v):
    room = Room(v[:2], v[2:4])
    if not fill(room, x):
        fill(room, y * y)
    return room.second[0] + room.second[1]


KERNELS = (clip, truncate, decide, swap, pivot, backwards, reshape_and_copy, pair, flags, rooms)
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.75, 1e300, math.inf, -math.inf, math.nan)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder, program = tmp_path_factory.mktemp("translate"), Program()
    given = [variable("double", "x"), variable("double", "y"), array("v", (6,))]
    made = [translate(program, kernel, given) for kernel in KERNELS]
    made.append(translate(program, first_is_known, [Thing(OPTIONS, "options"), variable("double", "x")]))
    text = "#include <math.h>\n#include <stdbool.h>\n" + program.text(*made)
    for kernel, function in zip((*KERNELS, first_is_known), made, strict=True):
        used = [parameter for parameter in function.parameters if parameter.used]
        head = ", ".join(each.declaration() for each in used)
        call = ", ".join(each.name for each in used)
        text += f"\ndouble call_{kernel.__name__}({head});\n"
        text += f"double call_{kernel.__name__}({head})\n{{\n    return {function.name}({call});\n}}\n"
    (folder / "kernels.c").write_text(text)
    command = [COMPILER, *STRICT, "-shared", "-fPIC", "-o", "kernels.so", "kernels.c", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + text
    loaded = ctypes.CDLL(str(folder / "kernels.so"))
    return loaded, dict(zip(KERNELS, made, strict=False)), text


def in_c(library, kernel, x, y, v):
    loaded, functions, _ = library
    kinds = {"x": ctypes.c_double(x), "y": ctypes.c_double(y), "v": v.ctypes.data_as(ctypes.c_void_p)}
    call = getattr(loaded, f"call_{kernel.__name__}")
    call.restype = ctypes.c_double
    return call(*(kinds[each.name] for each in functions[kernel].parameters if each.used))


@needs_compiler
@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.__name__)
def test_c_does_what_python_does(library, kernel):
    rng = np.random.default_rng(5)
    pairs = [tuple(rng.normal(0.0, 1.0, 2)) for _ in range(300)]
    if kernel is not truncate:  # a NaN has no whole part
        pairs += [(x, y) for x in SPECIAL for y in SPECIAL]
    for x, y in pairs:
        start = np.round(rng.normal(0.0, 2.0, 6), 1)
        here, there = start.copy(), start.copy()
        with np.errstate(all="ignore"):
            expected = kernel(np.float64(x), np.float64(y), here)
        got = in_c(library, kernel, x, y, there)
        assert np.array_equal(expected, got, equal_nan=True), (x, y)
        assert np.array_equal(here, there, equal_nan=True)


@needs_compiler
def test_what_is_known_is_decided(library):
    loaded, _, text = library
    loaded.call_first_is_known.restype = ctypes.c_double
    for x in (0.3, -2.0):
        assert loaded.call_first_is_known(ctypes.c_double(x)) == first_is_known(OPTIONS, x)
    assert "12345" not in text
    assert "static const double options_gain = 1.5; /* what it is multiplied with */" in text


def test_a_kernel_is_translated_once_for_the_same_arguments():
    program = Program()
    x, y, v = variable("double", "x"), variable("double", "y"), array("v", (6,))
    assert translate(program, swap, [x, y, v]) is translate(program, swap, [y, x, array("w", (6,))])
    assert translate(program, swap, [x, y, v]) is not translate(program, swap, [x, y, array("v", (7,))])
    assert translate(program, swap, [x, y, v]) is not translate(program, swap, [x, literal(1.0), v])


def has_text(x, v):
    return "no number"


def has_a_list(x, v):
    return sum(each * x for each in v)


def beyond_the_end(x, v):
    return v[6]


def changes_kind(x, v):
    k = 0
    for i in range(v.size):
        if v[i] > x:
            k = v[i]
    return k


def unknown_size(x, v):
    return v[: int(x)]


def writes(v):
    v[0] = 7.0
    return 1.0


def reads_then_writes(x, v):
    return v[0] + writes(v)


def writes_perhaps(x, v):
    return x > 0.0 and writes(v) > 0.0


def cubes(x, v):
    return x**3


def never_set(x, v):
    if x > 0.0:
        y = v[0]
    else:
        z = v[1]
    return y + z if x > 0.0 else w  # noqa: F821


def does_not_fit(x, v):
    a, b, c = x, v[0]
    return a + b + c


def raises(x, v):
    if x < 0.0:
        raise ValueError
    return x


REFUSED = (
    has_text,
    has_a_list,
    beyond_the_end,
    changes_kind,
    unknown_size,
    reads_then_writes,
    writes_perhaps,
    cubes,
    never_set,
    does_not_fit,
    raises,
)


@pytest.mark.parametrize("kernel", REFUSED, ids=lambda kernel: kernel.__name__)
def test_what_is_not_known_is_refused(kernel):
    with pytest.raises(TranslationError, match=kernel.__name__):
        translate(Program(), kernel, [variable("double", "x"), array("v", (6,))])
