"""Validation is on sessions that were not trained on, and no class goes untrained."""

import numpy as np
import pytest

from eskin.learn.holdout import hold_out

CLASSES = ("none", "hold", "tap")


def held_out(sessions, share, seed=0):
    """Hold out some of recordings with a person, a session and gestures."""
    made = {i: set(own or CLASSES) for i, (_, _, *own) in enumerate(sessions)}
    names = {i: (person, session) for i, (person, session, *_) in enumerate(sessions)}
    return hold_out(names, made, share, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("count", "share"), [(1, 0.5), (4, 0.15), (20, 0.15), (7, 0.0)]
)
@pytest.mark.parametrize("session", ["", "{}"])
def test_a_recording_is_trained_on_or_validated_on_but_never_both(
    count, share, session
):
    found = held_out([("ann", session.format(i)) for i in range(count)], share)
    assert found.train | found.held == set(range(count))
    assert not found.train & found.held
    assert len(found.held) == found.wanted * (count > 1)


@pytest.mark.parametrize("seed", range(20))
def test_a_person_and_session_are_never_both_trained_and_validated_on(seed):
    sessions = [("ann", "1"), ("ann", "2"), ("bob", "1"), ("bob", "3")] * 3
    for share in (0.1, 0.3, 0.5):
        found = held_out(sessions, share, seed)
        names = [{sessions[i] for i in part} for part in (found.train, found.held)]
        assert names[1] and not names[0] & names[1]
        assert len(found.held) == max(3, round(found.wanted / 3) * 3)


@pytest.mark.parametrize("seed", range(20))
def test_no_class_is_held_out_altogether(seed):
    sessions = [
        ("ann", "1", "none", "hold", "tap"),
        *[("bob", "1", "none", "hold")] * 4,
    ]
    found = held_out(sessions, 0.4, seed)
    assert 0 in found.train
    assert not found.held
    assert "0 of 5 recordings held out for validation, 2 asked for" in str(found)


def test_nothing_is_held_out_where_nothing_is_asked_for():
    found = held_out([("ann", str(i)) for i in range(5)], 0.0)
    assert not found.held
    assert str(found) == "0 of 5 recordings held out for validation"
