"""Findings: what a map made of each tumour, as records, tables and surfaces."""
