"""Packages that not everybody needs: they are imported on first use, and the error names the extra to install."""

import importlib
from types import ModuleType

from .errors import MissingPackageError


def optional_module(module: str, package: str, extra: str, purpose: str) -> ModuleType:
    """An optional module.

    Args:
        module: Its dotted name.
        package: The package that holds it.
        extra: The extra of Sounding that installs it.
        purpose: What needs it, as the subject of a sentence.

    Raises:
        MissingPackageError: It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(
            f"{purpose} needs {package}, which is not installed; run: pip install 'sounding[{extra}]'"
        ) from error
