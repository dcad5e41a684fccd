"""The gallery: every reproduced table and figure on one page and in one CSV, published beside ours."""

from socwise.gallery.collect import collect
from socwise.gallery.entry import Entry
from socwise.gallery.write import CSV, PAGE, write_gallery

__all__ = ["CSV", "PAGE", "Entry", "collect", "write_gallery"]
