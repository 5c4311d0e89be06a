"""The engineering report of a recorded run: one HTML page that needs nothing else."""

from warpchain.view.report.run_report import report, run_report_html

__all__ = ["report", "run_report_html"]
