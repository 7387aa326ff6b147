"""Tests of the progress of long commands, where the output is no terminal."""

import pytest

from eskin.progress import PERIOD, print_progress, show_progress, track_progress


def test_line_is_printed_every_ten_seconds_with_the_time_that_is_left(capsys):
    seconds = [0.0]
    update = print_progress("clips", 100, 20, lambda: seconds[0])
    for done, seconds[0] in ((21, 9.9), (40, 10.0), (45, 15.0), (60, 20.5)):
        update(done)
    assert capsys.readouterr().err.splitlines() == [
        "clips: 40 of 100, about 30 s left",
        "clips: 60 of 100, about 20 s left",
    ]
    seconds[0] = 100.0
    update(100)
    assert capsys.readouterr() == ("", "")


def test_time_that_is_left_is_not_guessed_before_anything_is_done(capsys):
    seconds = [0.0]
    update = print_progress("clips", 100, 20, lambda: seconds[0])
    seconds[0] = 11.0
    update(20)
    assert capsys.readouterr().err == "clips: 20 of 100\n"


@pytest.mark.parametrize("quiet", [True, False])
def test_short_and_quiet_commands_print_nothing(quiet, capsys):
    with show_progress("clips", 3, quiet=quiet) as update:
        update(1)
    assert list(track_progress("abc", "letters", 3)) == ["a", "b", "c"]
    assert capsys.readouterr() == ("", "") and PERIOD == 10.0
