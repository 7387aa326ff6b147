"""Tests of durations, and of numbers in messages: counts agree with nouns."""

import ast
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.units import format_count, format_index, seconds_between
from helpers.source import MODULES, parse_module

COMMANDS = [path for path in MODULES if path.parent.name in ("cli", "commands")]


def find_nouns():
    """Return the nouns that are counted anywhere, but for those in variables."""
    calls = (
        node
        for path in MODULES
        for node in parse_module(path)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "format_count"
    )
    nouns = (call.args[1] for call in calls)
    return sorted({noun.value for noun in nouns if isinstance(noun, ast.Constant)})


def find_bare_plurals(path, plurals):
    """Return the texts of a file in which a plural follows a count as it is.

    Formatted numbers are measured, not counted; constants never are 1.
    """
    begins = re.compile(rf" (?:{'|'.join(plurals)})\b")
    for node in parse_module(path):
        parts = node.values if isinstance(node, ast.JoinedStr) else []
        for value, text in zip(parts, parts[1:], strict=False):
            if isinstance(value, ast.FormattedValue) and isinstance(text, ast.Constant):
                counted = value.format_spec is None and begins.match(text.value)
                if counted and not ast.unparse(value.value).isupper():
                    yield ast.unparse(value), text.value


@pytest.mark.parametrize(
    ("noun", "texts"),
    [
        ("reading", ("0 readings", "1 reading", "2 readings")),
        ("patch", ("0 patches", "1 patch", "2 patches")),
        ("press", ("0 presses", "1 press", "2 presses")),
        ("epoch", ("0 epochs", "1 epoch", "2 epochs")),
        (
            "unasked command",
            ("0 unasked commands", "1 unasked command", "2 unasked commands"),
        ),
    ],
)
def test_counts_have_the_number_of_their_noun(noun, texts):
    assert tuple(format_count(count, noun) for count in range(3)) == texts


LINE_NUMBER = re.compile(r"\b(row|column) $", re.IGNORECASE)
"""End of a text that a row's or a column's number follows."""


def find_numbered_lines(path):
    """Return the texts of a file that give the number of a row or column themselves."""
    for node in parse_module(path):
        parts = node.values if isinstance(node, ast.JoinedStr) else []
        for text, value in zip(parts, parts[1:], strict=False):
            if isinstance(text, ast.Constant) and isinstance(value, ast.FormattedValue):
                if LINE_NUMBER.search(text.value):
                    yield text.value, ast.unparse(value)


def test_only_one_function_gives_numbers_of_rows_and_columns():
    # Columns of text files are those that YAML and the header of a table name.
    texts = [
        (path.name, text)
        for path in MODULES
        if path.name not in ("files.py", "taxel_table.py", "tables.py", "table.py")
        for text in find_numbered_lines(path)
    ]
    assert texts == []


@given(st.data())
def test_number_from_0_is_given_with_its_range(data):
    count = data.draw(st.integers(1, 1000))
    index = data.draw(st.integers(0, count - 1))
    found = re.fullmatch(r"row (\d+) of 0 to (\d+)", format_index("row", index, count))
    assert found and list(range(count))[int(found[1])] == index
    assert range(count)[-1] == int(found[2])


def test_commands_print_no_count_before_a_plural_that_does_not_follow_it():
    plurals = {format_count(2, noun).removeprefix("2 ") for noun in find_nouns()}
    for path in COMMANDS:
        assert list(find_bare_plurals(path, plurals)) == [], path


@given(st.integers(0, 2 * 10**18), st.integers(1, 10**11))
def test_limit_in_seconds_decides_as_the_same_limit_in_nanoseconds(start, limit):
    seconds = float(f"{limit}e-9")
    assert seconds_between(start, start + limit) == seconds
    assert seconds_between(start, start + limit - 1) < seconds
    assert seconds_between(start, start + limit + 1) > seconds
