"""Stub."""

from typing import Any

PLANNERS, SENSORS, MAPS = "planner", "sensor", "map"


def is_plug(text, kind):
    return ":" in text


def load_plug(text, kind):
    import importlib

    m, _, a = text.partition(":")
    return getattr(importlib.import_module(m), a)


def make_plug(text, kind, options):
    return load_plug(text, kind)(**options)


def parse_plug_options(words):
    return dict(w.split("=") for w in words)
