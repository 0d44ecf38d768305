"""`sounding controller`: a simulated arm with its controller, for `sounding serve` to drive."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from sim.cli.terminal import INTERRUPTED, parse
from sim.errors import FieldError
from sim.live.address import ARM_PORT

EXAMPLES = """
sounding controller
sounding controller --delay-ms 20 --jitter-ms 10 --lost 0.05
sounding controller --arm ur5e --error-mrad 1
"""
"""What the help begins with."""
MS, MRAD = 1e-3, 1e-3


@dataclass(frozen=True, kw_only=True)
class Options:
    """Simulate an arm with a controller in a process of its own, which `sounding serve` drives over TCP.

    It stands at home, follows the paths that it is sent, refuses those that pass a limit, and comes to rest within 100
    ms of the last word that it heard. What it noted is told at the end: how far and how fast its joints went, and how
    long it moved without hearing anybody.
    """

    arm: str = "default"
    """Arm: default (the embedded one), ur5e (with the extra `arms`), or the path of a file."""
    flange: str | None = None
    """Site or body of the arm that carries the probe, as in `sounding episode`."""
    host: str = "127.0.0.1"
    """Address to listen at; the default hears nobody but this machine."""
    port: int = ARM_PORT
    """Port to listen at; 0 takes any that is free."""
    delay_ms: float = 0.0
    """Every message comes so much later, either way [ms]."""
    jitter_ms: float = 0.0
    """And up to so much more, by chance [ms]."""
    lost: float = 0.0
    """Share of messages that never come, below 1."""
    error_mrad: float = 0.0
    """Largest error of a joint at the end of a path [mrad, of a slide mm]; each joint has one of its own."""
    seed: int = 0
    """Seed of what is lost and late, and of the joints' errors."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0 <= self.port <= 65_535:
            raise FieldError("port", self.port, "must be from 0 to 65535.")
        for name in ("delay_ms", "jitter_ms"):
            if not 0.0 <= getattr(self, name) <= 10_000.0:
                raise FieldError(name, getattr(self, name), "must be from 0 to 10000.")
        if not 0.0 <= self.lost < 1.0:
            raise FieldError("lost", self.lost, "must be 0 or more, and below 1.")
        if not 0.0 <= self.error_mrad <= 100.0:
            raise FieldError("error_mrad", self.error_mrad, "must be from 0 to 100.")
        if self.seed < 0:
            raise FieldError("seed", self.seed, "must be 0 or more.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Simulate until Ctrl-C, and return the exit code."""
    from sim.live.arm.file_arm import simulated_arm
    from sim.live.arm.simulated_server import Impairment, SimulatedServer
    from sim.world.scene.named_arms import named_arm

    arm = simulated_arm(
        named_arm(options.arm, options.flange), error=options.error_mrad * MRAD, seed=options.seed
    )
    impairment = Impairment(delay_s=options.delay_ms * MS, jitter_s=options.jitter_ms * MS, lost=options.lost)
    with SimulatedServer(
        arm,
        host=options.host,
        port=options.port,
        impairment=impairment,
        seed=options.seed,
    ) as server:
        print(f"listening at arm://{options.host}:{server.port}, at home", flush=True)
        try:
            server.run(threading.Event())
        except KeyboardInterrupt:
            noted = arm.record
            print(
                f"sounding: ended. It came to rest on the way {noted['n_stops']} times, and moved at most "
                f"{1e3 * noted['longest_unheard_s']:.0f} ms without hearing anybody.",
                file=sys.stderr,
            )
            return INTERRUPTED
    return 0
