"""The report in a real browser: nothing fails, every plot is there, and it fits a phone and a desk."""

import os
import shutil

import pytest
from synthetic import POLICIES, make_comparison, store_without_figures

from socwise.report import write_report

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


@pytest.fixture
def visit(browser, report):
    """Open the report; whatever goes wrong in it until the end of the test fails the test."""
    trouble, contexts = [], []

    def open_page(width_px, scheme="light"):
        context = browser.new_context(viewport={"width": width_px, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: trouble.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: trouble.append(f"page error: {error}"))
        page.on("request", lambda request: _note_request(request.url))
        page.goto(report)
        page.wait_for_selector("#trajectory-plot .main-svg")
        return page

    def _note_request(url):
        if url != report and not url.startswith(("data:", "blob:")):
            trouble.append(f"request: {url}")

    yield open_page
    for context in contexts:
        context.close()
    assert trouble == []


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
