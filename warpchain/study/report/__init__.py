"""Studies as pages, and as scenes in Rerun."""

from warpchain.study.report.study_sections import (
    report_html,
    telling_metrics,
    write_report,
)

__all__ = [
    "report_html",
    "telling_metrics",
    "write_report",
]
