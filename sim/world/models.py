"""The folder of the embedded models."""

from __future__ import annotations

from pathlib import Path

_SIM_DIR = Path(__file__).resolve().parents[1]
_PLACES = (_SIM_DIR / "_models", _SIM_DIR.parent / "models")
MODELS_DIR = next((folder for folder in _PLACES if folder.is_dir()), _PLACES[-1])
"""The project's MJCF files and meshes: inside `sim` where a wheel was installed, beside it in a checkout."""
