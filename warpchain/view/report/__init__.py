"""A recorded run as one HTML page that needs nothing else: what engineers hand in."""

from warpchain.view.report.write import report, report_html

__all__ = ["report", "report_html"]
