"""What people do in the page, done to the simulated skin and arm."""

from collections.abc import Callable
from typing import final

import numpy as np

from eskin.command import SimulatedArm
from eskin.page import Order, PageOrder, TouchOrder
from eskin.sim.live.live_skin import LiveSkin
from eskin.sim.live.place import Place


@final
class Obedience:
    """Turns the orders of a page into touches of simulated fingers, and the rest.

    A touch goes through the same hand, contact and sensor as the training data: the
    recogniser hears nothing of what it was meant to be.
    """

    def __init__(
        self,
        skin: LiveSkin,
        arm: SimulatedArm,
        other: Callable[[PageOrder], None] = lambda order: None,
    ) -> None:
        """Obey from now on.

        Args:
            skin: that is touched.
            arm: that is paused, and unlocked as at the robot.
            other: obeys what is neither touch nor fault nor pause.
        """
        self.skin = skin
        self.arm = arm
        self.other = other
        self.dragged: dict[int, int] = {}

    def obey(self, order: Order) -> None:
        """Do what is asked for."""
        if isinstance(order, TouchOrder):
            self.touch(order)
        else:
            self.do(order)

    def touch(self, order: TouchOrder) -> None:
        """Touch the skin."""
        hand = self.skin.hand
        place = Place(order.link, np.array(order.p_link, np.float64))
        match order.kind:
            case "poke":
                hand.poke(place, order.force, order.seconds)
            case "double_pat":
                hand.double_pat(place, order.force, order.seconds)
            case "grab":
                hand.grab(place, order.force, order.seconds)
            case "begin":
                self.dragged[order.key] = hand.begin(place, order.force)
            case "move":
                if order.key in self.dragged:
                    hand.move(self.dragged[order.key], place)
            case "end":
                if order.key in self.dragged:
                    hand.end(self.dragged.pop(order.key))

    def do(self, order: PageOrder) -> None:
        """Do something else."""
        match order.kind:
            case "unplug":
                self.skin.unplug(str(order.value))
            case "plug":
                self.skin.plug(str(order.value))
            case "kill":
                self.skin.kill(float(order.value or 0.0))
            case "restore":
                self.skin.restore()
            case "pause_task":
                self.arm.pause()
            case "resume_task":
                self.arm.unlock()
                self.arm.release()
                self.arm.resume()
            case _:
                self.other(order)
