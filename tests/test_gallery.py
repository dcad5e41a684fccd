"""The gallery: complete, honest about what does not reproduce, and it survives being killed."""

import csv
import json
import math
import re

import pytest
from command_line import run, tree

from socwise import reproduce
from socwise.gallery.entry import Entry, far_off, load, save
from socwise.reproduce import Reproduction, Row
from socwise.reproduce.shortfalls import OMITTED, SHORTFALLS, shortfalls_of

ITEMS = ("larsson-table1", "larsson-fig1", "larsson-fig5", "mautc-fig34")
"""Cheap ones: with and without a picture, with and without reservations, of both sources."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def counted(monkeypatch):
    """Every item that is really computed, in order; a name put into ``broken`` fails in its own way."""
    real, ran, broken = reproduce.run, [], {}

    def counting(item, **options):
        ran.append(item)
        if item in broken:
            raise broken[item]
        return real(item, **options)

    monkeypatch.setattr(reproduce, "run", counting)
    return ran, broken


def lines(folder):
    with (folder / "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_table_and_figure_of_the_sources_is_there_or_said_to_be_missing():
    sources = {"larsson": (2, 9), "mautc": (20, 50)}
    wanted = {
        f"{source}-{kind}{number}"
        for source, counts in sources.items()
        for kind, last in zip(("table", "fig"), counts, strict=True)
        for number in range(1, last + 1)
    }
    omitted = {one.id for one in OMITTED}
    assert set(reproduce.ids()) | omitted == wanted
    assert set(reproduce.ids()) & omitted == set()
    assert all(one.reason and one.title for one in OMITTED)


def test_reservations_are_about_items_that_there_are():
    assert {item for one in SHORTFALLS for item in one.items} <= set(reproduce.ids())
    assert all(one.what.endswith(".") and one.reason.endswith(".") for one in SHORTFALLS)
    assert shortfalls_of("larsson-fig5") != ()
    assert shortfalls_of("larsson-table1") == ()


def test_the_csv_and_the_page_tell_what_came_out(capsys, tmp_path):
    shown = run(capsys, "reproduce", *ITEMS, "--gallery", "--out", "g", "--json")
    assert shown.code == 0
    printed = json.loads(shown.out)
    written = lines(tmp_path / "g")
    assert [(line["id"], line["ok"] != "false") for line in written] == [
        (item["id"], row["ok"]) for item in printed for row in item["rows"]
    ]
    for line, row in zip(written, (row for item in printed for row in item["rows"]), strict=True):
        assert line["name"] in row["name"]
        if isinstance(row["ours"], float) and row["published"] is not None:
            assert float(line["ours"]) == row["ours"]
            assert float(line["deviation"]) == pytest.approx(row["ours"] - row["published"])
    page = (tmp_path / "g" / "index.html").read_text(encoding="utf-8")
    assert all(f'<h3 id="{item}">' in page for item in ITEMS)
    assert page.count('src="data:image/png;base64,') == len(list((tmp_path / "g").glob("*.png"))) == 3
    assert "larsson-fig3" not in page, "a choice of items is not said to be all"
    assert "@@" not in page
    assert not re.search(r"https?://", page)
    assert "Every one of the" in page
    reserved = {line["id"] for line in written if line["reason"]}
    assert reserved == {"larsson-fig1", "larsson-fig5"}


def test_a_row_without_verdict_is_neither_right_nor_wrong():
    found = Reproduction(
        "larsson-table1", "s", (Row.shown("x", 2.0, published=1.0), Row.near("y", 1.0, 1.0, 0.1))
    )
    from socwise.gallery.write import _line

    assert [_line(Entry(found, "t"), row)["ok"] for row in found.rows] == ["", "true"]
    assert [far_off(row) for row in found.rows] == [True, False]
    assert far_off(Row.near("x", 1.0, 0.899, 0.5))
    assert not far_off(Row.near("x", 1.0, 0.9, 0.5))
    assert far_off(Row.near("x", 1.0, math.nan, 0.5))
    assert far_off(Row.near("x", 0.0, 0.1, 0.5))


def test_an_item_that_fails_or_does_not_reproduce_is_told_and_stops_no_other(
    capsys, tmp_path, counted, monkeypatch
):
    ran, broken = counted
    broken["larsson-fig1"] = RuntimeError("<no> such curve")
    through = reproduce.run

    def wrong(item, **options):
        found = through(item, **options)
        if item != "larsson-fig5":
            return found
        rows = (*found.rows, Row.near("made up", 1.0, 2.0, 0.1))
        return Reproduction(found.id, found.source, rows, found.note, found.draw)

    monkeypatch.setattr(reproduce, "run", wrong)
    shown = run(capsys, "reproduce", *ITEMS, "--gallery", "--out", "g")
    assert shown.code == 1
    assert "Traceback" in shown.err and "<no> such curve" in shown.err
    assert ran == list(ITEMS)
    bad = [line for line in lines(tmp_path / "g") if line["ok"] == "false"]
    assert [line["id"] for line in bad] == ["larsson-fig1", "larsson-fig5"]
    assert "RuntimeError: <no> such curve" in bad[0]["reason"]
    page = (tmp_path / "g" / "index.html").read_text(encoding="utf-8")
    assert "&lt;no&gt; such curve" in page and "<no>" not in page
    assert "1 of 4 tables and figures do not reproduce; 1 failed: 2 of" in page
    assert page.index("made up") < page.index('id="contents"')
    manifest = json.loads((tmp_path / "g" / "manifest.json").read_text(encoding="utf-8"))
    assert [item["verdict"] for item in manifest["items"]] == [
        "reproduces", "failed", "does not reproduce", "reproduces",
    ]  # fmt: skip
    assert not (tmp_path / "g" / "items" / "larsson-fig1.json").exists(), "what failed is tried again"


def test_a_killed_run_goes_on_where_it_was(capsys, tmp_path, counted):
    ran, broken = counted
    assert run(capsys, "reproduce", *ITEMS, "--gallery", "--out", "whole").code == 0
    ran.clear()
    broken["larsson-fig5"] = KeyboardInterrupt()
    assert run(capsys, "reproduce", *ITEMS, "--gallery", "--out", "g").code == 130
    assert not (tmp_path / "g" / "index.html").exists()
    broken.clear()
    ran.clear()
    assert run(capsys, "reproduce", *ITEMS, "--gallery", "--out", "g", "--resume").code == 0
    assert ran == ["larsson-fig5", "mautc-fig34"]
    whole, resumed = tree(tmp_path / "whole"), tree(tmp_path / "g")
    assert whole.keys() == resumed.keys()
    assert [name for name in whole if whole[name] != resumed[name]] == ["timings.json"]
    assert set(json.loads(resumed["timings.json"])) == {"larsson-fig5", "mautc-fig34"}


def test_without_resume_everything_is_computed_anew(capsys, counted):
    ran, _ = counted
    for _ in range(2):
        assert run(capsys, "reproduce", "larsson-table1", "--gallery", "--out", "g").code == 0
    assert ran == ["larsson-table1", "larsson-table1"]


def test_what_was_kept_by_another_state_or_is_damaged_is_computed_anew(tmp_path):
    rows = (Row.near("fuel", 3.5, 3.6, 0.2, "l/100 km", 0.01), Row.shown("c", math.nan), Row.shown("d", "x"))
    entry = Entry(Reproduction("mautc-fig1", "source", rows, "note"), "title", "mautc-fig1.png")
    path = tmp_path / "items" / "mautc-fig1.json"
    path.parent.mkdir()
    save(entry, "state", path)
    assert load(path, "state") is None, "its picture is missing"
    (tmp_path / "mautc-fig1.png").write_bytes(b"")
    again = load(path, "state")
    assert repr(again.found.rows) == repr(rows)
    assert (again.title, again.figure, again.found.note) == ("title", "mautc-fig1.png", "note")
    assert load(path, "another state") is None
    path.write_text(path.read_text(encoding="utf-8")[:-20], encoding="utf-8")
    assert load(path, "state") is None
    assert load(tmp_path / "none.json", "state") is None


def test_resume_needs_a_gallery(capsys):
    shown = run(capsys, "reproduce", "larsson-table1", "--resume")
    assert shown.code == 2
    assert "--resume goes with 'all' or --gallery" in " ".join(shown.err.split())


@pytest.mark.slow
def test_all_of_it(capsys, tmp_path):
    """Every item; whatever is far from a published value has its reason."""
    shown = run(capsys, "reproduce", "all", "--out", "g", "--json")
    printed = json.loads(shown.out)
    assert [item["id"] for item in printed] == list(reproduce.ids())
    written = lines(tmp_path / "g")
    wrong = [line for line in written if line["ok"] == "false"]
    assert shown.code == (1 if wrong else 0)
    assert len(wrong) == sum(not row["ok"] for item in printed for row in item["rows"])
    assert {line["id"] for line in written if line["name"] == "not covered"} == {one.id for one in OMITTED}
    for line in written:
        if line["published"] and line["deviation"]:
            far = abs(float(line["deviation"])) > 0.1 * abs(float(line["published"])) * (1.0 + 1e-9)
            assert not far or line["reason"], line
    page = (tmp_path / "g" / "index.html").read_bytes()
    assert len(page) < 12e6
