"""Keep numba's on-disk cache honest across kernels that call each other.

numba recompiles a cached function when *its own* file changes, not when a function that it calls does. So a
kernel can run with yesterday's callee: after an edit, and after an upgrade too, because wheels carry fixed
file times. Kernels that belong together are therefore stamped together: when the source of any of them
changes, all are compiled anew.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType


def discard_stale(modules: Iterable[ModuleType], name: str = "kernels") -> bool:
    """Delete the cached kernels of modules whose joint source is not the one that was stamped.

    Parameters
    ----------
    modules : iterable of module
        Modules that hold ``@njit(cache=True)`` kernels and call each other.
    name : str
        Name of the stamp; groups that share a folder need different ones.

    Returns
    -------
    bool
        Whether anything was discarded. A cache that cannot be written is left alone: numba then keeps none.
    """
    held = [module for module in modules if module.__file__]
    digest = hashlib.sha256(
        b"\0".join(Path(str(module.__file__)).read_bytes() for module in held)
    ).hexdigest()
    discarded = False
    for folder in {path for module in held for path in _folders(module)}:
        stamp = folder / f"{name}.sha256"
        with contextlib.suppress(OSError):
            if stamp.is_file() and stamp.read_text(encoding="ascii") == digest:
                continue
            for module in held:
                stem = Path(str(module.__file__)).stem
                for cached in (*folder.glob(f"{stem}.*.nbi"), *folder.glob(f"{stem}.*.nbc")):
                    cached.unlink(missing_ok=True)
                    discarded = True
            folder.mkdir(parents=True, exist_ok=True)
            stamp.write_text(digest, encoding="ascii")
    return discarded


def _folders(module: ModuleType) -> set[Path]:
    """Find the folders in which numba caches the kernels of a module."""
    found = set()
    for value in vars(module).values():
        path = getattr(getattr(value, "stats", None), "cache_path", None)
        if path and getattr(value, "__module__", None) == module.__name__:
            found.add(Path(path))
    return found
