"""A fit told in words and tables: on a terminal, and as a report that reads by itself."""

from calibration.report.markdown import markdown_report
from calibration.report.page import html_report
from calibration.report.terminal import terminal_report

__all__ = ["html_report", "markdown_report", "terminal_report"]
