"""What every page is made of: templates with slots, and text and data that no parser takes for markup."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources

_SLOT = re.compile(r"@@([A-Z_]+)@@")


def template(name: str) -> str:
    """Return a template that travels with the package, by file name."""
    return (resources.files("socwise.report") / "templates" / name).read_text(encoding="utf-8")


def fill(text: str, values: Mapping[str, str]) -> str:
    """Put values into the slots ``@@NAME@@`` of a template.

    One pass: what is put in is not searched for slots again, whatever a user called a concept.
    """
    return _SLOT.sub(lambda slot: values[slot[1]], text)


def paragraph(sentences: Sequence[str]) -> str:
    """Return plain sentences as a paragraph, the first of them bold."""
    lead, *rest = (unbroken(escape(sentence)) for sentence in sentences)
    return f"<p><strong>{lead}</strong> {' '.join(rest)}</p>"


def unbroken(text: str) -> str:
    """Keep a number and its sign or unit on one line."""
    return text.replace("μ = ", "μ\u00a0=\u00a0").replace(" %", "\u00a0%")


def region(label: str, content: str, classes: str = "scroll") -> str:
    """Return content that may be wider than the page, scrollable by itself and by keyboard."""
    return f'<div class="{classes}" tabindex="0" role="region" aria-label="{escape(label)}">{content}</div>'


def json_in_html(value: object) -> str:
    """Return JSON that no HTML parser can mistake for the end of its element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def script(source: str) -> str:
    """Return JavaScript that cannot end its element."""
    return re.sub(r"</(script)", r"<\\/\1", source, flags=re.IGNORECASE)
