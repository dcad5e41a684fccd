"""Packages that are only needed to hand results on: imported when asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from socwise.results.staging import StoreError


def optional(package: str) -> Any:
    """Import a package of the extra ``results``.

    Raises
    ------
    StoreError
        If it is not installed; says how to install it.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        raise StoreError(
            f"{package} is not installed; `python -m pip install 'socwise[results]'` brings it"
        ) from error
