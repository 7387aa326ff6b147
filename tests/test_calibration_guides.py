"""Tests of what holds for every guide that asks for presses."""

import pytest

from eskin.calibration import CalibrationGuide, GuideConfig
from eskin.calibration.pose import KnownPoint, PoseGuide
from eskin.calibration.wiring_guide import WiringGuide
from helpers.guided import (
    CALIBRATION,
    MOUNTED,
    SKIN,
    make_scans,
    press,
    rest,
)

TAXELS = (9, 27, 45)
POINTS = [
    KnownPoint(SKIN.patches[0].id, tuple(SKIN.positions[taxel].tolist()))
    for taxel in TAXELS
]
GUIDES = {
    "calibration": lambda: CalibrationGuide(MOUNTED, CALIBRATION, GuideConfig()),
    "pose": lambda: PoseGuide(MOUNTED, CALIBRATION, POINTS),
    "wiring": lambda: WiringGuide(MOUNTED, CALIBRATION),
}


def press_requests(guide, count):
    """Push rest, then presses where the guide asks for them; return the requests."""
    requests = []
    above = rest(110)
    done = 0
    while len(requests) <= count:
        for scan in list(make_scans(above))[done:]:
            guide.push(scan)
        requests.append(guide.request)
        done = len(above)
        above += press(guide.request.taxel)
    return requests[:count]


@pytest.mark.parametrize("build", GUIDES.values(), ids=GUIDES)
def test_guide_asks_again_for_all_presses_once_counts_go_the_other_way(build):
    guide = build()
    requests = press_requests(guide, 2)
    assert len(guide.presses) == 2
    guide.turn()
    assert not guide.presses
    assert guide.request == requests[0]
    assert guide.press_share == 0.0
