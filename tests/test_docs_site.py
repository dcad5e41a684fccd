"""The documentation as a site: links lead somewhere, every page is in the menu, and it fits a phone."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import DOCS, FENCE, ROOT, page_names, source
from test_report_browser import browser  # noqa: F401

sys.path.insert(0, str(ROOT / "tools"))

from check_links import broken_links, main

LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
IMAGE = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
LABEL = re.compile(r"^\(([\w-]+)\)=$", re.MULTILINE)
HEADING = re.compile(r"^#{1,3} (.+)$", re.MULTILINE)
PAGES = [name for name in page_names() if name != "README"]
BUILDERS = ("sphinx", "myst_parser", "furo", "latex2mathml")


def prose(name):
    """A page without its blocks of code."""
    return FENCE.sub("", source(name))


def slug(heading):
    """The anchor that a heading gets."""
    plain = re.sub(r"[`$*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def anchors(path):
    """Anchors of a page of the documentation."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    return {slug(heading) for heading in HEADING.findall(text)} | set(LABEL.findall(text))


@pytest.mark.parametrize("name", ["README", *PAGES])
def test_links_lead_somewhere(name):
    here = ROOT if name == "README" else (DOCS / name).parent
    text = prose(name)
    for image in IMAGE.findall(text):
        assert (here / image).is_file(), image
    for target in LINK.findall(text):
        address, _, anchor = target.partition("#")
        if "://" in address or address.startswith("mailto:"):
            continue
        file = (here / address).resolve() if address else DOCS / f"{name}.md"
        assert file.is_file() or (file.is_dir() and name == "README"), target
        if anchor:
            assert anchor in anchors(file), target


def test_every_page_is_in_the_menu():
    found = set()
    for name in PAGES:
        for body in re.findall(r"^```\{toctree\}\n(.*?)^```$", source(name), re.MULTILINE | re.DOTALL):
            found |= {line.strip() for line in body.splitlines() if line.strip() and line[0] != ":"}
    scripts = {f"examples/{path.stem}" for path in (DOCS / "examples").glob("*.py")}
    assert found == ({*PAGES} - {"index"}) | scripts


def test_the_link_check_finds_what_is_broken(tmp_path, capsys):
    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text(
        '<a id="top" href="sub/page.html#here">x</a><a href="#top">y</a><a href="https://elsewhere">z</a>'
        '<a href="mailto:nobody">m</a><img src="data:,">'
    )
    page = tmp_path / "sub" / "page.html"
    page.write_text('<h1 id="here"></h1><a href="../">up</a>')
    assert broken_links(tmp_path) == []
    assert main([str(tmp_path)]) == 0
    page.write_text(
        '<a href="../index.html#bottom">x</a><a href="gone.html">y</a><script src="a.js"></script>'
    )
    assert broken_links(tmp_path) == [
        "index.html: sub/page.html#here",
        "sub/page.html: ../index.html#bottom",
        "sub/page.html: a.js",
        "sub/page.html: gone.html",
    ]
    assert main([str(tmp_path)]) == 1
    assert "4 broken" in capsys.readouterr().out
    assert main([str(tmp_path / "sub" / "absent")]) == 1


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; warnings are errors."""
    lacking = [name for name in BUILDERS if importlib.util.find_spec(name) is None]
    if lacking:
        pytest.skip(f"building the site needs {', '.join(lacking)}: pip install -e '.[docs]'")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", DOCS, out]
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, env=os.environ
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.slow
def test_the_built_site_has_no_broken_links(site):
    assert len(list(site.rglob("*.html"))) > len(PAGES)
    assert broken_links(site) == []


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize("width_px", [390, 1440])
def test_pages_fit_and_say_nothing_to_the_console(site, browser, width_px):  # noqa: F811
    context = browser.new_context(viewport={"width": width_px, "height": 900})
    page, trouble = context.new_page(), []
    page.on("console", lambda message: trouble.append(f"console: {message.text}"))
    page.on("pageerror", lambda error: trouble.append(f"page error: {error}"))
    page.on("request", lambda request: _note_request(trouble, request.url))
    try:
        for path in sorted(Path(site).rglob("*.html")):
            if "_static" in path.parts:
                continue
            page.goto(path.as_uri())
            width = page.evaluate("document.documentElement.scrollWidth")
            assert width <= width_px, path.name
            assert trouble == [], path.name
    finally:
        context.close()


def _note_request(trouble, url):
    if not url.startswith(("file:", "data:", "blob:")):
        trouble.append(f"request: {url}")
