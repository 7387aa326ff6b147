"""Reading attributes of URDF elements, with messages that say where they stand."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.transforms import make_transform, rpy_to_matrix

__all__ = ["child", "number", "numbers", "origin", "text"]


def child(element: Element, tag: str, place: str) -> Element:
    """The first child with a tag.

    Raises:
        RobotError: There is none.
    """
    found = element.find(tag)
    if found is None:
        raise RobotError(f"{place} has no <{tag}>; add one")
    return found


def text(element: Element, attribute: str, place: str) -> str:
    """An attribute that must be there.

    Raises:
        RobotError: It is missing or empty.
    """
    value = element.get(attribute, "").strip()
    if not value:
        raise RobotError(f"{place}: <{element.tag}> has no '{attribute}'; add it")
    return value


def numbers(
    element: Element,
    attribute: str,
    place: str,
    count: int,
    default: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """So many finite numbers from an attribute.

    Raises:
        RobotError: They are missing and have no default, or are not so many numbers.
    """
    if default is not None and element.get(attribute) is None:
        return tuple(default)
    given = text(element, attribute, place)
    try:
        values = tuple(float(word) for word in given.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.all(np.isfinite(values)):
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is '{given}'; "
            f"wanted: {count} finite number{'s' if count > 1 else ''}"
        )
    return values


def number(
    element: Element,
    attribute: str,
    place: str,
    default: float | None = None,
    above: float = -np.inf,
) -> float:
    """One finite number from an attribute.

    Raises:
        RobotError: It is missing, no number, or not above what it must exceed.
    """
    default_values = None if default is None else (default,)
    (value,) = numbers(element, attribute, place, 1, default_values)
    if value <= above:
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is {value:g}; "
            f"wanted: more than {above:g}"
        )
    return value


def origin(element: Element, place: str) -> Float[np.ndarray, "4 4"]:
    """The pose in an element's <origin>, or none at all [m].

    Raises:
        RobotError: Its xyz or rpy are not three numbers each.
    """
    found = element.find("origin")
    if found is None:
        return np.eye(4)
    rpy = np.array(numbers(found, "rpy", place, 3, (0.0, 0.0, 0.0)))
    xyz = np.array(numbers(found, "xyz", place, 3, (0.0, 0.0, 0.0)))
    return make_transform(rpy_to_matrix(rpy), xyz)
