"""Addresses at which transports listen, as people type them."""

from __future__ import annotations

import re

from sim.errors import FieldError

_IGTL = re.compile(r"igtl://(?P<host>[\w.-]+|\[[0-9a-fA-F:]+\])(:(?P<port>\d{1,5}))?/?")
IGTL_PORT = 18944
"""OpenIGTLink's own port."""


def igtl_address(text: str, field: str) -> tuple[str, int]:
    """The host and the port of an address.

    Args:
        text: Such as `igtl://127.0.0.1:18944`.
        field: The field that it is the value of, for the error.

    Raises:
        FieldError: It is no such address.
    """
    found = _IGTL.fullmatch(text)
    port = int(found["port"] or IGTL_PORT) if found else -1
    if found is None or not 0 <= port <= 65_535:
        raise FieldError(field, text, "must be an address such as igtl://127.0.0.1:18944.")
    return found["host"].strip("[]"), port
