"""This module searches for options by which the lines of a matrix are read.

An option is named to a person only after the reader has read with it all lines that
have come.
"""

import re
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence

from eskin.drivers.csv_lines import LineForm, clean_line
from eskin.drivers.csv_problems import LineError, OptionChange

MAX_CHANGES = 3
"""Largest number of changes of the options that are tried together."""
MAX_TRIED = 60
"""Largest number of forms that are tried."""
MAX_LABELS = 4
"""Largest number of labels that are tried."""
TAIL = re.compile(
    rb"(?:[\da-fA-F]{2}\*)?(?:[-+.\d,; \t\[\](){}]|[eE](?=\d)|[nN][aA][nN])*@?"
)
"""The checksum and the numbers at the end of a line, from the last byte on."""
WORD = re.compile(rb"[-+.\da-zA-Z]+")
VARYING = re.compile(r"\d+(?:[:.]\d+)*")
"""What differs in the labels of lines: a number, or a time of day."""

Trial = Callable[[LineForm], list[LineError]]
"""Reads the lines that have come by a form, and returns why lines were refused."""


def find_readable(
    form: LineForm, trial: Trial, labels: Sequence[OptionChange]
) -> list[tuple[LineForm, str]]:
    """Return the forms with the fewest changes that read all lines, and their reasons.

    Args:
        form: form by which lines are refused.
        trial: what tries a form.
        labels: labels that lines may begin with.
    """
    found: list[tuple[LineForm, str]] = []
    queue: deque[tuple[LineForm, tuple[str, ...]]] = deque([(form, ())])
    seen = {form}
    fewest = MAX_CHANGES
    for _ in range(MAX_TRIED):
        if not queue or len(queue[0][1]) > fewest:
            break
        tried, conditions = queue.popleft()
        errors = trial(tried)
        if not errors and tried == form:
            # What was refused is not among the lines that have come last.
            break
        if not errors:
            found.append((tried, " and ".join(filter(None, conditions))))
            fewest = len(conditions)
            continue
        changes = [change for error in errors for change in error.changes]
        if not tried.label:
            changes += labels
        for change in changes:
            next_form = tried.change(change.options)
            if next_form not in seen:
                seen.add(next_form)
                queue.append((next_form, (*conditions, change.condition)))
    times = [one.time for one, _ in found]
    if any(time not in ("", "none", "ignore") for time in times):
        # Where the first number is a time, it is better used than left out.
        found = [pair for pair in found if pair[0].time != "ignore"]
    return found


def describe_forms(found: Sequence[tuple[LineForm, str]]) -> str:
    """Return the advice to give one of some forms; empty where there are none."""
    parts = [f"{form.format()} {condition}".strip() for form, condition in found]
    return f"give {', or '.join(parts)}" if parts else ""


def list_labels(lines: Iterable[bytes], columns: int, whole: int) -> list[OptionChange]:
    """Return the labels that lines with numbers may begin with.

    What differs from line to line is written as *. Where the labels of whole scans are
    a few that come again and again, they may be of several patches, and each is a label
    of its own.

    Args:
        lines: the lines.
        columns: number of columns of the matrix, which a line holds at least.
        whole: numbers that a line holds at least if it is a whole scan.
    """
    found: Counter[str] = Counter()
    sizes: list[int] = []
    for line in map(clean_line, lines):
        tail = TAIL.match(line[::-1])
        assert tail is not None
        start = len(line) - tail.end()
        size = len(WORD.findall(line[start:]))
        label = line[:start].decode("ascii", "replace").strip()
        if size >= columns:
            found[label] += 1
            sizes.append(size)
    unlabelled = found.pop("", 0)
    if unlabelled > found.total():
        # What begins a few of the lines is damage.
        return []
    if len(found) == 1 or (sizes and min(sizes) >= whole and repeats(found)):
        names = [name for name, _ in found.most_common(MAX_LABELS)]
    else:
        starred = Counter(VARYING.sub("*", name) for name in found.elements())
        names = [name for name, _ in starred.most_common(MAX_LABELS)]
    condition = "if those lines are of this patch" if len(names) > 1 else ""
    return [
        OptionChange({"label": name}, condition)
        for name in names
        if name.isprintable() and name.isascii() and "," not in name
    ]


def repeats(found: Counter[str]) -> bool:
    """Return whether each of some labels has come several times."""
    return found.total() >= 3 * len(found)
