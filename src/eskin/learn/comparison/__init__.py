"""Every method on the same clips: what is trained, what it answers, tables."""

from eskin.learn.comparison.examples import Examples, find_examples
from eskin.learn.comparison.methods import (
    ABLATIONS,
    METHODS,
    BaselineMethod,
    Method,
    RecogniserMethod,
)
from eskin.learn.comparison.results import Answered, Result, Task, do_all
from eskin.learn.comparison.table import (
    Ahead,
    Place,
    Row,
    gestures_markdown,
    markdown,
    rows_of,
)

__all__ = [
    "ABLATIONS",
    "METHODS",
    "Ahead",
    "Answered",
    "BaselineMethod",
    "Examples",
    "Method",
    "Place",
    "RecogniserMethod",
    "Result",
    "Row",
    "Task",
    "do_all",
    "find_examples",
    "gestures_markdown",
    "markdown",
    "rows_of",
]
