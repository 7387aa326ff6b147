"""This module defines the actions that a touch can command, and what each one needs.

A command map names functions that the program registers.
"""

from collections.abc import Callable
from threading import Thread
from typing import Literal, final, get_args

from eskin.command.arm import Arm, ArmState
from eskin.command.reasons import Problem
from eskin.live import Detection

Action = Literal[
    "pause",
    "resume",
    "toggle_pause",
    "go_on",
    "next_waypoint",
    "previous_waypoint",
    "open_gripper",
    "close_gripper",
    "toggle_gripper",
    "slow",
    "normal",
    "toggle_speed",
    "jog",
    "hold",
    "none",
]
ACTIONS: tuple[str, ...] = get_args(Action)
FUNCTION = "function"
"""Action of a rule that names a function."""

MIN_CONFIDENCE = 0.34
"""Default confidence of a touch that stops the arm, asks or answers."""
OWN_CONFIDENCE = {"slow": 0.49, FUNCTION: 0.8, "none": 0.0}
"""Default confidence of other actions that need no answer. That of `slow`, and of
stops, is chosen from data, by what errors of them cost (`lab/notes/policy.md`)."""
SUSPEND = "wait"
"""Action of events that tell that the arm is suspended while it is touched."""
ASK = "ask"
"""Action of events that tell that the arm asks whether it is to do more."""
COOL_DOWN = 0.5
"""Default time for which a rule rests after it was executed [s]."""
TOGGLES = {
    "toggle_pause": ("pause", "resume"),
    "go_on": ("resume", "normal", "next_waypoint"),
    "toggle_gripper": ("close_gripper", "open_gripper"),
    "toggle_speed": ("slow", "normal"),
}
"""Actions that mean one of several plain ones, by the state of the arm."""
THING_GESTURES = ("poke", "double_pat")
"""Gestures that things make too, which bump, bounce, swing, drip or vibrate: they do
not ask for more motion (`python -m lab.attacks events`)."""
ADVANCING_ACTIONS = ("resume", "normal", "next_waypoint", "previous_waypoint", "jog")
"""Actions that give the arm more motion."""
HALTING_ACTIONS = ("pause", "hold")
"""Actions that stop the arm: neither a cool-down nor an unknown touch blocks them."""
STARTING_ACTIONS = ("resume", "jog")
"""Actions that set a paused arm in motion."""
REDUCING_ACTIONS = ("pause", "hold", "slow")
"""Actions that make the arm do less: they need no answer."""

CommandFunction = Callable[[Arm, Detection], None]
COMMAND_FUNCTIONS: dict[str, CommandFunction] = {}
"""Functions that Python code has registered, by name: a file can only name them."""
MOVES_NOTHING = "moves_nothing"
"""Attribute of functions that are declared to move nothing."""


@final
class FunctionCall:
    """A function call runs a command function on a thread of its own.

    Attributes:
        problem: why the arm is held until it returns.
    """

    def __init__(self, name: str, arm: Arm, detection: Detection) -> None:
        """Start to run the function."""
        self.problem = Problem.BLOCKED_FUNCTION.reason(name=name)
        self.function = COMMAND_FUNCTIONS[name]
        self.arguments = (arm, detection)
        self.error: BaseException | None = None
        self.thread = Thread(target=self.run, name=f"eskin {name}", daemon=True)
        self.thread.start()

    def run(self) -> None:
        """Run the function, and keep what it raises."""
        try:
            self.function(*self.arguments)
        except BaseException as error:
            self.error = error

    def has_returned(self, timeout: float = 0.0) -> bool:
        """Wait for the function for a time [s], return whether it is over.

        What it has raised is raised.
        """
        self.thread.join(timeout)
        if self.error is not None:
            raise self.error
        return not self.thread.is_alive()


def resolve_action(action: str, state: ArmState) -> str:
    """Return the plain action that a toggle means in a state of the arm."""
    match action:
        case "toggle_pause":
            return "resume" if state.paused else "pause"
        case "go_on":
            further = "next_waypoint" if state.speed >= 1 else "normal"
            return "resume" if state.paused else further
        case "toggle_gripper":
            coming = state.gripping or state.gripper
            return "close_gripper" if coming == "open" else "open_gripper"
        case "toggle_speed":
            return "slow" if state.speed >= 1 else "normal"
    return action


def needs_answer(action: str, function: str | None = None) -> bool:
    """Return whether a plain action is executed only after the arm has asked for it.

    Args:
        action: a plain action, not a toggle.
        function: name of the function where the action is one.
    """
    if action == FUNCTION:
        called = COMMAND_FUNCTIONS.get(function or "")
        return not getattr(called, MOVES_NOTHING, False)
    return action not in (*REDUCING_ACTIONS, "none")


def moves_nothing(function: CommandFunction) -> CommandFunction:
    """Declare that the decorated command function moves nothing.

    It is called without a question, as soon as its touch is recognised.
    """
    setattr(function, MOVES_NOTHING, True)
    return function


def command_function(name: str) -> Callable[[CommandFunction], CommandFunction]:
    """Register the decorated function, so that command maps can name it.

    It is called like every other action: after all rules of the policy, once a touch.
    The arm asks first, unless `moves_nothing` declares that it need not.

    Args:
        name: the name that files give.

    Raises:
        ValueError: the name is taken, or is no plain word.
    """
    if not name.isidentifier() or name in COMMAND_FUNCTIONS:
        taken = ", ".join(COMMAND_FUNCTIONS) or "none"
        raise ValueError(
            f"command function '{name}'; allowed is a word that is not taken (taken: "
            f"{taken})"
        )

    def register(function: CommandFunction) -> CommandFunction:
        COMMAND_FUNCTIONS[name] = function
        return function

    return register
