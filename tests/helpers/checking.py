"""Shapes and types are checked in the first calls of each test, and in some later ones.

Checks of every call take longer than all that is checked.
"""

import inspect
from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import jaxtyping

ALWAYS, EVERY = 10, 50
"""How many calls of a function in a test are checked, and which ones after them."""

check_all = jaxtyping.jaxtyped
test_number = [0]
"""The number of tests that have begun."""


def check_some(function: Any = None, *, typechecker: Any) -> Any:  # noqa: ANN401
    """Check a function in some of its calls; use as `jaxtyping.jaxtyped`."""
    if function is None:
        return partial(check_some, typechecker=typechecker)
    if inspect.isfunction(function):
        return choose(function, partial(check_all, function, typechecker=typechecker))
    if isinstance(function, type) and "__init__" in vars(function):
        plain = function.__init__
        function = check_all(function, typechecker=typechecker)
        checked = function.__init__
        if checked is not plain:
            function.__init__ = choose(plain, lambda: checked)
        return function
    return check_all(function, typechecker=typechecker)


def choose(plain: Callable, build: Callable[[], Callable]) -> Callable:
    """Return a function that sometimes calls the checked one, built when needed."""
    number, count, checked = -1, 0, None

    @wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:  # noqa: ANN401
        __tracebackhide__ = True
        nonlocal number, count, checked
        if number != test_number[0]:
            number, count = test_number[0], 0
        count += 1
        if count > ALWAYS and count % EVERY:
            return plain(*args, **kwargs)
        if checked is None:
            checked = build()
        return checked(*args, **kwargs)

    return call
