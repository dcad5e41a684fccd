"""What people call a battery's quantities: names in several languages, symbols, and words that speak against.

The words stand in ``words.toml``. A name is taken apart at dots, underscores, brackets, digits and capital
letters, and accents are dropped: ``Batterie.uKlemme_1`` is *batterie, u, klemme, 1*.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from pathlib import Path
from typing import Any

_PHRASES = (
    ("state", "of", "charge"),
    ("etat", "de", "charge"),
    ("estado", "de", "carga"),
    ("stato", "di", "carica"),
    ("lade", "zustand"),
    ("lade", "stand"),
)
_PART = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")


def _read() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))


def _sets(key: str) -> dict[str, frozenset[str]]:
    return {name: frozenset(entry[key].split()) for name, entry in _TABLE["quantity"].items()}


_TABLE = _read()
WORDS = _sets("words")
"""Words that name a quantity."""
SYMBOLS = _sets("symbols")
"""Single letters, in the case in which they are used."""
AGAINST = _sets("against")
"""Words after which a name is something else of the same dimension."""
INITIAL, NEUTRAL, CHARGING, DISCHARGING = (
    frozenset(_TABLE["other"][key].split()) for key in ("initial", "neutral", "charging", "discharging")
)
SUFFIXES: dict[str, tuple[str, str]] = {
    name: (quantity, unit) for name, (quantity, unit) in _TABLE["suffix"].items()
}
"""Quantity and unit of what a name may end in."""


def plain(text: str) -> str:
    """Drop accents: ``Kapazität`` becomes ``Kapazitat``."""
    return unicodedata.normalize("NFKD", text.replace("ß", "ss")).encode("ascii", "ignore").decode()


def parts(name: str) -> list[str]:
    """Take a name apart, with its capital letters kept.

    Examples
    --------
    >>> parts("Batterie.uKlemme_1")
    ['Batterie', 'u', 'Klemme', '1']
    """
    found: list[str] = []
    for piece in re.split(r"[^A-Za-z0-9]+", plain(name)):
        # SoC and SoH would fall apart at their capitals.
        found += _PART.findall(re.sub(r"So([CHE])(?![a-z])", r"SO\1", piece))
    return found


def joined(items: list[str]) -> list[str]:
    """Lower-case words of a name, with phrases such as *state of charge* as one."""
    words = [item.lower() for item in items]
    for phrase in _PHRASES:
        for at in range(len(words) - len(phrase) + 1):
            if tuple(words[at : at + len(phrase)]) == phrase:
                words[at : at + len(phrase)] = ["soc"]
                break
    return words


def suffix(name: str) -> tuple[str, str] | None:
    """Quantity and unit that the end of a name tells, such as ``_mV``; None without."""
    pieces = [piece for piece in re.split(r"[^A-Za-z0-9%]+", plain(name)) if piece]
    if len(pieces) < 2:
        return None
    return SUFFIXES.get(pieces[-1]) or SUFFIXES.get(pieces[-1].lower())
