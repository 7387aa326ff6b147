"""`eskin demo`: an arm at work in its skin, in the browser or headless."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from eskin.errors import DeviceError
from eskin.extras import find_mujoco

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

    pause: tuple[float, float] = (0.6, 0.8)
    """Headless: least and longest time from one touch to the next [s]."""
    commands: Path | None = None
    """Which touch commands what, such as `examples/jog.yaml`; the map that comes with
    eskin unless given."""

    dynamics: bool = False
    """The arm has masses, joint servos and torque limits in MuJoCo (extra `sim`): it
    lags, yields to the hand, and stops by itself where it is held off; `resume` in the
    page unlocks it."""

    same_touch: bool = False
    """Instead, the same counts are played on the skin in two poses of the arm, where
    they are another thing each time; what a recogniser says that sees the pose stands
    beside what one says that does not. Headless, the answers are printed."""

    pairs: int = 6
    """How many touches `--same-touch` plays in turn."""


def run(command: Command) -> dict[str, object]:
    """Demonstrate, and return what came of it."""
    from eskin.demo import DemoConfig, SimulatedUserConfig

    if command.seconds is not None and not 0 < command.seconds < float("inf"):
        raise DeviceError(
            f"--seconds is {command.seconds}; allowed are above 0; change it"
        )
    least, longest = command.pause
    if not 0 <= least <= longest < float("inf"):
        raise DeviceError(
            f"--pause is {least:g} {longest:g}; allowed are two times in their order, "
            "not negative; change them"
        )
    commanded = command.commands is not None or command.dynamics
    if command.same_touch and (commanded or command.pairs < 1):
        raise DeviceError(
            f"--same-touch with --pairs {command.pairs}, --commands {command.commands} "
            f"and dynamics {'on' if command.dynamics else 'off'}; allowed are 1 pair "
            "and more, no commands and no dynamics; change it"
        )
    if command.dynamics:
        find_mujoco("--dynamics")
    config = DemoConfig(
        *(command.skin, command.model, command.commands, command.build),
        seed=command.seed,
        dynamics=command.dynamics,
        user=SimulatedUserConfig(pause=command.pause),
    )
    if command.same_touch:
        return same_touch(command, config)
    if command.headless:
        return headless(command.seconds or HEADLESS_SECONDS, config)
    return in_browser(command, config)


def headless(seconds: float, config: "DemoConfig") -> dict[str, object]:
    """Scripted touches."""
    from eskin.demo import run_headless, summarise_score

    outcome = run_headless(seconds, config)
    counts = dict(summarise_score(outcome.score))
    print(
        f"{counts['touches']} touches in {outcome.seconds:g} s on {config.build_kind} "
        f"builds: {counts['correct']} obeyed rightly, {counts['wrong']} wrongly, "
        f"{counts['missed']} missed; {outcome.accidents} accidental contacts, "
        f"{counts['false_alarms']} commands that nobody gave; {outcome.score.holds} "
        f"holds, {outcome.unlocked} protective stops, {outcome.delivered} parts brought"
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
        "accidents": outcome.accidents,
        "holds": outcome.score.holds,
        "protective_stops": outcome.unlocked,
        "delivered": outcome.delivered,
        "seconds": outcome.seconds,
    }


def same_touch(command: Command, config: "DemoConfig") -> dict[str, object]:
    """The same counts in two poses, to two recognisers."""
    from eskin.demo.comparison import serve_same_touch
    from eskin.demo.same_touch import compare_models

    if not command.headless:
        return dict(
            serve_same_touch(config, command.pairs, command.port, command.seconds, tell)
        )
    found = compare_models(command.pairs, config)
    for number, each in enumerate(found):
        print(f"touch {number + 1}: {each.labels[0]}, then {each.labels[1]}")
        for who, (one, other) in (("with", each.posed), ("without", each.blind)):
            said = "; then ".join(", ".join(answer.texts) for answer in (one, other))
            print(f"  {who} the pose: {said}")
    counts = {
        "playings": 2 * len(found),
        "posed_right": sum(each.count_correct(each.posed) for each in found),
        "blind_right": sum(each.count_correct(each.blind) for each in found),
        "blind_same": sum(each.blind_is_equal for each in found),
    }
    print(
        f"with the pose {counts['posed_right']} of {counts['playings']} are right, "
        f"without it {counts['blind_right']}, and both answers are the same for "
        f"{counts['blind_same']} of {len(found)} touches"
    )
    rows = [
        {
            "labels": each.labels,
            "posed": [answer.detected for answer in each.posed],
            "blind": [answer.detected for answer in each.blind],
        }
        for each in found
    ]
    return {**counts, "pairs": rows}


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
