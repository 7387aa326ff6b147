"""This module tests what the numbers in the lines of a matrix mean.

The first or the last may be a time or the number of the line, and all of them may be
hexadecimal.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, final

import numpy as np

from eskin.drivers.csv_lines import (
    HEXADECIMAL_CHANGES,
    UNITS,
    LineError,
    OptionChange,
    find_hexadecimal,
)
from eskin.drivers.sampled_source import MAX_HELD
from eskin.units import NS_PER_S

MIN_CLOCK_LINES = 6
"""Number of lines by which it is tested whether a number of them is a time."""
MAX_SLOPE_LINES = 60
"""Largest number of lines by which it is estimated how much a number rises."""
MIN_WIDTH = 3
"""Number of digits from which numbers of one width may be hexadecimal."""
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
        rises: whether it rises from line to line, as a time or a number of lines does;
            None while it is not known.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.unit: str | None = None
        self.rises: bool | None = None
        self.numbers: list[float] = []
        self.arrivals: list[int] = []

    def push(self, number: float, arrived: int, is_time: bool = False) -> None:
        """Add the number of a line, of which is said whether it is a time."""
        if self.numbers and number < self.numbers[-1]:
            # A device that starts over; or a count.
            self.unit = self.unit if is_time else ""
            self.rises = False
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
        self.rises = all(step > 0 for step in steps)
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
class EndTest:
    """Tests which number at the ends of lines rises from line to line.

    That number is no count: those beside it do not rise.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.places = {0: NumberTest(), 1: NumberTest(), -2: NumberTest()}
        self.places[-1] = NumberTest()

    def push(self, numbers: Sequence[float], arrived: int) -> Rising | None:
        """Add the numbers of a line; return which rises, None while not known."""
        for place, test in self.places.items():
            if test.rises is None:
                test.push(numbers[place], arrived)
        first, second, last_but_one, last = (
            self.places[place].rises for place in (0, 1, -2, -1)
        )
        if None in (first, second, last_but_one, last):
            return None
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
        self.is_hexadecimal = False
        self.tens: set[bytes] = set()
        self.digits: set[bytes] = set()

    def note_unread(self, body: bytes, sizes: Sequence[int]) -> None:
        """Note whether a line of some size has digits of A to F in several numbers."""
        self.is_hexadecimal |= len(find_hexadecimal(body)) in sizes

    def push(self, words: Sequence[bytes]) -> None:
        """Add the words of a line.

        Raises:
            LineError: they may be hexadecimal.
        """
        if self.is_hexadecimal:
            why = "its numbers are hexadecimal, as others had digits of A to F"
            raise LineError(why, HEXADECIMAL_CHANGES)
        power = POWER.search(b" ".join(words))
        if power is not None:
            text = power.group().decode()
            raise LineError(f"'{text}' may be hexadecimal", BASES)
        if self.is_decimal:
            return
        self.tens |= {word[:-1] for word in words}
        self.digits |= {word[-1:] for word in words}
        ten = next(iter(self.tens), b"")
        is_one = len(self.tens) == 1 and ten.isdigit() and len(ten) + 1 >= MIN_WIDTH
        self.is_decimal = not is_one
        if is_one and len(self.digits) > 1:
            raise LineError(
                f"its numbers may be hexadecimal: all have {len(ten) + 1} digits and "
                f"begin with {ten.decode()}",
                BASES,
            )
