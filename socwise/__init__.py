"""The application: energy management of hybrids whose state of charge is known up to an uncertainty."""

from importlib import metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from socwise.results import Result

try:
    __version__ = metadata.version("socwise")
except metadata.PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+unknown"

__all__ = ["Result", "__version__"]


def __getattr__(name: str) -> Any:
    # Results pull in numpy and scipy, which the command line does without as long as it can.
    if name == "Result":
        from socwise.results import Result

        return Result
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
