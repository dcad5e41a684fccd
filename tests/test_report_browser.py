"""Every page in a real browser: nothing fails, every plot is there, and it fits a phone and a desk."""

import os
import shutil

import pytest
from synthetic import POLICIES, make_comparison, store_without_figures
from synthetic_study import factorial, scattered, write_study

from socwise.gallery import collect, write_gallery
from socwise.report import write_report, write_study_report

pytestmark = pytest.mark.browser

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PLOTS = (
    "differences-plots-0",
    "differences-plots-1",
    "cost-plots-0",
    "cost-plots-1",
    "trajectory-plot",
)


@pytest.fixture(scope="module")
def browser():
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        message = f"no Chromium found (looked for {', '.join(BROWSERS)})"
        if os.environ.get("SOCWISE_REQUIRE_BROWSER") == "1":
            pytest.fail(f"{message}, and SOCWISE_REQUIRE_BROWSER=1 asks for one")
        pytest.skip(message)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, headless=True, args=ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    out = tmp_path_factory.mktemp("browser") / "out"
    comparison = make_comparison(policies=POLICIES, steps=120, realizations=3)
    stored = store_without_figures(comparison, out)
    write_report(stored, out / "report.html")
    return (out / "report.html").as_uri()


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """A page of a full grid with failures, and one of samples."""
    folder = tmp_path_factory.mktemp("studies")
    grid = factorial(
        concept=["hev", "phev"], penalty_steepness=[0.01, 0.1, 1.0], window_width=[0.2, 0.3, 0.6]
    )
    write_study(folder / "grid", grid, failed=(4,), missing=(9,))
    write_study(folder / "samples", scattered(24))
    for name in ("grid", "samples"):
        write_study_report(folder / name, folder / f"{name}.html")
    return {name: (folder / f"{name}.html").as_uri() for name in ("grid", "samples")}


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gallery")
    entries = list(collect(("larsson-table1", "larsson-fig1", "mautc-fig34"), folder))
    write_gallery(entries, folder, complete=True)
    return (folder / "index.html").as_uri()


@pytest.fixture
def opened(browser):
    """Open a page; whatever goes wrong in it until the end of the test fails the test."""
    trouble, contexts = [], []

    def open_page(url, width_px, scheme="light"):
        context = browser.new_context(viewport={"width": width_px, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: trouble.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: trouble.append(f"page error: {error}"))
        page.on("request", lambda request: note(request.url, url))
        page.goto(url)
        return page

    def note(requested, url):
        if requested.partition("#")[0] != url and not requested.startswith(("data:", "blob:")):
            trouble.append(f"request: {requested}")

    yield open_page
    for context in contexts:
        context.close()
    assert trouble == []


@pytest.fixture
def visit(opened, report):
    def open_report(width_px, scheme="light"):
        page = opened(report, width_px, scheme)
        page.wait_for_selector("#trajectory-plot .main-svg")
        return page

    return open_report


def width_of(page):
    return page.evaluate("document.documentElement.scrollWidth")


def first_cells(page, table, column):
    """Texts of a column of the rows that are shown."""
    rows = page.locator(f"#{table} tbody tr:visible:not(.group)")
    return [row.locator("th, td").nth(column).inner_text().split("\n")[0] for row in rows.all()]


@pytest.mark.parametrize(("width_px", "scheme"), [(390, "light"), (1440, "dark")])
def test_every_plot_is_there_and_nothing_scrolls_sideways(visit, width_px, scheme):
    page = visit(width_px, scheme)
    for plot in PLOTS:
        drawn = page.evaluate("id => document.querySelectorAll(`#${id} svg.main-svg path`).length", plot)
        assert drawn > 10, plot
        box = page.locator(f"#{plot} svg.main-svg").first.bounding_box()
        assert box["width"] > 250, plot
        assert box["height"] > 150, plot
        assert box["x"] >= 0, plot
        assert box["x"] + box["width"] <= width_px, plot
    assert page.evaluate("document.documentElement.scrollWidth") <= width_px
    first, second = (page.locator(f"#{plot}").bounding_box() for plot in PLOTS[:2])
    beside = first["x"] + first["width"] <= second["x"] and first["y"] == second["y"]
    below = first["y"] + first["height"] <= second["y"] and first["x"] == second["x"]
    assert below if width_px < 600 else beside


def test_the_choice_decides_what_the_trajectories_show(visit):
    page = visit(1440)
    assert page.locator("#policy").input_value() == "stochastic"
    assert page.locator("#other").input_value() == "certainty_equivalent"
    page.select_option("#concept", "phev")
    page.select_option("#policy", "rule_based")
    page.select_option("#realization", index=2)
    assert page.locator("#trajectory-title").inner_text() == "PHEV, μ = 0.006, rule-based, realization 3 of 3"
    lowest = page.evaluate(
        "Math.min(...document.getElementById('trajectory-plot').data"
        ".find(trace => trace.name === 'true, rule-based').y)"
    )
    assert 20.0 < lowest < 40.0, "the synthetic PHEV ends near 28 %"
    page.select_option("#other", label="nothing")
    names = page.evaluate("document.getElementById('trajectory-plot').data.map(t => t.name)")
    assert "true, stochastic" not in names
    assert "true, rule-based" in names


def test_colours_follow_the_ground_and_paper_is_white(visit):
    page = visit(1440, "dark")
    color = "document.getElementById('cost-plots-0').data[0].marker.color[0]"
    assert page.evaluate(color) == "#56B4E9"
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(color) == "#0072B2"
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(color) == "#56B4E9"
    page.emulate_media(color_scheme="light")
    # The page's own policy forbids eval, which waiting for a function would need.
    assert (
        page.evaluate(
            "async () => {"
            f"for (let k = 0; k < 100 && {color} !== '#0072B2'; k += 1)"
            "await new Promise(done => setTimeout(done, 50));"
            f"return {color}}}"
        )
        == "#0072B2"
    )


def test_cases_are_sorted_filtered_and_put_back(visit):
    page = visit(1440)
    before = first_cells(page, "case-table", 0)
    head = page.get_by_role("region", name="All cases").get_by_role("button", name="Realised cost")
    head.click()
    costs = [float(text.split()[0]) for text in first_cells(page, "case-table", 1)]
    assert costs == sorted(costs)
    assert page.locator("#case-table tr.group:visible").count() == 0
    assert page.locator("#case-table .where:visible").count() == len(before), "a row says where it is from"
    head.click()
    assert [float(text.split()[0]) for text in first_cells(page, "case-table", 1)] == sorted(
        costs, reverse=True
    )
    head.click()
    assert first_cells(page, "case-table", 0) == before
    page.fill("input[data-filter=case-table]", "PHEV rule")
    assert first_cells(page, "case-table", 0) == ["rule-based", "rule-based"]
    assert page.locator("#case-table-count").inner_text() == "2 of 16"
    assert page.locator("#case-table tr.group:visible").count() == 2


@pytest.mark.parametrize(
    ("name", "widths", "scheme"), [("grid", (390, 1440), "dark"), ("samples", (1440, 390), "light")]
)
def test_a_study_is_drawn_and_nothing_scrolls_sideways(opened, studies, name, widths, scheme):
    page = opened(studies[name], widths[0], scheme)
    for width_px in widths:
        page.set_viewport_size({"width": width_px, "height": 900})
        for plot in ("map-plot", "profile-plot"):
            page.wait_for_selector(f"#{plot} .main-svg")
            fits = (
                f"async () => {{ const svg = document.querySelector('#{plot} svg.main-svg');"
                f"const edge = () => svg.getBoundingClientRect().right;"
                f"for (let k = 0; k < 100 && (edge() > {width_px} || edge() < 0.8 * {width_px}); k += 1)"
                "await new Promise(done => setTimeout(done, 50)); return edge() }"
            )
            assert 0.8 * width_px < page.evaluate(fits) <= width_px, plot
            box = page.locator(f"#{plot} svg.main-svg").first.bounding_box()
            assert box["x"] >= 0 and box["height"] > 150, plot
        assert width_of(page) <= width_px
    kinds = page.evaluate("document.getElementById('map-plot').data.map(trace => trace.type)")
    assert ("heatmap" in kinds) == (name == "grid")


def test_the_choice_decides_what_a_study_shows_also_on_paper(opened, studies):
    page = opened(studies["grid"], 718)
    page.wait_for_selector("#map-plot .main-svg")
    assert page.locator("#map-title").inner_text() == "Loss of certainty equivalence, 16 cases"
    chosen = {page.locator(f"#{axis} option:checked").inner_text() for axis in ("map-x", "map-y")}
    assert chosen == {"penalty steepness", "window width"}
    page.select_option("#facet-0", label="HEV")
    assert page.locator("#map-title").inner_text() == "Loss of certainty equivalence, 7 cases"
    assert page.locator("#study-cases-count").inner_text() == "9 of 18"
    assert set(first_cells(page, "study-cases", 1)) == {"HEV"}
    like_zero = sum("like zero" in text for text in first_cells(page, "study-cases", 6))
    crossed = "document.getElementById('map-plot').data[1].x.length"
    assert page.evaluate(crossed) == like_zero > 0, "with one concept a cell is a case"
    page.select_option("#what", label="more fuel with certainty equivalence")
    shown = "document.getElementById('profile-plot').data[0].y"
    assert page.evaluate(shown) == pytest.approx([0.25] * 7)
    page.select_option("#map-y", label="concept")
    page.select_option("#map-x", label="concept")
    assert page.locator("#map-y").input_value() != page.locator("#map-x").input_value()
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("select:visible, input:visible").count() == 0
    for region in page.get_by_role("region").all():
        assert region.evaluate("one => one.scrollHeight - one.clientHeight") <= 1
    assert width_of(page) <= 718


@pytest.mark.parametrize("width_px", [390, 1440])
def test_the_gallery_fits_and_its_contents_lead_to_its_items(opened, gallery, width_px):
    page = opened(gallery, width_px)
    assert width_of(page) <= width_px
    for image in page.locator("article img").all():
        assert image.evaluate("one => one.naturalWidth") > 300
        assert image.bounding_box()["width"] <= width_px
    page.get_by_role("link", name="Fig 34").click()
    assert page.evaluate("location.hash") == "#mautc-fig34"
    assert page.locator("h3#mautc-fig34").bounding_box()["y"] < 900
    button = page.get_by_role("region", name="Rows of larsson-table1").get_by_role("button", name="Ours")
    button.click()
    ours = page.locator("[aria-label='Rows of larsson-table1'] tbody tr td:nth-child(3)")
    values = [float(cell.get_attribute("data-v")) for cell in ours.all() if cell.get_attribute("data-v")]
    assert values == sorted(values)
    assert page.get_by_text("larsson-fig3").count() == 1
