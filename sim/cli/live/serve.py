"""`sounding serve`: planner and map for a probe and a sensor that somebody else has, over OpenIGTLink."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sim.cli.terminal import INTERRUPTED, parse
from sim.errors import FieldError, UsageError
from sim.live.address import arm_address, ros_address
from sim.record.default_folders import default_folder, file_part
from sim.running.case import AnatomyConfig, CaseConfig
from sim.running.config import (
    CONE,
    EpisodeConfig,
    ExpectedImprovementConfig,
    FindAndOutlineConfig,
    MappingConfig,
    MountingConfig,
    MovingConfig,
    PlanningConfig,
    SensingConfig,
)
from sim.running.fields import episode_of
from sim.running.reader import ReaderConfig

EXAMPLES = """
sounding serve --organ liver.nii.gz --out renders/patient
sounding serve --simulate
sounding serve --simulate --simulated-speed 0 --steps 10
sounding serve --arm default --controller arm://127.0.0.1:18950 --simulate
sounding serve --organ liver.nii.gz --host 192.168.0.7 --port 18944
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Serve planner and map to a probe and a sensor outside, over OpenIGTLink (3D Slicer, PLUS; extra `igtl`).

    The outside says where the probe's tip is (TRANSFORM Tip) and what was sensed there (IMAGE Labels, or POINT Points),
    and gets the next pose, the map and what was decided. docs/live.md has the table of messages. All that is sensed is
    on the disk before what follows is told: the same command with the same `out` goes on, even after a kill.
    """

    scenario: str = "liver"
    """Scenario: sphere, spheres, liver, generated-liver, or the path of a scenario file (.toml)."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    planner: str = "find-and-outline"
    """What chooses the next pose, as in `sounding episode`."""
    sensor: str = CONE
    """What senses with `simulate`, as in `sounding episode`; cone-with-errors has the map doubt labels."""
    seed: int = 0
    """Seed of the planner, and of the tumours with `simulate`."""
    host: str = "127.0.0.1"
    """Address to listen at; the default hears nobody but this machine. Nothing is encrypted and nobody has to say who
    they are, so name another only in a network that you trust."""
    port: int = 18944
    """Port to listen at; 0 takes any that is free."""
    rate_hz: float = 30.0
    """How often the poses of the tip and of the proposal are sent [Hz], from 1 to 200."""
    stale_s: float = 2.0
    """Messages whose time stamp is this far from this machine's clock are refused [s]."""
    arm: str = "none"
    """Arm that carries the probe to what is proposed, as in `sounding episode`; it needs a `controller`."""
    controller: str | None = None
    """Where the controller of that arm listens, such as arm://127.0.0.1:18950: it is sent timed joint paths, and says
    where the arm really is. docs/arm-controller.md has its messages; `sounding controller` simulates one."""
    ros: str | None = None
    """Show and listen on topics of ROS too, by the rosbridge (extra `ros`) at ws://127.0.0.1:9090. docs/ros.md has the
    topics."""
    simulate: bool = False
    """Let a simulated probe and sensor take the place of the outside, for trying what listens."""
    simulated_speed: float = 1.0
    """How many times faster than a real probe the simulated one is; 0 jumps and does not wait."""
    steps: int | None = None
    """End after so many sensing actions; by default with Ctrl-C."""
    until_confident: float | None = None
    """Advise to end as soon as the planner is this confident that nothing is left, for example 0.95."""
    miss_cost: float | None = None
    """Advise to end as soon as going on is not worth it, where a missed lesion is worth this many actions."""
    out: Path | None = None
    """Folder of the session; one that holds the same session goes on. By default renders/serve-<scenario>-<seed>, with
    a number behind where that is taken."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    reading: ReaderConfig = field(default_factory=ReaderConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    find_and_outline: FindAndOutlineConfig = field(default_factory=FindAndOutlineConfig)
    expected_improvement: ExpectedImprovementConfig = field(default_factory=ExpectedImprovementConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    mounting: MountingConfig = field(default_factory=MountingConfig)
    moving: MovingConfig = field(default_factory=MovingConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0 <= self.port <= 65_535:
            raise FieldError("port", self.port, "must be from 0 to 65535.")
        if not 1.0 <= self.rate_hz <= 200.0:
            raise FieldError("rate_hz", self.rate_hz, "must be from 1 to 200.")
        if not 0.0 < self.stale_s <= 3600.0:
            raise FieldError("stale_s", self.stale_s, "must be above 0 and at most 3600.")
        if not 0.0 <= self.simulated_speed <= 1e6:
            raise FieldError("simulated_speed", self.simulated_speed, "must be from 0 to 1000000.")
        if self.steps is not None and self.steps < 1:
            raise FieldError("steps", self.steps, "must be 1 or more.")
        if self.planning.plan_for == "target":
            raise FieldError("plan_for", "target", "a session maps tumours alone. Leave it out.")
        if self.ros is not None:
            ros_address(self.ros, "ros")
        self._check_arm()

    def _check_arm(self) -> None:
        if self.controller is not None:
            arm_address(self.controller, "controller")
        if (self.arm == "none") != (self.controller is None):
            raise UsageError(
                f"`arm` {self.arm} and `controller` {self.controller or 'of nobody'} do not go together: an arm is "
                "moved by its `controller`, and without an arm there is nothing to drive. Give both or neither."
            )
        if self.moving.motion != "kinematic":
            raise FieldError(
                "motion", self.moving.motion, "a controller is sent timed paths (kinematic). Leave it out."
            )


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Serve, and return the exit code."""
    from sim.live.igtl.link import LinkSettings
    from sim.live.service import ServiceSettings
    from sim.running.live.serving import Serving, serve

    # A session ends where its planner says so, and has no largest number of actions.
    config = episode_of(options, steps=EpisodeConfig.steps)
    name = f"serve-{file_part(options.scenario)}-{options.seed}"
    serving = Serving(
        folder=options.out or default_folder(name, {}),
        link=LinkSettings(host=options.host, port=options.port, rate_hz=options.rate_hz),
        service=ServiceSettings(stale_s=options.stale_s),
        simulates=options.simulate,
        speed=options.simulated_speed,
        n_steps=options.steps,
        ros=None if options.ros is None else ros_address(options.ros, "ros"),
        controller=None if options.controller is None else arm_address(options.controller, "controller"),
    )
    try:
        serve(config, serving, tell=_tell)
    except KeyboardInterrupt:
        print(f"sounding: ended; what was sensed is kept in {serving.folder}.", file=sys.stderr)
        return INTERRUPTED
    return 0


def _tell(text: str) -> None:
    print(text, flush=True)
