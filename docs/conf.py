"""Configuration of the documentation: `make docs`."""

import re
import sys
from html import escape
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from docutils.nodes import SkipNode
from myst_parser.parsers.sphinx_ import MystParser

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project = "socwise"
author = "The socwise developers"
copyright = author
try:
    release = metadata.version("socwise")
except metadata.PackageNotFoundError:
    release = "source tree"
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
# Formulas become MathML here, so that pages need neither a network nor a script to show them.
MATHML = find_spec("latex2mathml") is not None
if MATHML:
    html_math_renderer = "mathml"
else:
    extensions.append("sphinx.ext.mathjax")
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "conf.py", "images"]

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"exclude-members": "model_config, model_post_init"}

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = "socwise"
html_show_sphinx = False


class ScriptParser(MystParser):
    """Reads a script of `# %%` cells: comments of the markdown cells are text, everything else is code."""

    supported = ("script",)

    def parse(self, inputstring, document):
        """Turn the cells into a page."""
        parts = []
        for cell in inputstring.split("# %%")[1:]:
            kind, _, body = cell.partition("\n")
            if kind.strip() == "[markdown]":
                parts.append(
                    "\n".join(line.removeprefix("#").removeprefix(" ") for line in body.splitlines())
                )
            else:
                parts.append(f"```{{code-block}} python\n{body.strip()}\n```\n")
        super().parse("\n".join(parts), document)


def _mathml(latex, display):
    """Convert a formula, put in words that the converter knows and browsers show upright and aligned."""
    from latex2mathml.converter import convert

    latex = re.sub(r"\\mathrm\{(\w+)\}", r"\\text{\1}", latex).replace("{aligned}", "{align*}")
    latex = re.sub(r"\\[bB]igg?[lr]?(?=\\[{}])", "", latex)
    if "\\begin{" not in latex and ("&" in latex or "\\\\" in latex):
        latex = f"\\begin{{align*}}{latex}\\end{{align*}}"
    return re.sub(r'columnalign="(\w+)"', r'style="text-align: \1"', convert(latex, display=display))


def inline_formula(writer, node):
    """Write a formula within a line."""
    writer.body.append(f'<span class="formula" title="{escape(node.astext())}">')
    writer.body.append(_mathml(node.astext(), "inline") + "</span>")
    raise SkipNode


def block_formula(writer, node):
    """Write a formula on lines of its own."""
    writer.body.append(f'<div class="formula">{_mathml(node.astext(), "block")}</div>')
    raise SkipNode


def list_fields(app, what, name, thing, options, lines):
    """Add what a parameter model's fields mean, which stands in the model and not in its docstring."""
    if what != "class" or not hasattr(thing, "model_fields"):
        return
    inherited = {field for base in thing.__bases__ for field in getattr(base, "model_fields", {})}
    lines.append("")
    for field, about in thing.model_fields.items():
        if field in inherited or not about.description:
            continue
        plain = about.description.replace("|", r"\|").replace("*", r"\*")
        has_plain_default = isinstance(about.default, bool | int | float | str | tuple)
        default = f" (default: ``{about.default!r}``)" if has_plain_default else ""
        lines.append(f":param {field}: {plain}{default}")
    lines.append("")


def setup(app):
    """Connect what stands above."""
    app.add_source_suffix(".py", "script")
    app.add_source_parser(ScriptParser)
    if MATHML:
        app.add_html_math_renderer("mathml", (inline_formula, None), (block_formula, None))
    app.connect("autodoc-process-docstring", list_fields)


# A Road is one thing to traffic and another to a suspension; a reference within a room means the room's own.
suppress_warnings = ["ref.python"]

# Shapes and words in the types of docstrings ("ndarray, shape (n,)") name no class that could be found.
nitpicky = True
nitpick_ignore_regex = [("py:(class|exc)", ".*")]
