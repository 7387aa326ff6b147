"""This module tests what the numbers in the lines of a matrix mean.

The first or the last may be a time or the number of the line, and all of them may be
hexadecimal.
"""

import re
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, final

import numpy as np

from eskin.drivers.csv_lines import (
    HEXADECIMAL_CHANGES,
    UNITS,
    find_hexadecimal,
)
from eskin.drivers.csv_problems import LineError, LineProblem, OptionChange
from eskin.drivers.sampled_source import MAX_HELD
from eskin.units import NS_PER_S

MIN_CLOCK_LINES = 6
"""Number of lines by which it is tested whether a number of them is a time."""
MAX_SLOPE_LINES = 60
"""Largest number of lines by which it is estimated how much a number rises."""
MIN_WIDTH = 3
"""Number of digits from which numbers of one width may be hexadecimal."""
STEP_TOLERANCE = 0.1
"""Largest difference between the steps of a time, as a fraction of one of them."""
MIN_STEPS = 10
"""Number of equal steps by which a time or the number of a line is known."""
LETTER_LINES = 20
"""Number of the latest lines that are searched for digits of A to F."""
MIN_LETTERED = 3
"""Number of lines with digits of A to F from which all may be hexadecimal: in fewer,
letters may be damage."""
POWER = re.compile(rb"(?<!\S)\d+[eE]\d+(?!\S)")
"""A number that is a power of ten, or hexadecimal."""
BASES = (
    OptionChange({"base": "10"}, "if they are decimal"),
    *HEXADECIMAL_CHANGES,
)


@final
class NumberTest:
    """Tests whether a number of each line is a time, and in which unit.

    Attributes:
        unit: the unit; empty for none; None while it is not known.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.unit: str | None = None
        self.numbers: list[float] = []
        self.arrivals: list[int] = []

    def add_number(self, number: float, arrived: int, is_time: bool = False) -> None:
        """Add the number of a line, of which is said whether it is a time."""
        if self.numbers and number < self.numbers[-1]:
            # A device that starts over; or a count.
            self.unit = self.unit if is_time else ""
            self.clear()
        self.numbers.append(number)
        self.arrivals.append(arrived)
        span = arrived - self.arrivals[0]
        if len(self.numbers) < MIN_CLOCK_LINES or span < MAX_HELD:
            return
        rate = estimate_slope(self.arrivals, self.numbers)
        steps = [after - before for before, after in pairwise(self.numbers)]
        # Numbers of lines go on by one, at any rate.
        near = [u for u, us in UNITS.items() if 2 / 3 < 1e-6 * us * rate < 3 / 2]
        self.unit = near[0] if near and any(step != 1 for step in steps) else ""
        self.clear()

    def clear(self) -> None:
        """Forget the lines so far."""
        self.numbers.clear()
        self.arrivals.clear()


def estimate_slope(arrivals: Sequence[int], numbers: Sequence[float]) -> float:
    """Estimate how much numbers rise a second, by the arrivals of their lines [ns].

    It is the median over all pairs of lines (Theil, 1950; Sen, 1968), on which lines
    that a busy computer has read late have little effect.
    """
    stride = len(numbers) // MAX_SLOPE_LINES + 1
    times = np.array(arrivals[::stride]) / NS_PER_S
    values = np.array(numbers[::stride])
    i, j = np.triu_indices(len(times), 1)
    apart = times[j] > times[i]
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = (values[j] - values[i])[apart] / (times[j] - times[i])[apart]
        return float(np.median(slopes))


Rising = Literal["first", "last", "neither"]


@final
class StepTest:
    """Tests whether a number rises by the same step from line to line.

    A time and the number of a line do, for as long as lines come; a count that rises
    with a touch does not.

    Attributes:
        rises: whether it does.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.rises = False
        self.number = np.nan
        self.step = np.nan
        self.arrived = 0
        self.began_at = 0
        self.fitted_at = 0
        self.fitting = 0

    def add_number(self, number: float, arrived: int, span: int) -> None:
        """Add the number of a line.

        Args:
            number: the number.
            arrived: time at which the line arrived [ns].
            span: time for which it rises before it is said to rise, and does not rise
                before that is no longer said [ns].
        """
        step = number - self.number
        tolerance = max(1.0, STEP_TOLERANCE * self.step)
        if step > 0 and abs(step - self.step) <= tolerance:
            self.fitting += 1
            self.fitted_at = arrived
            is_long = arrived - self.began_at >= span
            self.rises |= is_long and self.fitting >= MIN_STEPS
        elif not self.rises or arrived - self.fitted_at > span:
            self.rises = False
            self.step = step
            self.fitting = 0
            self.began_at = self.arrived
        self.number = number
        self.arrived = arrived


@final
class EndTest:
    """Tests which number at the ends of lines rises from line to line.

    That number is no count: those beside it do not rise.
    """

    def __init__(self, span: int) -> None:
        """Start without lines.

        Args:
            span: time for which a number rises before it is said to rise [ns].
        """
        self.span = span
        self.tests = {place: StepTest() for place in (0, 1, -2, -1)}

    def add_numbers(self, numbers: Sequence[float], arrived: int) -> None:
        """Add the numbers of a line."""
        for place, test in self.tests.items():
            test.add_number(numbers[place], arrived, self.span)

    @property
    def rising(self) -> Rising:
        """The end whose number rises, of late."""
        first, second, last_but_one, last = (one.rises for one in self.tests.values())
        if first and not (second or last):
            return "first"
        return "last" if last and not (last_but_one or first) else "neither"


@final
class BaseTest:
    """Tests whether the numbers of lines may be hexadecimal.

    Numbers of one width, all of one ten, have digits of 0 to 9 alone in either base.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.is_decimal = False
        self.lettered: deque[bool] = deque(maxlen=LETTER_LINES)
        self.tens: set[bytes] = set()
        self.digits: set[bytes] = set()

    def note_unread(self, body: bytes, sizes: Sequence[int]) -> None:
        """Note whether a line of some size has digits of A to F in several numbers."""
        self.lettered.append(len(find_hexadecimal(body)) in sizes)

    def add_words(self, words: Sequence[bytes]) -> None:
        """Add the words of a line.

        Raises:
            LineError: they may be hexadecimal.
        """
        self.lettered.append(False)
        if sum(self.lettered) >= MIN_LETTERED:
            raise LineError(LineProblem.HEXADECIMAL.reason(), HEXADECIMAL_CHANGES)
        if self.is_decimal:
            return
        self.tens |= {word[:-1] for word in words}
        self.digits |= {word[-1:] for word in words}
        ten = next(iter(self.tens), b"")
        is_one = len(self.tens) == 1 and ten.isdigit() and len(ten) + 1 >= MIN_WIDTH
        self.is_decimal = not is_one
        if is_one and len(self.digits) > 1:
            reason = LineProblem.MAY_BE_HEXADECIMAL.reason(
                digits=len(ten) + 1, begin=ten.decode()
            )
            raise LineError(reason, BASES)


def check_powers(words: Sequence[bytes]) -> None:
    """Raise a LineError if one of some words is a power of ten, or hexadecimal."""
    power = POWER.search(b" ".join(words))
    if power is not None:
        text = power.group().decode()
        raise LineError(LineProblem.POWER_OR_HEXADECIMAL.reason(text=text), BASES)
