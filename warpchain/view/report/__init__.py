"""The engineering report of a recorded run as one HTML page."""

from warpchain.view.report.run_report import report, run_report_html

__all__ = ["report", "run_report_html"]
