"""One HTML page that answers the question, shows the evidence, and needs nothing but a browser."""

from socwise.report.anything import render_any
from socwise.report.page import write_report
from socwise.report.study_page import write_study_report

__all__ = ["render_any", "write_report", "write_study_report"]
