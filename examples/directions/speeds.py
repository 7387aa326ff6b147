"""Register a function that the command map in this folder names, then run eskin.

python examples/directions/speeds.py demo --commands examples/directions/commands.yaml
"""

from eskin.__main__ import main
from eskin.command import Arm, command_function
from eskin.live import Detection


@command_function("half")
def set_half_speed(arm: Arm, detection: Detection) -> None:
    """Let the arm go at half of its speed."""
    arm.set_speed(0.5)


if __name__ == "__main__":
    main()
