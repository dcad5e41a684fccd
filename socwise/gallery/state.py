"""A digest of all that decides what comes out: our code and data, and what they run on."""

from __future__ import annotations

import hashlib
import platform
from pathlib import Path

from socwise.clashes import PACKAGES
from socwise.results.plain import versions

ROOT = Path(__file__).parents[2]
_BUILT = frozenset({".pyc", ".pyo", ".nbi", ".nbc", ".so"})


def state_digest() -> str:
    """Return the SHA-256 of every file of our packages and the versions of those that they use."""
    digest = hashlib.sha256()
    digest.update(repr((platform.python_version(), platform.machine(), sorted(versions().items()))).encode())
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*")):
            if path.is_file() and path.suffix not in _BUILT:
                content = path.read_bytes()
                digest.update(f"{path.relative_to(ROOT).as_posix()}\0{len(content)}\0".encode())
                digest.update(content)
    return digest.hexdigest()
