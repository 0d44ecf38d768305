# MuJoCo ships no type stubs and its names come from compiled modules that a type checker cannot see into, so all of
# them are Any here.
from typing import Any

def __getattr__(name: str) -> Any: ...
