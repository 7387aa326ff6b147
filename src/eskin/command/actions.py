"""The actions that a touch can command, and the confidence that each one needs."""

from collections.abc import Callable
from typing import Literal, get_args

from eskin.command.arm import Arm, ArmState
from eskin.live import Detection

Action = Literal[
    "pause",
    "resume",
    "toggle_pause",
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
"""The action of a rule that names a function."""

MIN_CONFIDENCE = {
    "hold": 0.5,
    "pause": 0.5,
    "slow": 0.6,
    "next_waypoint": 0.7,
    "previous_waypoint": 0.7,
    "close_gripper": 0.7,
    FUNCTION: 0.8,
    "normal": 0.8,
    "open_gripper": 0.85,
    "resume": 0.95,
    "jog": 0.95,
}
"""Confidence that each needs, where a rule says nothing: the more can go wrong, the
more."""
STRICT_ACTIONS = ("open_gripper", "resume", "jog")
"""A rule can ask more confidence for these, never less."""
COOL_DOWN = 0.5
"""How long a rule rests after it was obeyed, where it says nothing [s]."""
HALTING_ACTIONS = ("pause", "hold")
"""What stops the arm: no rest keeps anybody from it, nor that a touch is unknown."""
STARTING_ACTIONS = ("resume", "jog")
"""What sets an arm in motion that stands: it does so once nobody touches it."""
REDUCING_ACTIONS = ("pause", "hold", "slow")
"""What makes the arm do less: allowed when much else is not."""


def resolve_action(action: str, state: ArmState) -> str:
    """The plain action that a toggle means in a state of the arm."""
    match action:
        case "toggle_pause":
            return "resume" if state.paused else "pause"
        case "toggle_gripper":
            return "close_gripper" if state.gripper == "open" else "open_gripper"
        case "toggle_speed":
            return "slow" if state.speed >= 1 else "normal"
    return action


def required_confidence(action: str, asked: float | None) -> float:
    """The confidence that a plain action needs.

    Args:
        action: no toggle.
        asked: what its rule says; None where it says nothing.
    """
    least = MIN_CONFIDENCE[action]
    if asked is None:
        return least
    return max(asked, least) if action in STRICT_ACTIONS else asked


CommandFunction = Callable[[Arm, Detection], None]
COMMAND_FUNCTIONS: dict[str, CommandFunction] = {}
"""Those that Python code has registered, by name: a file can only name them."""


def command_function(name: str) -> Callable[[CommandFunction], CommandFunction]:
    """Let command maps call the function below by a name.

    It is called like every other action: after all rules of the policy, once a touch.

    Args:
        name: that files give.

    Raises:
        ValueError: the name is taken, or is no plain word.
    """
    if not name.isidentifier() or name in COMMAND_FUNCTIONS:
        taken = ", ".join(COMMAND_FUNCTIONS) or "none"
        raise ValueError(
            f"command function '{name}'; allowed is a word that is not taken (taken: "
            f"{taken}); choose another name"
        )

    def register(function: CommandFunction) -> CommandFunction:
        COMMAND_FUNCTIONS[name] = function
        return function

    return register
