"""Shapes and types are checked in the first calls of each test, and in some later ones.

To check every call takes longer than all that is checked.
"""

import inspect
from functools import partial, wraps

import jaxtyping

ALWAYS = 2
EVERY = 100
"""How many calls of a function in a test are checked, and which ones after them."""

check_all = jaxtyping.jaxtyped
called = []
"""What begins to count the calls of each function anew that this test has called."""


def begin_test():
    """Count the calls of every function from 0."""
    for restart in called:
        restart()
    called.clear()


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
    count = 0

    def restart():
        nonlocal count
        count = 0

    @wraps(plain)
    def call(*args, **kwargs):
        __tracebackhide__ = True
        nonlocal checked, count
        count += 1
        if count > ALWAYS and count % EVERY:
            return plain(*args, **kwargs)
        if count == 1:
            called.append(restart)
        checked = checked or build()
        return checked(*args, **kwargs)

    return call
