"""Configuration of the documentation: `make docs`."""

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project = "socwise"
author = "The socwise developers"
copyright = author
try:
    release = metadata.version("socwise")
except metadata.PackageNotFoundError:
    release = "source tree"
version = release

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"exclude-members": "model_config, model_post_init"}

html_theme = "furo"
html_title = "socwise"
html_show_sphinx = False


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
    """Connect the hook above."""
    app.connect("autodoc-process-docstring", list_fields)


# A Road is one thing to traffic and another to a suspension; a reference within a room means the room's own.
suppress_warnings = ["ref.python"]
