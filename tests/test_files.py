"""Tests of files that a user names: what is said of a wrong entry."""

import re
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Interval
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from eskin.command.command_map import CommandMap
from eskin.design.maps import MapFile
from eskin.design.spec import SpecFile
from eskin.exports.limits import Limits
from eskin.files import Name, describe_entry_error, describe_first_error
from eskin.live import ModelCard
from eskin.skin.files import SkinManifest

FILES = (CommandMap, Limits, MapFile, ModelCard, SkinManifest, SpecFile)
"""What files hold that pydantic checks."""


@dataclass(config=ConfigDict(extra="forbid"))
class Setting:
    """A setting of one entry."""

    a: int


ENTRIES = (
    Name,
    Setting,
    bool,
    float,
    int,
    str,
    list[int],
    tuple[int, int],
    Literal["pressure", "shear"],
    Annotated[float, Interval(ge=0.0, le=1.0)],
    Annotated[float, Interval(gt=0.0, lt=1.0)],
    Annotated[float, Field(allow_inf_nan=False)],
    Annotated[str, Field(min_length=2, max_length=3)],
    Annotated[list[int], Field(min_length=2, max_length=3)],
)
"""Kinds of their entries."""
WRONG = (None, True, 0, -1, 10**9, "9" * 5000, 0.5, float("nan"))
WRONG += ("", "x", " x", "four", [], [1], [0] * 9, ["x"], {}, {"x": 1}, object())
"""Values that few of them take."""
PYDANTIC = re.compile("[Ii]nput|should|valid|instance|[{}]")
"""Words of pydantic, which speaks to programmers."""


def list_errors(kind: Any, value: object, strict: bool) -> list:
    """Return what pydantic says of a value that is no such entry."""
    try:
        TypeAdapter(kind).validate_python(value, strict=strict)
    except ValidationError as error:
        return error.errors()
    return []


@pytest.mark.parametrize("kind", (*FILES, *ENTRIES), ids=str)
def test_wrong_entry_is_told_as_what_was_got_and_what_is_allowed(kind):
    errors = [
        error
        for value in WRONG
        for strict in (False, True)
        for error in list_errors(kind, value, strict)
    ]
    assert errors
    for error in errors:
        text = describe_entry_error(error, ("x",))
        told = re.fullmatch(r".+: got .+, allowed is (.+)", text)
        assert told or re.search(" is missing; add it$| is not known, allowed x$", text)
        assert not told or not PYDANTIC.search(told[1]), text


def test_file_that_is_no_mapping_is_told_in_plain_words():
    with pytest.raises(ValidationError) as caught:
        Limits.model_validate(3)
    assert describe_first_error(caught.value) == (
        "the file: got 3, allowed is a mapping"
    )


def test_sentence_of_our_own_check_is_told_as_it_is():
    zone = {"link": "arm", "point_mm": [0.0, 0.0, 0.0]}
    with pytest.raises(ValidationError) as caught:
        SpecFile.model_validate({"regions": [zone]})
    text = describe_first_error(caught.value)
    assert text.endswith("; point_mm and radius_mm belong together; give both")


def test_entry_that_is_not_known_is_told_with_those_that_are():
    class Entries(BaseModel):
        model_config = ConfigDict(extra="forbid")

    with pytest.raises(ValidationError) as caught:
        Entries.model_validate({"colour": "red"})
    (error,) = caught.value.errors()
    assert describe_entry_error(error, ("id", "link")) == (
        "colour is not known, allowed id, link"
    )
    assert describe_entry_error(error) == "colour is not known; take it out"
