"""Units that more than one package converts between, and numbers in messages."""

NS_PER_S = 1_000_000_000
"""Nanoseconds in one second; stamps are in nanoseconds, durations in seconds."""


def seconds_between(start: int, end: int) -> float:
    """Return the time from one stamp to another [s].

    It is the number nearest to the exact difference: a limit in seconds decides as the
    same limit in nanoseconds does.

    Args:
        start: the stamp of one instant [ns].
        end: stamp of another [ns].
    """
    return (end - start) / NS_PER_S


def format_count(count: object, noun: str) -> str:
    """Return a count with its noun, such as `1 reading` or `0 touches`.

    Args:
        count: the whole number of things.
        noun: what one of them is called.
    """
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}{'es' if noun.endswith(('tch', 'uch', 's', 'x')) else 's'}"


def format_index(noun: str, index: int, count: int) -> str:
    """Return an index from 0 with its range, such as `row 5 of 0 to 15`.

    Args:
        noun: noun of the things that are counted.
        index: the number of one of them.
        count: how many there are.
    """
    return f"{noun} {index} of 0 to {count - 1}"


DURATIONS = (
    (2 * 365.25 * 86400, 365.25 * 86400, "years"),
    (2 * 86400, 86400, "days"),
    (2 * 3600, 3600, "hours"),
    (2 * 60, 60, "minutes"),
    (60, 1, "s"),
)
"""Duration from which a unit is used [s], its length [s] and its name."""


def format_duration(seconds: float) -> str:
    """Return a duration in the unit that suits it, such as `1.50 s` or `30 days`.

    Args:
        seconds: the duration [s], 0 or more.
    """
    for least, length, name in DURATIONS:
        if seconds >= least:
            return f"{seconds / length:.0f} {name}"
    return f"{seconds:.2f} s"
