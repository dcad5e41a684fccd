"""Find other distributions that bring a top-level package of the same name as one of ours.

`bms`, `ems` and `vehicle` are also the names of unrelated distributions. pip installs both into one folder
without a word: the later overwrites the earlier, and removing either breaks the other. So the question is
asked in three ways: who claims the name, where the name would be imported from, and whether the file there is
the one that we installed. Only the standard library is imported here, so that the check still works when our
packages do not.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import json
import re
import sys
import warnings
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlsplit

DISTRIBUTION = "socwise"

PACKAGES = ("gpc", "drivecycles", "vehicle", "bms", "ems", "socwise")
"""The import packages that the distribution brings."""


@dataclass(frozen=True)
class Clash:
    """One of our packages that is claimed, shadowed, overwritten or gone.

    Parameters
    ----------
    package : str
        Our import package.
    fault : str
        What is wrong with it, a sentence without a full stop.
    cure : str
        The commands that mend it.
    distribution : str, optional
        The other distribution that claims the name, if one is known.
    """

    package: str
    fault: str
    cure: str
    distribution: str | None = None

    @property
    def message(self) -> str:
        """Fault and cure, in one paragraph."""
        return f"{self.fault}. {self.cure}"


def name_clashes() -> list[Clash]:
    """List the clashes between our six packages and whatever else is installed; there should be none.

    Returns
    -------
    list of Clash
        In the order of `PACKAGES`. An editable or a doubly listed installation of socwise itself is no clash.
    """
    claims = _claims()
    recorded = _recorded_hashes()
    found: list[Clash] = []
    for package in PACKAGES:
        # A broken installation can have no name, and one on two path entries has its name twice.
        names = {name for name in claims.get(package, []) if name and _normal(name) != DISTRIBUTION}
        if names:
            found += [_claimed(package, name) for name in sorted(names)]
        else:
            fault = _misplaced(package, recorded)
            if fault is not None:
                found.append(Clash(package, fault, f"Do this: {_reinstall()}. {_FRESH}"))
    return found


def _claims() -> dict[str, list[str]]:
    """List by whom each of our packages is claimed; an installation without a name claims nothing.

    ``metadata.packages_distributions`` would do, but for an installation without a name some versions of
    Python warn, and the backport of importlib.metadata, once anything has imported it, raises.
    """
    claims: dict[str, list[str]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for distribution in metadata.distributions():
            packages = _ours_among(distribution)
            try:
                name = distribution.metadata["Name"] if packages else ""
            except KeyError:
                continue
            for package in packages:
                claims.setdefault(package, []).append(name)
    return claims


_RECORDED = re.compile(rf'^"?({"|".join(PACKAGES)})(?:/|\.py[",])', re.MULTILINE)
"""A line of a RECORD with a file of a package of ours."""


def _ours_among(distribution: metadata.Distribution) -> set[str]:
    """Find our packages' names among what a distribution installs."""
    tops = (distribution.read_text("top_level.txt") or "").split()
    record = distribution.read_text("RECORD")
    if record is None:
        files = [path.parts[0].removesuffix(".py") for path in distribution.files or []]
    else:
        # A path for each of some ten thousand lines would take longer than most commands do.
        files = _RECORDED.findall(record)
    return {*tops, *files} & set(PACKAGES)


_FRESH = "Or use a fresh environment: `python -m venv NEW`, and install socwise alone with the pip of NEW"


def _claimed(package: str, distribution: str) -> Clash:
    try:
        version = f" {metadata.version(distribution)}"
    except metadata.PackageNotFoundError:
        version = ""
    fault = (
        f"The distribution {distribution}{version} also installs a package called {package!r}, which is one "
        "of socwise's; in one environment the two overwrite each other"
    )
    cure = f"Do this: `python -m pip uninstall {distribution}`, then {_reinstall()}. {_FRESH}"
    return Clash(package, fault, cure, distribution)


def _misplaced(package: str, recorded: dict[Path, str]) -> str | None:
    """Say what is wrong with the file that ``import package`` would load, or None."""
    expected = Path(__file__).resolve().parents[1] / package / "__init__.py"
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # already imported by something that gave it no spec
        spec = None
    if spec is None or spec.origin is None:
        return f"The package {package!r} of socwise has no {expected}; another installation has removed it"
    origin = Path(spec.origin).resolve()
    if origin != expected:
        return f"`import {package}` loads {origin}, which is not socwise's {expected}"
    digest = recorded.get(origin)
    if digest is not None and digest != _digest(origin):
        return f"{origin} is not the file that socwise installed; another installation has overwritten it"
    return None


def _recorded_hashes() -> dict[Path, str]:
    """Map each ``__init__.py`` to its SHA-256 as pip recorded it; empty for an editable installation."""
    wanted = {f"{package}/__init__.py" for package in PACKAGES}
    try:
        distribution = metadata.distribution(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return {}
    return {
        Path(str(distribution.locate_file(file))).resolve(): file.hash.value
        for file in distribution.files or []
        if file.as_posix() in wanted and file.hash is not None and file.hash.mode == "sha256"
    }


def _digest(path: Path) -> str:
    """SHA-256 of a file in the form of a RECORD: URL-safe base 64 without padding."""
    return base64.urlsafe_b64encode(hashlib.sha256(path.read_bytes()).digest()).rstrip(b"=").decode()


def _reinstall() -> str:
    """Write the command that puts our files back, from where they came."""
    source = DISTRIBUTION
    try:
        origin = json.loads(metadata.distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except metadata.PackageNotFoundError:
        root = Path(__file__).resolve().parents[1]
        return f"`python -m pip install --editable {root}`"
    url = str(origin.get("url", ""))
    if url.startswith("file:"):
        path = unquote(urlsplit(url).path)
        # Windows: file:///C:/x has the path /C:/x.
        source = path.lstrip("/") if sys.platform == "win32" else path
    elif url:
        source = url
    if origin.get("dir_info", {}).get("editable"):
        source = f"--editable {source}"
    return f"`python -m pip install --force-reinstall --no-deps {source}`"


def _normal(name: str) -> str:
    """Bring a distribution's name into the form in which names are compared (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()
