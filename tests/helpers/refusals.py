"""These helpers check that bad input is refused, each by a row of a package's table."""

import pytest

REFUSALS = ("error", "call", "parts")
"""Names of the parameters of a row."""


def refusal(name, error, call, *parts):
    """Return a row: its name, the error, what is called, and parts of the message.

    The call takes what the test of the table gives it, which is an empty folder in most
    tables.
    """
    return pytest.param(error, call, parts, id=f"{name:.60}")


def check_refusal(error, call, parts, *given):
    """Check that a call raises the error, in one line that has all parts."""
    with pytest.raises(error) as caught:
        call(*given)
    message = str(caught.value)
    assert all(part in message for part in parts), message
    # The checks of types that run in tests alone add lines of their own.
    assert len(message.partition("(TypeCheckError")[0].splitlines()) == 1, message
