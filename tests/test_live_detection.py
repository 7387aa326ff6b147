"""Tests of the direction of a touch in the frame of its link."""

import numpy as np
import pytest

from eskin.live.decision import DirectionTracker
from eskin.touch import (
    NO_TOUCHES,
    LinkPoseCache,
    Reading,
    TouchRecord,
    TouchState,
)
from helpers.commands import MOUNTED, SKIN

FOREARM = MOUNTED.robot.link_names.index("forearm_link")
AXIS = MOUNTED.robot.find_axis("forearm_link")
NORMAL = np.cross(AXIS, [0.0, 1.0, 0.0])
NORMAL /= np.linalg.norm(NORMAL)
POSES = ([0.0] * 6, [0.4, -1.2, 1.5, -0.3, 0.8, 2.0])


def find_heading(travel, q):
    """Return the heading of a touch on the forearm that travelled so far [m]."""
    q = np.array(q)
    stamp = 1
    pressure = np.zeros(SKIN.count, np.float32)
    reading = Reading(stamp, pressure, np.ones(SKIN.count, bool), q)
    touch = TouchRecord(1, 0, stamp, link=FOREARM, latest=tuple(travel.tolist()))
    tracking = NO_TOUCHES._replace(open=(touch,))
    state = TouchState(reading, (), np.zeros(SKIN.count, bool), tracking, MOUNTED)
    poses = LinkPoseCache(MOUNTED)
    tracker = DirectionTracker(poses, min_travel=0.02)
    tracker.update(state)
    n_world = poses.get(q)[FOREARM, :3, :3] @ NORMAL
    return tracker.find_heading(1, n_world)


@pytest.mark.parametrize("q", POSES, ids=["zero", "bent"])
@pytest.mark.parametrize(
    ("along", "right", "heading"),
    [
        (1.0, 0.0, "toward_tool"),
        (-1.0, 0.3, "toward_base"),
        (0.2, 1.0, "right"),
        (0.0, -1.0, "left"),
    ],
)
def test_heading_is_that_on_the_link_in_any_pose(along, right, heading, q):
    travel = along * AXIS + right * np.cross(AXIS, NORMAL)
    assert find_heading(0.1 * travel / np.linalg.norm(travel), q) == heading


@pytest.mark.parametrize("travel", [0.01 * AXIS, 0.1 * NORMAL], ids=["short", "out"])
def test_touch_that_travels_nowhere_on_the_link_has_no_heading(travel):
    assert find_heading(travel, POSES[0]) == ""


def test_axis_of_link_points_to_what_it_carries():
    np.testing.assert_allclose(np.linalg.norm(AXIS), 1.0)
    T = MOUNTED.kinematics.poses(np.zeros(6))
    names = MOUNTED.robot.link_names
    ahead = T[names.index("wrist_1_link"), :3, 3] - T[FOREARM, :3, 3]
    np.testing.assert_allclose(
        T[FOREARM, :3, :3] @ AXIS, ahead / np.linalg.norm(ahead), atol=1e-9
    )
    assert not MOUNTED.robot.find_axis("tool0").any()
