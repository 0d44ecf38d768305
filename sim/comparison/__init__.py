"""Campaigns side by side: groups of trials, estimates with intervals, tables, figures and a page."""
