"""These tests check how people who start an arm are simulated and counted."""

from dataclasses import replace

import pytest

from lab.starts import Starter, Try, format_kind

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def people():
    """Return the tries of four people on a fresh build."""
    return Starter("fresh", 60000).run(4)


def test_person_tries_until_the_arm_starts_and_four_times_at_most(people):
    for tries in people:
        assert [one.number for one in tries] == list(range(1, len(tries) + 1))
        assert len(tries) <= 4
        assert all(one.moved is None and one.reason for one in tries[:-1])
        assert (tries[-1].reason == "") == (tries[-1].moved is not None)
    assert any(tries[-1].moved is not None for tries in people)


def test_question_follows_the_grab_and_motion_the_answer(people):
    tries = [one for own in people for one in own if one.moved is not None]
    for one in tries:
        assert 0.0 < one.end < one.asked < one.answer < one.answer_end
        assert one.answer_end < one.commanded <= one.moved
        assert one.is_detected and one.answer_felt is not None


def test_answers_begin_as_late_as_people_answer(people):
    delays = [
        one.answer - one.asked
        for own in people
        for one in own
        if one.answer is not None
    ]
    assert delays and 0.33 <= min(delays) and max(delays) <= 0.85


FELT = Try("fresh", 1, 0, 1, end=1.0, felt=0.1)
GRABBED = replace(FELT, detected=[("grab", 0.9)])
TOO_HARD = [("resume", False, "strong touch", 1.0)]
UNCLEAR = [("resume", False, "unclear answer", 2.5)]


@pytest.mark.parametrize(
    ("one", "reason"),
    [
        (replace(FELT, end=None), "the grab missed the skin"),
        (replace(FELT, felt=None), "the grab was not felt"),
        (FELT, "detected as nothing"),
        (replace(FELT, detected=[("stroke", 0.8)]), "detected as stroke"),
        (replace(GRABBED, decisions=TOO_HARD), "request: strong touch"),
        (
            replace(
                GRABBED,
                asked=1.4,
                answer_detected=[("unknown", 0.4)],
                decisions=UNCLEAR,
            ),
            "answer (unknown): unclear answer",
        ),
        (replace(GRABBED, moved=3.0), ""),
    ],
)
def test_failed_try_has_reason_of_the_stage_that_it_reached(one, reason):
    assert one.reason == reason


def make_person(failures, starts):
    """Return tries of which so many fail, and one more that starts the arm or not."""
    last = {"asked": 1.5, "moved": 3.0} if starts else {}
    tries = [Try("fresh", 1, 0, number + 1) for number in range(failures)]
    return [*tries, Try("fresh", 1, 0, failures + 1, **last)]


def test_row_counts_people_within_one_two_and_three_tries():
    builds = [[make_person(0, True), make_person(1, True)], [make_person(3, False)] * 2]
    cells = [cell.strip() for cell in format_kind("fresh", builds).split("|")]
    assert cells[1:3] == ["fresh", "4"]
    assert [cell.split()[0] for cell in cells[3:6]] == ["25.0%", "50.0%", "50.0%"]
    assert cells[6:9] == ["11", "1.50 / 1.50", "3.00 / 3.00"]
