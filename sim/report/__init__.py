"""The report: one self-contained page per run."""

from .page import write_report

__all__ = ["write_report"]
