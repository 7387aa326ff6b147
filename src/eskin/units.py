"""Units that more than one package converts between, and counts in messages."""

NS_PER_S = 1_000_000_000
"""Nanoseconds in one second; stamps are in nanoseconds, durations in seconds."""


def format_count(count: object, noun: str) -> str:
    """Return a count with its noun, such as `1 reading` or `0 touches`.

    Args:
        count: the whole number of things.
        noun: what one of them is called.
    """
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}{'es' if noun.endswith(('tch', 'uch', 's', 'x')) else 's'}"
