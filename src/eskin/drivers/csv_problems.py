"""This module lists why a line of a matrix is refused, and what may help."""

from collections.abc import Sequence
from enum import unique
from typing import NamedTuple, final

from eskin.reasons import Cause, Reason

CHECK_LINE = "check cable, baud rate and what is sent"
"""What a person does about a line that is damaged, or of another kind."""


@unique
class LineProblem(Cause):
    """A problem of a line is why it is refused."""

    NO_SCAN = ("it is no scan", CHECK_LINE)
    NOT_NUMBERS = ("not all of it is numbers", CHECK_LINE)
    LETTERS = (
        "some of its numbers have digits of A to F",
        "check cable and baud rate, or set base=16 if it is hexadecimal",
    )
    COMMAS = (
        "commas may separate or be decimal (with decimal=comma, it has {count} "
        "numbers)",
        CHECK_LINE,
    )
    BROKEN_OBJECT = (
        "it begins as a JSON object and is none with numbers",
        CHECK_LINE,
    )
    OBJECT_WITHOUT_TIME = (
        "its time is missing",
        "name the time 't' or '{unit}' in all lines",
    )
    OBJECT_WITH_TIMES = (
        "which of its numbers is its time is not known: {names}",
        "name the time 't' or '{unit}' in all lines",
    )
    WITHOUT_TIME = ("its time is missing", "send it with all lines")
    TIME_LEAPS = (
        "its time does not go on as the clock of this computer does",
        CHECK_LINE,
    )
    TIME_OF_OTHER_UNIT = ("its time is in {found}, not {unit}", CHECK_LINE)
    TIME_OF_NO_UNIT = ("its time does not go on in {unit}", CHECK_LINE)
    MAY_BE_TIME = (
        "its first number may be a time, which leaves {count} counts",
        CHECK_LINE,
    )
    MAY_BE_TIME_OF_UNIT = (
        "its first number may be a time in {unit}, which leaves {count} counts",
        CHECK_LINE,
    )
    OTHER_LABEL = (
        "it does not begin with '{label}'",
        "correct the label, or leave it out",
    )
    WITHOUT_CHECKSUM = ("it has no checksum, as others had", "send it with all")
    WRONG_CHECKSUM = (
        "its checksum is wrong",
        "send the exclusive or of all bytes before",
    )
    WITHOUT_END_CELL = (
        "its first or its last cell is missing",
        "send nan for a missing cell",
    )
    LAST_RISES = (
        "its last number rises from line to line, its first does not",
        "leave out the last instead: last=ignore",
    )
    FIRST_RISES = (
        "its first number rises from line to line, its last does not",
        "leave out the first instead: time=ignore, or its unit",
    )
    ROWS_WITHOUT_END = (
        "it is one of rows, without a line without numbers after each {rows} of them",
        "send an empty line, or a word, after all rows",
    )
    NUMBERED_ROWS = ("its rows hold their numbers", CHECK_LINE)
    WRONG_COUNT = (
        "it has {count} numbers",
        "send a line a scan, or a line without numbers after all rows",
    )
    OTHER_COUNT = ("it has {count} numbers, others had {others}", CHECK_LINE)
    CELL_NUMBERS = ("its numbers are those of the cells", "send counts")
    FRACTIONS = ("its numbers are fractions below {limit}", CHECK_LINE)
    OUT_OF_RANGE = ("count {count:g} is out of range", CHECK_LINE)
    HEXADECIMAL = (
        "its numbers are hexadecimal, as others had digits of A to F",
        CHECK_LINE,
    )
    MAY_BE_HEXADECIMAL = (
        "its numbers may be hexadecimal: all have {digits} digits and begin with "
        "{begin}",
        CHECK_LINE,
    )
    POWER_OR_HEXADECIMAL = ("'{text}' may be hexadecimal", CHECK_LINE)


class OptionChange(NamedTuple):
    """A change of the options of a port may make its lines readable."""

    options: dict[str, str]
    """New values of options; empty for an option that is left out."""
    condition: str
    """When it is right, as part of a sentence."""


@final
class LineError(Exception):
    """Says why a line is refused, and what may help.

    Attributes:
        reason: why it is refused, and what helps where no change of options does.
        changes: changes of the options by which it might be read.
    """

    def __init__(self, reason: Reason, changes: Sequence[OptionChange] = ()) -> None:
        """Keep both."""
        super().__init__(str(reason))
        self.reason = reason
        self.changes = tuple(changes)
