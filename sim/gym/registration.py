"""The names under which Gymnasium makes the environments."""

from __future__ import annotations

from sim.world.optional import optional_module

gymnasium = optional_module("gymnasium", "gym", "`sim.gym`")

ENVIRONMENTS = {
    f"Sounding/{scenario}-v0": scenario for scenario in ("liver", "sphere", "spheres", "generated-liver")
}
"""The scenario of each environment, by its name."""


def register_environments() -> None:
    """Make the names known to `gymnasium.make`; those that are known already stay as they are."""
    for name, scenario in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name, entry_point="sim.gym.environment:SoundingEnv", kwargs={"scenario": scenario}
            )


# As for every package of environments, the import is what registers: `gymnasium.make("sim.gym:Sounding/liver-v0")`.
register_environments()
