"""This package trains every method on the same clips and compares their accuracy."""

from lab.comparison.examples import Examples, find_examples
from lab.comparison.methods import (
    METHODS,
    BaselineMethod,
    Method,
    RecogniserMethod,
)
from lab.comparison.results import (
    AnsweredClips,
    MethodResult,
    TrainingTask,
    find_stale,
    read_results,
    run_tasks,
)
from lab.comparison.table import (
    ComparisonRow,
    Lead,
    RunKey,
    build_rows,
    format_gesture_tables,
    format_tables,
)

__all__ = [
    "METHODS",
    "Lead",
    "AnsweredClips",
    "BaselineMethod",
    "Examples",
    "Method",
    "RunKey",
    "RecogniserMethod",
    "MethodResult",
    "ComparisonRow",
    "TrainingTask",
    "read_results",
    "run_tasks",
    "find_examples",
    "find_stale",
    "format_gesture_tables",
    "format_tables",
    "build_rows",
]
