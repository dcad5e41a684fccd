"""Options that several commands share, and how their text becomes names and numbers."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.errors import CommandError

if TYPE_CHECKING:
    from ems import Concept

DEFAULT_JOBS = min(2, os.cpu_count() or 1)

CycleOption = Annotated[
    str,
    typer.Option(metavar="NAME[+NAME...]", help="Cycle of the library, or a CSV file; '+' joins several."),
]
OnInfeasibleOption = Annotated[
    Literal["error", "limit"],
    typer.Option(help="A step that the vehicle cannot follow: stop, or drive as well as possible."),
]
JobsOption = Annotated[
    int, typer.Option(min=1, metavar="N", help="Threads that compute; the results do not depend on it.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", metavar="", help="Print one JSON object and nothing else.")
]


def toml_value(text: str) -> Any:
    """Read a value as TOML would, and what TOML does not know as text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def key_values(texts: Sequence[str] | None, option: str) -> dict[str, Any]:
    """Read an option that is given as KEY=VALUE, as often as one likes.

    Raises
    ------
    CommandError
        If there is no key or no value.
    """
    found: dict[str, Any] = {}
    for text in texts or ():
        key, equals, value = (part.strip() for part in text.partition("="))
        if not key or not equals or not value:
            raise CommandError(f"{option} is {text!r}; give KEY=VALUE")
        found[key] = toml_value(value)
    return found


def split(text: str, option: str) -> list[str]:
    """Take a list with commas apart.

    Raises
    ------
    CommandError
        If an item is empty.
    """
    items = [item.strip() for item in text.split(",")]
    if not all(items):
        raise CommandError(f"{option} is {text!r}, with an empty item; give one, or several with commas")
    return items


def variances(text: str) -> list[float]:
    """Read the values of ``--mu``.

    Raises
    ------
    CommandError
        If one is no number, or no variance of a SOC measurement.
    """
    values = []
    for item in split(text, "--mu"):
        try:
            value = float(item)
        except ValueError:
            value = float("nan")
        if not 0.0 <= value < float("inf"):
            raise CommandError(
                f"--mu is {item!r}; it is the variance of the measured SOC and must be a number, zero or "
                "positive, such as 0.002; several with commas"
            )
        values.append(value)
    return values


def concepts(text: str) -> list[Concept]:
    """Load the concepts of ``--concept``.

    Raises
    ------
    EmsError
        If there is no such concept, or its file is not valid.
    """
    from ems import concept_names, load_concept

    if text.strip().lower() == "both":
        return [load_concept(name) for name in concept_names()]
    # The path of a file may hold a comma.
    items = [text] if Path(text).is_file() else split(text, "--concept")
    return [load_concept(item) for item in items]


def one_concept(text: str) -> Concept:
    """Load the one concept of a command that takes one.

    Raises
    ------
    CommandError
        If there are several.
    """
    found = concepts(text)
    if len(found) > 1:
        raise CommandError(f"--concept is {text!r}; this command takes one, such as hev")
    return found[0]
