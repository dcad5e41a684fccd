"""Results as other tools want them: a table for pandas, labelled arrays for xarray.

Whatever a command wrote to a folder opens by ``Result.load(folder)``. The files themselves are plain too: CSV
for a spreadsheet, NetCDF (classic format, 64-bit offsets) for MATLAB's ``ncread``, xarray and others.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socwise.results.optional import optional
from socwise.results.plain import flatten
from socwise.results.staging import (
    ESTIMATE_FORMAT,
    FORMAT,
    INERTIA_FORMAT,
    MANIFEST,
    StoreError,
    held_format,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

STUDY_FORMAT = "socwise study"
TRAFFIC_FORMAT = "socwise traffic"
_ROWS = {FORMAT: "cases", ESTIMATE_FORMAT: "estimators", INERTIA_FORMAT: "estimates"}
_TIMINGS = frozenset({"solve_s", "run_s"})


@dataclass(frozen=True, eq=False)
class Result:
    """A folder of results.

    Parameters
    ----------
    folder : Path
        Where they are.
    form : str
        What they are: "socwise comparison", "socwise study", "socwise estimate", "socwise inertia estimate"
        or "socwise traffic".
    manifest : dict
        Settings, seed, versions and files.
    """

    folder: Path
    form: str
    manifest: dict[str, Any]

    @classmethod
    def load(cls, folder: Path | str) -> Result:
        """Open a folder that ``compare``, ``run``, ``estimate``, ``inertia`` or ``traffic`` wrote.

        Parameters
        ----------
        folder : Path or str
            What was given as ``--out``.

        Raises
        ------
        StoreError
            If it holds no results, or of a kind that has no table and no arrays.
        """
        place = Path(folder)
        form = held_format(place)
        known = (*_ROWS, STUDY_FORMAT, TRAFFIC_FORMAT)
        if form is None:
            what = "holds no results of socwise" if place.is_dir() else "is no folder"
            raise StoreError(f"{place} {what}; name one that was given as --out")
        if form not in known:
            raise StoreError(
                f"{place} holds a {form}, which does not open here; what does: {', '.join(known)}"
            )
        return cls(place, form, json.loads((place / MANIFEST).read_text(encoding="utf-8")))

    @property
    def summary(self) -> dict[str, Any]:
        """The object that the command prints with ``--json``; a study has one for each case instead.

        Raises
        ------
        StoreError
            If it is missing or damaged, or the results are a study's.
        """
        if self.form == STUDY_FORMAT:
            raise StoreError(
                f"{self.folder} holds a study; its cases are in to_pandas(), and in "
                "socwise.study.reading.read_study"
            )
        path = self.folder / "result.json"
        try:
            content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise StoreError(f"{path} is missing or damaged ({error}); compute it again") from error
        return content

    def rows(self) -> list[dict[str, Any]]:
        """Return the table of cases as flat rows, as in ``summary.csv``; without timings.

        Raises
        ------
        StoreError
            If the folder is damaged, or its results have no such table.
        """
        if self.form == STUDY_FORMAT:
            from socwise.study.reading import read_study
            from socwise.study.tables import summary_rows

            rows: list[Any] = summary_rows(read_study(self.folder))
        elif self.form in _ROWS:
            rows = self.summary[_ROWS[self.form]]
        else:
            raise StoreError(
                f"{self.folder} holds {self.form}, which has no table of cases; take to_xarray()"
            )
        return [{name: value for name, value in flatten(row).items() if name not in _TIMINGS} for row in rows]

    def to_pandas(self) -> pd.DataFrame:
        """Return the table of cases: a row for each policy in each setting, estimator, or estimated drive.

        Returns
        -------
        pandas.DataFrame
            Columns as in ``summary.csv``: names carry units, ``cost_kg_mean`` and ``cost_kg_se`` are the mean
            over the realizations and its standard error.

        Raises
        ------
        StoreError
            If pandas is not installed, the folder is damaged, or its results have no such table.
        """
        pandas = optional("pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.rows())
        return frame

    def to_xarray(self) -> xr.Dataset:
        """Return the arrays, with names, units and coordinates.

        Returns
        -------
        xarray.Dataset
            Of a comparison: every trajectory over concept, mu, policy, realization and time (samples) or
            step. Of a study: means and standard errors over its factors (over ``case`` where they are no full
            grid) and the policy. Of estimates: series over estimator and time. Of inertia estimates: series
            over run and time. Of traffic: the field, or the spreads over the method. NaN where there is none.

        Raises
        ------
        StoreError
            If xarray is not installed, a file is missing or damaged, or there are no arrays.
        """
        optional("xarray")
        if self.form == FORMAT:
            from socwise.results.comparison_arrays import comparison_dataset
            from socwise.results.reading import read

            return comparison_dataset(read(self.folder))
        if self.form == STUDY_FORMAT:
            from socwise.results.study_arrays import study_dataset
            from socwise.study.reading import read_study

            return study_dataset(read_study(self.folder))
        from socwise.results.series_arrays import series_dataset

        return series_dataset(self.folder, self.manifest, self.form)
