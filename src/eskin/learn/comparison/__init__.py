"""Every method on the same clips: what is trained, what it answers, tables."""

from eskin.learn.comparison.examples import Examples, find_examples
from eskin.learn.comparison.methods import (
    ABLATIONS,
    METHODS,
    BaselineMethod,
    Method,
    RecogniserMethod,
)
from eskin.learn.comparison.results import Answered, Result, Task, run_tasks
from eskin.learn.comparison.table import (
    Lead,
    Place,
    Row,
    format_gesture_tables,
    format_tables,
    rows_of,
)

__all__ = [
    "ABLATIONS",
    "METHODS",
    "Lead",
    "Answered",
    "BaselineMethod",
    "Examples",
    "Method",
    "Place",
    "RecogniserMethod",
    "Result",
    "Row",
    "Task",
    "run_tasks",
    "find_examples",
    "format_gesture_tables",
    "format_tables",
    "rows_of",
]
