"""Test of simulated sensors whose counts rise and fall."""

import numpy as np
import pytest

from eskin.robot import load_robot
from eskin.sim import load_constants
from eskin.sim.sensor import draw_build
from eskin.skin import MountedSkin, build_grid_skin
from lab import polarity

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("family", "falls"), [("divider", False), ("capacitive", True)]
)
def test_sensor_is_calibrated_whichever_way_its_counts_go(family, falls, monkeypatch):
    monkeypatch.setattr(polarity, "TOUCHES", 4)
    skin = build_grid_skin(8, 8, polarity.PITCH, calibrated=True)
    mounted = MountedSkin(skin, load_robot("table"))
    rng = np.random.default_rng(1)
    build = draw_build(family, family, skin, load_constants(), rng)
    found = polarity.try_build(build, mounted, 1, falls)
    assert (found.told is not None) == falls
    assert found.known == 1.0 and found.force > 0.0
