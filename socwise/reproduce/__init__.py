"""Every table and figure of the sources, reproduced: published and own values side by side."""

from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import ids, run, title

__all__ = ["Reproduction", "Row", "ids", "run", "title"]
