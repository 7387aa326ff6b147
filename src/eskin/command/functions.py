"""Functions that a command map may name."""

from collections.abc import Callable

from eskin.command.arm import Arm
from eskin.live import Detection

CommandFunction = Callable[[Arm, Detection], None]
FUNCTIONS: dict[str, CommandFunction] = {}
"""Those that Python code has registered, by name: a file can only name them."""


def command_function(name: str) -> Callable[[CommandFunction], CommandFunction]:
    """Let command maps call the function below by a name.

    It is called like every other action: after all rules of the policy, once a touch.

    Args:
        name: that files give.

    Raises:
        ValueError: the name is taken, or is no plain word.
    """
    if not name.isidentifier() or name in FUNCTIONS:
        taken = ", ".join(FUNCTIONS) or "none"
        raise ValueError(
            f"command function '{name}'; allowed is a word that is not taken (taken: "
            f"{taken}); choose another name"
        )

    def register(function: CommandFunction) -> CommandFunction:
        FUNCTIONS[name] = function
        return function

    return register
