"""`eskin demo`: an arm at work in its skin, in the browser or headless."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from eskin.errors import DeviceError

if TYPE_CHECKING:
    from eskin.demo import DemoConfig

HEADLESS_SECONDS = 60.0


@dataclass(frozen=True)
class Command:
    """Watch a simulated UR5 bring parts, and command it by touch.

    In the browser the mouse is the hand: a click is a poke. Poke to pause and to go on,
    pat twice for the next waypoint, grab for the gripper, stroke to slow down.
    """

    headless: bool = False
    """No page: people who were in no training set touch the arm by a script, as fast as
    the computer can; with --json how many were rightly obeyed."""

    seconds: float | None = None
    """How long; without end in the browser, one minute of simulated time headless."""

    seed: int = 0
    """Decides sensor builds, people and what they do."""

    port: int = 8080
    """Of the page on this computer; 0 for any free one."""

    skin: str = "ur5"
    """A skin that comes with eskin and fits the UR5."""

    build: Literal["fresh", "shifted"] = "fresh"
    """Sensors as in training, or aged ones."""

    model: str = "ur5"
    """Weights that come with eskin, or a model file."""

    commands: Path | None = None
    """Which touch commands what, such as `examples/jog.yaml`; the map that comes with
    eskin unless given."""


def run(command: Command) -> dict[str, object]:
    """Demonstrate, and return what came of it."""
    from eskin.demo import DemoConfig

    if command.seconds is not None and not 0 < command.seconds < float("inf"):
        raise DeviceError(
            f"--seconds is {command.seconds}; allowed are above 0; change it"
        )
    config = DemoConfig(
        command.skin, command.model, command.commands, command.build, seed=command.seed
    )
    if command.headless:
        return headless(command.seconds or HEADLESS_SECONDS, config)
    return in_browser(command, config)


def headless(seconds: float, config: "DemoConfig") -> dict[str, object]:
    """Scripted touches."""
    from eskin.demo import run_headless
    from eskin.demo.visitor import summary_of

    outcome = run_headless(seconds, config)
    counts = dict(summary_of(outcome.score))
    print(
        f"{counts['touches']} touches in {outcome.seconds:g} s on {config.build_kind} "
        f"builds: {counts['correct']} obeyed rightly, {counts['wrong']} wrongly, "
        f"{counts['missed']} missed; {outcome.accidents} accidental contacts, "
        f"{counts['false_alarms']} commands that nobody gave; {outcome.score.holds} "
        f"holds, {outcome.delivered} parts brought"
    )
    print(
        f"from the end of a touch to its command: p50 {outcome.delay[0]:.2f} s, p95 "
        f"{outcome.delay[1]:.2f} s"
    )
    return {
        **counts,
        "step_ms_p50": outcome.step[0],
        "step_ms_p99": outcome.step[1],
        "delay_s_p50": outcome.delay[0],
        "delay_s_p95": outcome.delay[1],
        "accidents": outcome.accidents,
        "holds": outcome.score.holds,
        "delivered": outcome.delivered,
        "seconds": outcome.seconds,
    }


def in_browser(command: Command, config: "DemoConfig") -> dict[str, object]:
    """A page, until it is over."""
    from eskin.demo.browser import serve

    served = serve(config, command.port, command.seconds, tell)
    print(f"{served.readings} readings, {served.commands} commands")
    return {
        "touches": served.detections,
        "correct": None,
        "wrong": None,
        "missed": None,
        "false_alarms": None,
        "commands": served.commands,
        "step_ms_p50": served.step[0],
        "step_ms_p99": served.step[1],
    }


def tell(line: str) -> None:
    """Print at once."""
    print(line, flush=True)
