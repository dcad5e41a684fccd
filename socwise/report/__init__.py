"""One HTML page that answers the question, shows the evidence, and needs nothing but a browser."""

from socwise.report.page import write_report

__all__ = ["write_report"]
