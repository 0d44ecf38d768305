"""The flange: the site of an arm that carries the probe, or the frame of one of its bodies."""

from __future__ import annotations

from pathlib import Path

import mujoco

from .errors import ArmError

FLANGE_SITES = ("flange", "attachment_site")
"""Names under which robot models keep the site that carries a tool; the first one found is used."""
FLANGE_BODIES = ("tool0", "flange")
"""Names of bodies that are taken where there is none of these sites, as in URDF, which has no sites. The first one has
its z axis out of the arm by convention."""
MAX_LISTED = 12
"""Most names that a message lists."""


def find_flange(spec: mujoco.MjSpec, path: Path, flange: str | None) -> tuple[mujoco.MjsSite, str]:
    """The site that carries the probe, and what to call it in messages.

    Where a body is meant, it gets a site at its frame.

    Args:
        spec: The arm, all bodies of which have names.
        path: Its file.
        flange: The name of a site or body; a site of that name comes first. None for the usual ones.

    Raises:
        ArmError: There is no such site or body.
    """
    sites = {site.name: site for site in spec.sites if site.name}
    bodies = {body.name: body for body in spec.bodies}
    for name in FLANGE_SITES if flange is None else (flange,):
        if name in sites:
            return sites[name], f"the site {name}"
    for name in FLANGE_BODIES if flange is None else (flange,):
        if name in bodies:
            taken = name
            while taken in sites:
                taken += "_"
            return bodies[name].add_site(name=taken), f"the body {name}"
    wanted = dict.fromkeys((*FLANGE_SITES, *FLANGE_BODIES)) if flange is None else (flange,)
    raise ArmError(
        f"{path}: no site or body named {' or '.join(map(repr, wanted))} to carry the probe (sites: "
        f"{_listed(list(sites))}; bodies: {_listed(list(bodies)[1:])}). Name one with `flange`, or add a <site> to the "
        "last link."
    )


def _listed(names: list[str]) -> str:
    more = len(names) - MAX_LISTED
    # The last links stand last, and one of them is meant.
    return (f"{more} more, " if more > 0 else "") + (", ".join(names[-MAX_LISTED:]) or "none")
