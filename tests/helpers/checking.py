"""Shapes and types are checked in the first calls of each test, and in some later ones.

To check every call takes longer than all that is checked.
"""

import inspect
from collections import Counter
from functools import partial, wraps

import jaxtyping

ALWAYS, EVERY = 2, 100
"""How many calls of a function in a test are checked, and which ones after them."""

check_all = jaxtyping.jaxtyped
calls = Counter()
"""How often each function was called in this test."""


def check_some(function=None, **options):
    """Check a function in some of its calls; used in place of `jaxtyping.jaxtyped`."""
    if function is None:
        return partial(check_some, **options)
    if inspect.isfunction(function):
        return choose(function, partial(check_all, function, **options))
    plain = getattr(function, "__init__", None)
    result = check_all(function, **options)
    if isinstance(result, type) and result.__init__ is not plain:
        checked = result.__init__
        result.__init__ = choose(plain, lambda: checked)
    return result


def choose(plain, build):
    """Return a function that sometimes calls a checked one, built when needed."""
    checked = None

    @wraps(plain)
    def call(*args, **kwargs):
        __tracebackhide__ = True
        nonlocal checked
        calls[call] += 1
        if calls[call] > ALWAYS and calls[call] % EVERY:
            return plain(*args, **kwargs)
        checked = checked or build()
        return checked(*args, **kwargs)

    return call
