"""Print the lower bounds of pyproject.toml as pins: `python tools/lowest.py > build-lowest.txt`.

The run-time dependencies and the extra `test` are pinned, so that an environment made of the oldest versions
that we claim to support can run the tests. What they themselves depend on is left to pip.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"

REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9][A-Za-z0-9._-]*)\s*>=\s*(?P<bound>[0-9][0-9A-Za-z.]*)")


def pins(project: dict[str, object], extras: tuple[str, ...] = ("test",)) -> list[str]:
    """Turn the requirements of ``[project]`` and of some extras into sorted lines ``name==bound``.

    Raises
    ------
    ValueError
        When a requirement is not of the form ``name>=bound``.
    """
    optional = project.get("optional-dependencies", {})
    wanted = [project.get("dependencies", []), *(optional[extra] for extra in extras)]  # type: ignore[index]
    found: list[str] = []
    for requirement in (line for lines in wanted for line in lines):  # type: ignore[attr-defined]
        match = REQUIREMENT.fullmatch(requirement.strip())
        if match is None:
            raise ValueError(f"requirement {requirement!r} has no lower bound alone; write name>=bound")
        found.append(f"{match['name']}=={match['bound']}")
    return sorted(found)


if __name__ == "__main__":
    print("\n".join(pins(tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"])))
