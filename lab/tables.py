"""This module formats tables in Markdown."""

from collections.abc import Sequence


def format_head(names: Sequence[str]) -> str:
    """Format the head of a table, and the line below it."""
    return f"{format_row(names)}\n{'|---' * len(names)}|"


def format_row(cells: Sequence[str]) -> str:
    """Format cells as a row of a table."""
    return f"| {' | '.join(cells)} |"
