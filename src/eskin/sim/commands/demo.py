"""`eskin demo` shows a working arm in its skin, in the browser or headless."""

import os
import sys
import webbrowser
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from eskin.cli.checks import POSITIVE
from eskin.errors import DeviceError
from eskin.registry import find_mujoco
from eskin.sim.commands.untouched import print_untouched
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.sim.demo import DemoConfig

HEADLESS_SECONDS = 60.0


@dataclass(frozen=True)
class DemoCommand:
    """Watch a simulated UR5 bring parts, and command it by touch.

    In the browser, the mouse is the hand, and a click is a poke. Poke or pat twice to
    pause. Grab to go on: to resume, for full speed, or for the next waypoint; then the
    arm asks, and a poke where you grabbed answers within a second. Stroke to slow down.
    """

    headless: bool = False
    """Run without a page: simulated people, who were in no training set, touch the arm
    as fast as the computer can compute it. With --json, the result tells how many
    touches were obeyed correctly."""

    seconds: Annotated[float | None, POSITIVE] = None
    """Duration [s]; by default without end in the browser, and one minute of simulated
    time headless."""

    seed: int = 0
    """Random seed of sensor builds, people and their touches."""

    port: int = 8080
    """TCP port of the page on this computer; 0 takes any free one."""

    skin: str = "ur5"
    """Name of a skin that comes with eskin and fits the UR5, or a skin's folder."""

    robot_urdf: str | None = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own. One other than the UR5 stands still in the page, and is not commanded."""

    build: Literal["flawless", "fresh", "shifted"] | None = None
    """Simulated sensors: without a defect, as in training with some dead or frozen
    taxels, or aged. Flawless in the page by default, `fresh` headless."""

    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""

    pause: tuple[float, float] = (0.6, 0.8)
    """Headless: shortest and longest time from one touch to the next [s]."""

    commands: Path | None = None
    """Command map, which tells what each touch commands: a file, such as
    `examples/jog.yaml`, or `paper` for that of the paper; by default the one that comes
    with eskin."""

    dynamics: bool = False
    """Simulate the arm's masses, joint servos and torque limits in MuJoCo (extra
    `sim`): it lags, yields to the hand, and makes a protective stop when it is pushed
    off its path; `resume` in the page unlocks it."""


def run(command: DemoCommand) -> dict[str, object]:
    """Run the demonstration and return its result."""
    from eskin.sim.demo import DemoConfig, SimulatedUserConfig

    shortest, longest = command.pause
    if not 0 <= shortest <= longest < float("inf"):
        raise DeviceError(
            f"--pause is {shortest:g} {longest:g}; allowed are two times in their "
            "order, not negative"
        )
    if command.dynamics:
        find_mujoco("--dynamics")
    print_untouched(command.skin, command.robot_urdf)
    config = DemoConfig(
        skin=command.skin,
        model=command.model,
        commands=command.commands,
        build_kind=command.build or ("fresh" if command.headless else "flawless"),
        seed=command.seed,
        dynamics=command.dynamics,
        robot=command.robot_urdf,
        user=SimulatedUserConfig(pause=command.pause),
    )
    if command.headless:
        return run_headless_demo(command.seconds or HEADLESS_SECONDS, config)
    return run_in_browser(command, config)


def run_headless_demo(seconds: float, config: "DemoConfig") -> dict[str, object]:
    """Run scripted touches; print and return how they were obeyed."""
    from eskin.sim.demo import run_headless, summarise_score

    outcome = run_headless(seconds, config)
    counts = dict(summarise_score(outcome.score))
    print(
        f"{format_count(counts['touches'], 'touch')} in {outcome.seconds:g} s on "
        f"{config.build_kind} builds: {counts['correct']} obeyed correctly, "
        f"{counts['wrong']} wrongly, {counts['missed']} missed; "
        f"{format_count(counts['accidents'], 'accidental contact')}, "
        f"{format_count(counts['false_alarms'], 'unasked command')} "
        f"({format_count(counts['unasked_stops'], 'stop')}, "
        f"{counts['unasked_slow']} slow, {counts['unasked_going_on']} to go on); "
        f"{format_count(counts['holds'], 'hold')}, "
        f"{format_count(outcome.unlocked, 'protective stop')}, "
        f"{format_count(outcome.delivered, 'part')} brought"
    )
    print(
        f"{format_count(counts['questions'], 'question')} asked, "
        f"{counts['answered']} answered"
    )
    p50, p95 = outcome.delay or (None, None)
    if p50 is None:
        print("no touch was obeyed in that time; let it run for longer: --seconds 60")
    else:
        print(
            f"from the end of a touch to its command: p50 {p50:.2f} s, p95 {p95:.2f} s"
        )
    for why, count in outcome.score.count_failures().items():
        print(f"{count:5} lost: {why}")
    return {
        **counts,
        "lost": outcome.score.count_failures(),
        "step_ms_p50": outcome.step[0],
        "step_ms_p99": outcome.step[1],
        "delay_s_p50": p50,
        "delay_s_p95": p95,
        "protective_stops": outcome.unlocked,
        "delivered": outcome.delivered,
        "seconds": outcome.seconds,
    }


def run_in_browser(command: DemoCommand, config: "DemoConfig") -> dict[str, object]:
    """Serve the page until the end; return the counts."""
    from eskin.sim.demo.browser import serve

    served = serve(config, command.port, command.seconds, tell_link)
    print(
        f"{format_count(served.readings, 'reading')}, "
        f"{format_count(served.commands, 'command')}"
    )
    return {
        "touches": served.detections,
        **dict.fromkeys(("correct", "wrong", "missed", "false_alarms")),
        "commands": served.commands,
        "step_ms_p50": served.step[0],
        "step_ms_p99": served.step[1],
    }


def tell_link(link: str) -> None:
    """Print the link of the page, and open it where a person sees a browser."""
    from eskin.page.process import describe_link

    print(f"a robot is at work in its skin; {describe_link(link)}")
    print("there the mouse is the hand; Ctrl-C ends it", flush=True)
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    has_display = sys.platform != "linux" or any(map(os.environ.get, displays))
    if sys.stdout.isatty() and has_display:
        open_once(link)


@cache
def open_once(link: str) -> None:
    """Open a link in the browser, unless it was opened already."""
    webbrowser.open(link)
