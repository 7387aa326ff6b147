"""This module guides a person who presses a skin to check how its patches are wired."""

from typing import final

from eskin.calibration.guide import PressGuide, PressRequest, PressSummary
from eskin.reasons import Reason
from eskin.skin import MountedSkin
from eskin.skin.wiring import PressResponse, choose_press_targets
from eskin.touch import Calibration

REST_SECONDS = 3.0
"""Time without touch at the start [s]."""


@final
class WiringGuide(PressGuide[PressResponse]):
    """A guide asks for a press on every target of a skin, one after the other.

    Attributes:
        targets: all targets.
        waiting: those that are still to be pressed, in order.
    """

    def __init__(self, mounted: MountedSkin, calibration: Calibration) -> None:
        """Start with some seconds without touch."""
        super().__init__(mounted, calibration, REST_SECONDS)
        self.targets = choose_press_targets(mounted.skin)
        self.waiting = list(self.targets)

    def find_refusal(self, press: PressSummary, taxel: int) -> Reason | None:
        """Refuse nothing: wherever a press is felt, it tells how patches are wired."""
        return None

    def build_press(self, press: PressSummary, taxel: int) -> PressResponse:
        """Return the response to the press that is asked for."""
        return PressResponse(self.waiting.pop(0), taxel)

    @property
    def press_share(self) -> float:
        """Share of the targets that is done."""
        return 1.0 - len(self.waiting) / len(self.targets)

    @property
    def request(self) -> PressRequest | None:
        """Target to press next; None where all are pressed or left out."""
        if not self.waiting:
            return None
        taxel = self.waiting[0].taxel
        x, y, z = self.skin.positions[taxel].tolist()
        return PressRequest(self.waiting[0].patch, taxel, (x, y, z))

    def leave_out(self) -> None:
        """Leave out the target that is asked for: nothing was felt there."""
        self.waiting.pop(0)

    def ask_again(self, press: PressResponse) -> None:
        """Ask for the target of a press again."""
        self.waiting.insert(0, press.target)

    def finish(self) -> list[PressResponse]:
        """Return the responses of all targets; those without a press have no taxel.

        Raises:
            ValueError: rest was not measured.
        """
        self.check_rested()
        felt = {press.target: press.taxel for press in self.presses}
        return [PressResponse(each, felt.get(each)) for each in self.targets]
