"""The report: one self-contained page per run, and one per comparison of campaigns."""

from .campaign_page import write_campaign_report
from .page import write_report

__all__ = ["write_campaign_report", "write_report"]
