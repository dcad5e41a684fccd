"""The application: energy management of hybrids whose state of charge is known up to an uncertainty."""

from importlib import metadata

try:
    __version__ = metadata.version("socwise")
except metadata.PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+unknown"

__all__ = ["__version__"]
