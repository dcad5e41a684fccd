"""Series that a folder holds in several NetCDF files, side by side in one xarray Dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socwise.results.optional import optional
from socwise.results.staging import ESTIMATE_FORMAT, INERTIA_FORMAT, StoreError

if TYPE_CHECKING:
    import xarray as xr

_ALONG = {ESTIMATE_FORMAT: "estimator", INERTIA_FORMAT: "run"}
_METHOD = "method"


def series_dataset(folder: Path, manifest: Mapping[str, Any], form: str) -> xr.Dataset:
    """Return the series of all NetCDF files of a folder.

    Parameters
    ----------
    folder : Path
        Where they are.
    manifest : mapping
        Its ``files`` are read, no others.
    form : str
        What the folder holds; estimators stand along ``estimator``, inertia estimates along ``run``, spreads
        of traffic along ``method``. Times of files that differ are joined, with NaN where a file has none.

    Raises
    ------
    StoreError
        If there are none, or one is missing or damaged.
    """
    xarray = optional("xarray")
    files = [folder / name for name in manifest.get("files", ()) if name.endswith(".nc")]
    if not files:
        raise StoreError(f"{folder} holds no NetCDF files; its numbers are in result.json")
    found = [_open(path) for path in files]
    if len(found) == 1 and form not in _ALONG and _METHOD not in found[0].attrs:
        return found[0]
    along = _ALONG.get(form, _METHOD)
    labels = [path.stem for path in files]
    joined: xr.Dataset = xarray.concat(
        [one.drop_attrs(deep=False) for one in found],
        dim=xarray.Variable((along,), labels),
        join="outer",
        data_vars="all",
        coords="minimal",
        compat="equals",
        combine_attrs="override",
    )
    shared = sorted({name for one in found for name in one.attrs} - {"title", "Conventions", along})
    joined = joined.assign_coords({name: (along, _texts(found, name)) for name in shared})
    joined.attrs["title"] = found[0].attrs.get("title", "socwise")
    return joined


def _open(path: Path) -> xr.Dataset:
    xarray = optional("xarray")
    try:
        with xarray.open_dataset(path, engine="scipy") as opened:
            content: xr.Dataset = opened.load()
    except (OSError, TypeError, ValueError, LookupError, AttributeError) as error:
        raise StoreError(f"{path} is missing or damaged ({error}); compute it again") from error
    # A dimension named as its own coordinate is what xarray selects and aligns by.
    names = {"time": "time_s", "place": "position_m", "cell": "position_m"}
    for dimension, name in names.items():
        if dimension in content.dims and name in content.variables and content[name].dims == (dimension,):
            attributes = dict(content[name].attrs)
            content = content.assign_coords({dimension: (dimension, content[name].values, attributes)})
            content = content.drop_vars(name)
    return content


def _texts(found: Sequence[xr.Dataset], name: str) -> list[Any]:
    return [one.attrs.get(name, "") for one in found]
