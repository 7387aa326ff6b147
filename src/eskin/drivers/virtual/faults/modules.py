"""Modules that go, come back, are replaced or wired wrong."""

from abc import abstractmethod
from typing import final

import numpy as np

from eskin.drivers.virtual.faults.fault import ModuleFault, Order
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.units import NS_PER_S

MONTH = 2.6e6
"""[s]"""


class Absence(ModuleFault):
    """Modules that are away for a time, then power up."""

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.end
        self.is_away = False

    @property
    def unit(self) -> str:
        """What it counts."""
        return "departures"

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Take modules away, or bring them back."""
        away = self.order.start <= at < self.end
        if away == self.is_away:
            return
        self.is_away = away
        for index in self.order.patches:
            patches[index].away += 1 if away else -1
            self.count += away
            if not away:
                self.bring_back(patches[index], at)

    @abstractmethod
    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up what is plugged in."""


@final
class Unplug(Absence):
    """Modules are unplugged, and plugged in again where that ends."""

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up the same module."""
        patch.power_up(at)


@final
class Reboot(Absence):
    """Modules start anew, and are away for the amount [s]."""

    default, most, lasts = 0.2, MONTH, False

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.start + round(order.amount * NS_PER_S)

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up the same module."""
        patch.power_up(at)


@final
class Replace(Absence):
    """Other modules, with other serial numbers, after the amount [s]."""

    default, most, lasts = 0.2, MONTH, False

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.start + round(order.amount * NS_PER_S)

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up another module."""
        other = 1 + int(self.rng.integers(2**62))
        patch.serial_number = (patch.serial_number + other) % 2**64
        patch.power_up(at)


class Turn(ModuleFault):
    """Something that happens to modules at one instant."""

    lasts = False

    @property
    def unit(self) -> str:
        """What it counts."""
        return "modules"

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Let it happen, once."""
        if self.count == 0 and at >= self.order.start:
            self.count = len(self.order.patches)
            self.turn([patches[index] for index in self.order.patches], at)

    @abstractmethod
    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Let it happen to modules."""


@final
class ClockJump(Turn):
    """Clocks of modules jump by the amount [s]."""

    default, least, most = 10.0, -MONTH, MONTH

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Let clocks jump."""
        for patch in patches:
            patch.jump(self.order.amount)


@final
class Wrap(Turn):
    """Clocks and scan numbers of modules wrap after the amount [s]."""

    default, most = 1.0, 2**32 / 1e6

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Set clocks and scan numbers."""
        for patch in patches:
            patch.wrap_in(self.order.amount, at)


@final
class Swap(Turn):
    """Two modules have each other's address, as when cables are changed."""

    pair = True

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Change their addresses."""
        one, other = patches
        one.address, other.address = other.address, one.address


@final
class SameAddress(Turn):
    """The second module has the first one's address as well as the first."""

    pair = True

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Copy the address."""
        patches[1].address = patches[0].address
