"""The engineering report of a recorded run: one HTML page that needs nothing else."""

from warpchain.view.report.run_sections import report, report_html

__all__ = ["report", "report_html"]
