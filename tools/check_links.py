"""Check the internal links of built pages: `python tools/check_links.py docs/_build/html`.

Every one of them has to lead somewhere. Files, pages and anchors are looked for; addresses of the web are
not, so no network is needed.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

ATTRIBUTES = ("href", "src")


class Links(HTMLParser):
    """Collects where a page leads to, and the anchors that it has."""

    def __init__(self) -> None:
        """Start empty."""
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take the links and anchors of one element."""
        for name, value in attrs:
            if name == "id" or (name == "name" and tag == "a"):
                self.anchors.add(value or "")
            elif name in ATTRIBUTES and value:
                self.targets.add(value)


def read(path: Path) -> Links:
    """Read one page."""
    links = Links()
    links.feed(path.read_text(encoding="utf-8"))
    return links


def broken_links(root: Path) -> list[str]:
    """List what leads nowhere, as `page: target`.

    Parameters
    ----------
    root : Path
        Folder of the built pages.
    """
    pages = {path.resolve(): read(path) for path in sorted(root.rglob("*.html"))}
    found = []
    for path, links in pages.items():
        for target in sorted(links.targets):
            address, anchor = urldefrag(target)
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if file.is_dir():
                file /= "index.html"
            known = pages[file].anchors if file in pages else None
            if not file.is_file() or (anchor and known is not None and unquote(anchor) not in known):
                found.append(f"{path.relative_to(root.resolve()).as_posix()}: {target}")
    return found


def main(arguments: list[str]) -> int:
    """Check a folder; exit code 1 if something leads nowhere or there is no page."""
    root = Path(arguments[0] if arguments else "docs/_build/html")
    pages = len(list(root.rglob("*.html")))
    found = broken_links(root)
    for line in found:
        print(line)
    print(f"{pages} pages, {len(found)} broken internal links")
    return 1 if found or not pages else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
