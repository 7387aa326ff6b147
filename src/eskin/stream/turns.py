"""How long one of Python's threads may keep the others waiting."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

TURN = 0.0005
"""Python gives a thread 5 ms before another may go on: at 1 kHz, five readings [s]."""


@contextmanager
def short_turns() -> Iterator[None]:
    """Let threads of this process take turns sooner; as before at the end.

    It holds for the whole process, so programs choose it, not the library.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
