"""This module defines reasons: why something is done, held or refused, as data.

A reason is a cause, which is a member of an enum, and its values. Programs compare
causes. The sentence that a person reads is made here alone, and nobody reads it back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import final


class Cause(Enum):
    """A cause is why something is done, held or refused; packages define their own.

    A member is a text that says what is the case, and one that says what a person does
    about it. Both may have the values of a reason in braces, as `str.format` has them.

    Attributes:
        what: what is the case.
        remedy: what a person does about it; empty where there is nothing to do.
    """

    def __init__(self, what: str, remedy: str = "") -> None:
        """Keep both texts."""
        self.what = what
        self.remedy = remedy

    @property
    def words(self) -> str:
        """Its name in words, the same whatever the values are."""
        return self.name.lower().replace("_", " ")

    def reason(self, **values: object) -> "Reason":
        """Return a reason of this cause.

        Args:
            values: what its texts have in braces, by its name.

        Raises:
            KeyError: one of these is missing.
        """
        return Reason(self, values)


@final
@dataclass(frozen=True)
class Reason:
    """A reason is a cause with its values; as a text, it is a sentence and a remedy.

    Raises:
        KeyError: a value is missing that the texts of the cause name.
    """

    cause: Cause
    """The cause, by which reasons are told apart."""

    values: Mapping[str, object] = field(default_factory=dict)
    """What the texts of the cause have in braces, by its name."""

    def __post_init__(self) -> None:
        """Refuse values with which there is no sentence."""
        str(self)

    @property
    def what(self) -> str:
        """What is the case."""
        return self.cause.what.format_map(self.values)

    @property
    def remedy(self) -> str:
        """What a person does about it; empty where there is nothing to do."""
        return self.cause.remedy.format_map(self.values)

    def __str__(self) -> str:
        """Return what is the case, and what to do about it."""
        remedy = self.remedy
        return f"{self.what}; {remedy}" if remedy else self.what
