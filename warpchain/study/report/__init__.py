"""Reports of studies as HTML pages, and scenes of studies in Rerun."""

from warpchain.study.report.study_page import (
    study_report_html,
    telling_metrics,
    write_report,
)

__all__ = [
    "study_report_html",
    "telling_metrics",
    "write_report",
]
