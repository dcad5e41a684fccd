"""Read a folder of results: the small files at once, the trajectories when asked for."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.results.netcdf import read_case
from socwise.results.staging import MANIFEST, StoreError, load_manifest


@dataclass(frozen=True, eq=False)
class StoredComparison:
    """A comparison on disk.

    Parameters
    ----------
    folder : Path
        Where it is.
    result : dict
        The object that ``socwise compare --json`` prints.
    manifest : dict
        Seed, versions, settings with their hash, and the list of files.
    time_s, speed_mps, altitude_m : ndarray, shape (N + 1,)
        The cycle as driven.
    """

    folder: Path
    result: dict[str, Any]
    manifest: dict[str, Any]
    time_s: NDArray[np.float64]
    speed_mps: NDArray[np.float64]
    altitude_m: NDArray[np.float64]

    def keys(self) -> list[tuple[str, float, str]]:
        """Return concept, mu and policy of every case, in the order in which they were compared."""
        return [(entry["concept"], entry["mu"], entry["policy"]) for entry in self.manifest["cases"]]

    def case(self, concept: str, mu: float, policy: str) -> Case:
        """Read one case with its trajectories; nothing is kept open or cached.

        Raises
        ------
        StoreError
            If there is no such case, or its file is missing or damaged.
        """
        wanted = (concept, mu, policy)
        for entry, key in zip(self.manifest["cases"], self.keys(), strict=True):
            if key == wanted:
                return read_case(self.folder / entry["file"], self._solve_s(wanted))
        known = "; ".join(f"{c}, mu {m:g}, {p}" for c, m, p in self.keys())
        raise StoreError(f"{self.folder} holds no case {concept}, mu {mu:g}, {policy}; it holds {known}")

    def _solve_s(self, wanted: tuple[str, float, str]) -> float:
        for row in self.result["cases"]:
            if (row["concept"], row["mu"], row["policy"]) == wanted:
                return float(row.get("solve_s") or 0.0)
        return 0.0


def read(folder: Path) -> StoredComparison:
    """Open a folder that `write` wrote.

    Raises
    ------
    StoreError
        If it is no such folder, or one of its files is missing or damaged.
    """
    if not folder.is_dir():
        raise StoreError(f"there is no folder {folder}; name one that `socwise compare --out` wrote")
    manifest = load_manifest(folder)
    if manifest is None:
        raise StoreError(
            f"{folder} holds no results of socwise (no valid {MANIFEST}); "
            "name a folder that `socwise compare --out` wrote"
        )
    try:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        cycle = np.loadtxt(folder / "cycle.csv", delimiter=",", skiprows=1, ndmin=2)
        time_s, speed_mps, altitude_m = cycle.T
    except (OSError, ValueError) as error:
        raise StoreError(f"{folder} is incomplete or damaged ({error}); compute it again") from error
    return StoredComparison(folder, result, manifest, time_s, speed_mps, altitude_m)
