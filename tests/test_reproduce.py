"""The registry of what can be reproduced, and the record that comes of it."""

import inspect
import json
import math
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

from ems.errors import EmsError
from socwise import reproduce
from socwise.reproduce import Reproduction, Row
from socwise.reproduce.panels import new_figure
from socwise.reproduce.registry import _ITEMS


def picture():
    figure = new_figure(2.0, 1.0)
    figure.subplots().plot([0.0, 1.0])
    return figure


def test_the_items_are_those_of_the_paper():
    places = ["table1", "table2", "fig1", "fig2", "fig4", "fig5", "fig6", "fig7", "fig8", "fig9"]
    assert [item for item in reproduce.ids() if item.startswith("larsson-")] == [
        f"larsson-{p}" for p in places
    ]
    assert all(reproduce.title(item) for item in reproduce.ids())


@pytest.mark.parametrize("item", reproduce.ids())
def test_every_item_leads_to_a_function_that_takes_jobs_and_progress(item):
    found = _ITEMS[item]
    function = getattr(import_module(f"socwise.reproduce.{found.module}"), found.function)
    bound = inspect.signature(function).bind(jobs=1, progress=None)
    assert set(bound.arguments) == {"jobs", "progress"}


@pytest.mark.parametrize(
    ("given", "nearest"),
    [
        ("larson-table2", "larsson-table2"),
        ("Larsson-Fig10", "larsson-fig1"),
        ("fig 9", "mautc-fig9"),
        ("picture", None),
    ],
)
def test_an_unknown_item_is_refused_with_the_nearest(given, nearest):
    with pytest.raises(EmsError, match="larsson-table1, larsson-table2") as caught:
        reproduce.run(given)
    assert given in str(caught.value)
    assert ("did you mean" in str(caught.value)) == (nearest is not None)
    if nearest:
        assert f"did you mean '{nearest}'?" in str(caught.value)
    with pytest.raises(EmsError):
        reproduce.title(given)


def test_names_ignore_case_and_blanks():
    assert reproduce.run(" Larsson-TABLE1 ").id == "larsson-table1"


def test_importing_the_registry_is_cheap():
    code = (
        "import sys, socwise.reproduce as r; r.ids(); r.title('larsson-fig6');"
        "print(sorted({'matplotlib', 'numba', 'ems'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_near_takes_the_tolerance_in_and_nothing_more():
    assert Row.near("x", 0.1, 0.3, 0.2).ok
    assert not Row.near("x", 0.1, 0.3001, 0.2).ok
    assert Row.near("x", 0.65, 0.65, 0.0).ok
    assert not Row.near("x", 0.65, 0.6501, 0.0).ok
    assert not Row.near("x", 1.0, math.nan, 0.5).ok
    assert Row.near("x", 2.0, 1.5, 1.0).deviation == -0.5


def test_between_names_its_limits_and_takes_them_in():
    assert Row.between("rise", 0.5, 4.0, 0.5, "%").ok
    assert not Row.between("rise", 0.5, 4.0, 4.1).ok
    assert not Row.between("rise", 0.5, 4.0, math.nan).ok
    assert Row.between("rise", 0.5, 4.0, 1.0).name == "rise, wanted 0.5 to 4"
    assert Row.between("rise", 0.5, math.inf, 1.0).name == "rise, wanted at least 0.5"
    assert Row.between("rise", -math.inf, 0.2, 0.1).name == "rise, wanted at most 0.2"


def test_the_label_holds_error_and_unit():
    assert Row.shown("fuel", 3.5, "l/100 km", error=0.0123).label == "fuel, s.e. 0.012 [l/100 km]"
    assert Row.shown("ratio", 3.5).label == "ratio"


def test_deviation_needs_two_numbers():
    assert Row.shown("x", "same", published=1.0).deviation is None
    assert Row.shown("x", 1.0).deviation is None


def test_one_wrong_row_makes_the_whole_wrong():
    good, bad = Row.holds("a", True, 1.0), Row.holds("b", np.bool_(False), 1.0)
    assert Reproduction("x", "s", (good, good)).ok
    assert not Reproduction("x", "s", (good, bad)).ok


def test_json_has_the_keys_of_the_design_and_nothing_that_json_cannot_write(tmp_path):
    rows = (
        Row.near("fuel", 3.49, 3.6, 0.349, "l/100 km"),
        Row.holds("b", np.bool_(True), "1 < 2"),
        Row.shown("c", math.inf),
    )
    item = Reproduction("larsson-x", "source", rows, "a note", picture)
    path = item.write_figure(tmp_path / "new" / "folder")
    written = json.loads(json.dumps(item.to_json(path), allow_nan=False))
    assert written == {
        "id": "larsson-x",
        "source": "source",
        "rows": [
            {"name": "fuel [l/100 km]", "published": 3.49, "ours": 3.6, "tolerance": 0.349, "ok": True},
            {"name": "b", "published": None, "ours": "1 < 2", "tolerance": None, "ok": True},
            {"name": "c", "published": None, "ours": None, "tolerance": None, "ok": True},
        ],
        "figure": str(path),
    }
    assert item.to_json()["figure"] is None


def test_the_picture_is_written_whole_or_not_at_all(tmp_path):
    def fails():
        raise RuntimeError("drawing failed")

    path = Reproduction("x", "s", (), draw=picture).write_figure(tmp_path)
    assert path == tmp_path / "x.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(RuntimeError):
        Reproduction("y", "s", (), draw=fails).write_figure(tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["x.png"]
    assert Reproduction("z", "s", ()).write_figure(tmp_path) is None


def test_drawing_opens_no_window(tmp_path):
    code = (
        "import sys, pathlib; from socwise.reproduce import run;"
        f"run('larsson-fig1').write_figure(pathlib.Path({str(tmp_path)!r}));"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert (tmp_path / "larsson-fig1.png").is_file()
