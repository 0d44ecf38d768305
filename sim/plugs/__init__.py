"""Plugs: planners, sensors and maps that users bring along, named by a text.

The text is `package.module:Class`, or the name under which an installed package offers its class: an entry point of
the group `sounding.planners`, `sounding.sensors` or `sounding.maps`. The module is found as Python finds modules, or
in the current folder. Whoever runs trials on other machines installs the module there.

A text that leads nowhere, a module that cannot be imported and a class that cannot be made are errors of use, with
the remedy in their text. Loading a plug needs no MuJoCo, unless the plug's own module does.
"""

from .errors import PlugError
from .kinds import MAP, PLANNER, SENSOR, PlugKind
from .loading import is_plug, load_plug, make_plug, plug_names
from .options import parse_plug_options

__all__ = [
    "MAP",
    "PLANNER",
    "SENSOR",
    "PlugError",
    "PlugKind",
    "is_plug",
    "load_plug",
    "make_plug",
    "parse_plug_options",
    "plug_names",
]
