"""A two-finger gripper at the end of the arm, open or closed."""

from typing import final

from viser import ViserServer

from eskin.page.setup import Setup

METAL, RUBBER = (206, 209, 214), (52, 56, 64)
WIDE = {"open": 0.042, "closed": 0.011}
"""Of a finger from the middle [m]."""


@final
class Gripper:
    """Drawn on the last link of the robot; only fingers move."""

    def __init__(self, server: ViserServer, setup: Setup) -> None:
        """Draw it open."""
        at = f"/robot/{setup.links[-1]}/gripper"
        scene = server.scene
        scene.add_cylinder(
            f"{at}/flange", 0.034, 0.02, color=METAL, position=(0, 0, 0.01)
        )
        scene.add_box(
            f"{at}/palm",
            dimensions=(0.105, 0.045, 0.035),
            color=METAL,
            position=(0, 0, 0.037),
        )
        self.fingers = {
            side: scene.add_box(
                f"{at}/finger_{side}",
                dimensions=(0.014, 0.026, 0.06),
                color=RUBBER,
                position=(side * WIDE["open"], 0, 0.084),
            )
            for side in (-1, 1)
        }
        self.shown = "open"

    def show(self, state: str) -> None:
        """Open or close it.

        Args:
            state: `open` or `closed`.
        """
        if state != self.shown and state in WIDE:
            self.shown = state
            for side, finger in self.fingers.items():
                finger.position = (side * WIDE[state], 0.0, 0.084)
