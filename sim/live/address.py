"""Addresses at which transports listen, as people type them."""

from __future__ import annotations

import re

from sim.errors import FieldError

_ADDRESS = re.compile(r"(?P<kind>\w+)://(?P<host>[\w.-]+|\[[0-9a-fA-F:]+\])(:(?P<port>\d{1,5}))?/?")
IGTL_PORT = 18944
"""OpenIGTLink's own port."""
ROS_PORT = 9090
"""The usual port of a rosbridge."""
ARM_PORT = 18950
"""Where a controller of an arm listens unless it says otherwise."""


def igtl_address(text: str, field: str) -> tuple[str, int]:
    """The host and the port of an address.

    Args:
        text: Such as `igtl://127.0.0.1:18944`.
        field: The field that it is the value of, for the error.

    Raises:
        FieldError: It is no such address.
    """
    return _address(text, field, "igtl", IGTL_PORT)


def arm_address(text: str, field: str) -> tuple[str, int]:
    """The host and the port of an arm's controller.

    Args:
        text: Such as `arm://127.0.0.1:18950`.
        field: The field that it is the value of, for the error.

    Raises:
        FieldError: It is no such address.
    """
    return _address(text, field, "arm", ARM_PORT)


def ros_address(text: str, field: str) -> tuple[str, int]:
    """The host and the port of a rosbridge.

    Args:
        text: Such as `ws://127.0.0.1:9090`.
        field: The field that it is the value of, for the error.

    Raises:
        FieldError: It is no such address.
    """
    return _address(text, field, "ws", ROS_PORT)


def live_address(text: str, field: str) -> tuple[str, str, int]:
    """The kind (`igtl` or `ws`), host and port of where a run is shown.

    Args:
        text: Such as `igtl://127.0.0.1:18944` or `ws://127.0.0.1:9090`.
        field: The field that it is the value of, for the error.

    Raises:
        FieldError: It is no such address.
    """
    kind = "ws" if text.startswith("ws:") else "igtl"
    read = ros_address if kind == "ws" else igtl_address
    return kind, *read(text, field)


def _address(text: str, field: str, kind: str, usual_port: int) -> tuple[str, int]:
    found = _ADDRESS.fullmatch(text)
    port = int(found["port"] or usual_port) if found else -1
    if found is None or found["kind"] != kind or not 0 <= port <= 65_535:
        raise FieldError(field, text, f"must be an address such as {kind}://127.0.0.1:{usual_port}.")
    return found["host"].strip("[]"), port
