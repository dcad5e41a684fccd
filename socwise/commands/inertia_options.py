"""Options that the commands of ``socwise inertia`` share, and how their text becomes values."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from socwise.commands.errors import CommandError
from socwise.commands.options import key_values, split

if TYPE_CHECKING:
    from pydantic import BaseModel

    from vehicle.inertia.defender import Geometry

    Model = TypeVar("Model", bound=BaseModel)

MOST_SEEDS = 10_000

DataOption = Annotated[
    Path | None,
    typer.Option(metavar="LOG.csv", help="Your log; a synthetic one is made if left out. May be .gz."),
]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        "--column", metavar="CHANNEL=NAME[:UNIT]", help="What your log calls a channel; may be repeated."
    ),
]
SeedsOption = Annotated[
    int, typer.Option(metavar="N", min=1, max=MOST_SEEDS, help="Synthetic logs, each with its own noise.")
]
SeedOption = Annotated[int, typer.Option(metavar="S", min=0, help="Seed of the first one.")]
DurationOption = Annotated[
    float | None, typer.Option(metavar="S", help="Length of a synthetic log.", show_default="300; 100 s")
]
OutOption = Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")]
DEFAULT_OUT = Path("results/inertia")


def names_of(text: str | None, option: str, known: Sequence[str], default: Sequence[str]) -> list[str]:
    """Read a list of names; hyphens and underscores mean the same.

    Raises
    ------
    CommandError
        If one is not known, or there twice.
    """
    if text is None:
        return list(default)
    found: list[str] = []
    for item in split(text, option):
        key = item.lower().replace("_", "-")
        name = next((one for one in known if one.replace("_", "-") == key), None)
        if name is None:
            near = difflib.get_close_matches(key, [one.replace("_", "-") for one in known], n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            allowed = ", ".join(one.replace("_", "-") for one in known)
            raise CommandError(f"{option} names {item!r}; known are {allowed}{hint}")
        if name in found:
            raise CommandError(f"{option} names {item!r} twice; name each once")
        found.append(name)
    return found


def columns_of(texts: Sequence[str] | None, data: Path | None) -> dict[str, str]:
    """Read ``--column``.

    Raises
    ------
    CommandError
        If it is malformed, or there is no log to have columns.
    """
    if texts and data is None:
        raise CommandError("--column is for a log of your own; name it with --data")
    found = {}
    for text in texts or ():
        channel, equals, name = (part.strip() for part in text.partition("="))
        if not channel or not equals or not name:
            raise CommandError(f"--column is {text!r}; give CHANNEL=NAME, such as force_fl=SF1:kN")
        found[channel] = name
    return found


def filled(model: type[Model], changes: dict[str, Any], option: str, base: Model | None = None) -> Model:
    """Build a model from changes, on top of another one if given.

    Raises
    ------
    CommandError
        If a key is unknown or a value not allowed.
    """
    from pydantic import ValidationError

    known = list(model.model_fields)
    for key in changes:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise CommandError(f"{option} sets {key!r}; known are {', '.join(known)}{hint}")
    try:
        return model(**{**({} if base is None else base.model_dump()), **changes})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        field = model.model_fields.get(where)
        given = (
            f"{where}={first['input']!r:.60}" if where else ", ".join(f"{k}={v}" for k, v in changes.items())
        )
        meaning = f" ({field.description})" if field is not None and field.description else ""
        detail = str(first["msg"]).removeprefix("Value error, ")
        raise CommandError(f"{option} {given}: {detail}{meaning}") from error


def prior_from(texts: Sequence[str] | None) -> dict[str, tuple[float, float]] | None:
    """Read ``--prior NAME=CENTRE,HALF``.

    Raises
    ------
    CommandError
        If it is malformed.
    """
    found = {}
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        parts = value.split(",")
        try:
            if not name or not equals or len(parts) != 2:
                raise ValueError
            found[name] = (float(parts[0]), float(parts[1]))
        except ValueError:
            raise CommandError(
                f"--prior is {text!r}; give NAME=CENTRE,HALF-RANGE, such as mass_kg=8000,4000"
            ) from None
    return found or None


def geometry_from(texts: Sequence[str] | None, data: Path | None, *, centre_known: bool) -> Geometry | None:
    """Read ``--geometry``; a log of the user's own needs the lengths that its model takes as known.

    Parameters
    ----------
    texts : sequence of str or None
        ``KEY=VALUE``.
    data : Path or None
        The user's log.
    centre_known : bool
        Whether the model takes the place of the centre of gravity as known.

    Raises
    ------
    CommandError
        If a length is missing, not known or not allowed.
    """
    from vehicle.inertia.defender import Geometry

    given = key_values(texts, "--geometry")
    needed = ["wheelbase_m", "track_m"]
    needed += ["cg_from_front_m", "cg_from_left_m"] if centre_known else []
    missing = [name for name in needed if name not in given]
    if data is not None and missing:
        raise CommandError(
            f"your log needs lengths of your vehicle; add {' '.join(f'--geometry {n}=...' for n in missing)}"
        )
    if not given:
        return None
    if not centre_known:
        # Not used by the model; anywhere between the axles will do.
        for name, length in (("cg_from_front_m", "wheelbase_m"), ("cg_from_left_m", "track_m")):
            if isinstance(given.get(length), float | int):
                given.setdefault(name, 0.5 * given[length])
    return filled(Geometry, given, "--geometry")


def only_synthetic(data: Path | None, given: dict[str, bool]) -> None:
    """Refuse options of the synthetic log next to ``--data``.

    Raises
    ------
    CommandError
        If one was given.
    """
    named = [option for option, there in given.items() if there]
    if data is not None and named:
        raise CommandError(f"{named[0]} is for a synthetic log, and --data names one of yours; leave one out")
