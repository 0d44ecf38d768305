"""Packages that not everybody needs: they are imported on first use, and the error names the command to run."""

import importlib
from types import ModuleType

from sim.extras import missing_text

from .errors import MissingPackageError


def optional_module(module: str, extra: str, purpose: str) -> ModuleType:
    """An optional module.

    Args:
        module: Its dotted name.
        extra: The extra of Sounding that installs it, a name of `sim.extras.EXTRAS`.
        purpose: What needs it, as the subject of a sentence.

    Raises:
        MissingPackageError: It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(missing_text(extra, purpose)) from error
