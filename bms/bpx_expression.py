"""The expressions of BPX files: numbers, ``x``, ``+ - * / **``, ``exp``, ``tanh`` and ``cosh``, and no more.

The text is parsed, and its tree is walked with numpy; nothing of it is ever run as code.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms.errors import BatteryError

Array = NDArray[np.float64]

FUNCTIONS: dict[str, Callable[[Any], Any]] = {"exp": np.exp, "tanh": np.tanh, "cosh": np.cosh}

OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}

LONGEST = 10_000
"""Characters; a longer text is no formula."""


def evaluate(text: str, x: ArrayLike) -> Array:
    """Evaluate an expression of BPX.

    Parameters
    ----------
    text : str
        The expression.
    x : array_like
        Values of its variable.

    Returns
    -------
    ndarray
        Of the shape of ``x``; inf or NaN where the expression is.

    Raises
    ------
    BatteryError
        When the text is no such expression.
    """
    at = np.asarray(x, dtype=np.float64)
    try:
        if len(text) > LONGEST:
            raise ValueError(f"of {len(text)} characters")
        with np.errstate(all="ignore"):
            value = _walk(ast.parse(text.strip(), mode="eval").body, at)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BatteryError(
            f"{text[:60]!r} is not an expression of BPX ({error}); allowed are numbers, x, + - * / **,"
            f" {', '.join(FUNCTIONS)}"
        ) from error
    return np.asarray(np.broadcast_to(value, at.shape), dtype=np.float64).copy()


def _walk(node: ast.AST, x: Array) -> Any:
    """Value of one node of the tree."""
    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    ):
        return np.float64(node.value)
    if isinstance(node, ast.Name) and node.id == "x":
        return x
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](_walk(node.left, x), _walk(node.right, x))
    if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](_walk(node.operand, x))
    if (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in FUNCTIONS
        and len(node.args) == 1
        and not node.keywords
    ):
        return FUNCTIONS[node.func.id](_walk(node.args[0], x))
    raise ValueError(f"it holds {ast.unparse(node)[:40]!r}")
