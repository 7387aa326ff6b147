"""The folder of the examples, for the tests that run them."""

from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
