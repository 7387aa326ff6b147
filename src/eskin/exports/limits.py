"""This module reads limits of force and pressure that a user supplies in a file."""

from pathlib import Path
from typing import Annotated

from annotated_types import Interval
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eskin.errors import RecordingError
from eskin.files import (
    MAX_YAML_BYTES,
    Duration,
    Name,
    Pressure,
    describe_first_error,
    load_plain_yaml,
    read_file,
)
from eskin.skin import Skin

STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
Force = Annotated[float, Interval(ge=0.001, le=100_000.0)]  # [N]


class LimitPair(BaseModel):
    """Limits of one kind of contact; one that is left out is not compared."""

    model_config = STRICT
    force: Force | None = None
    """Force of the contact [N]."""
    pressure: Pressure | None = None
    """Greatest pressure [kPa]; 1 N/cm2 is 10 kPa."""


class Region(BaseModel):
    """A region is a part of the skin that one region of the body may meet."""

    model_config = STRICT
    name: Name
    """Name of the body region, for the report."""
    patches: list[Name] = []
    """Patches in it."""
    links: list[Name] = []
    """Links whose patches are in it."""
    transient: LimitPair = LimitPair()
    """Limits of the peak."""
    quasi_static: LimitPair = LimitPair()
    """Limits of a contact that lasts for `quasi_static_after`."""


ELSEWHERE = Region(name="elsewhere")
"""Region of all patches that a file leaves out, without limits."""


class Limits(BaseModel):
    """Limits hold what each region of the skin is compared with."""

    model_config = STRICT
    source: Name
    """Where the numbers are from, for the report."""
    quasi_static_after: Duration
    """Time for which a force or pressure is held to count as quasi-static [s]."""
    regions: Annotated[list[Region], Field(min_length=1, max_length=100)]

    def find_regions(self, skin: Skin) -> list[Region]:
        """Return the region of each patch of a skin; one in none is in `ELSEWHERE`.

        Raises:
            ValueError: a region names what the skin has not, or a patch is in two.
        """
        found: list[Region | None] = [None] * len(skin.patches)
        ids = [patch.id for patch in skin.patches]
        links = [patch.link for patch in skin.patches]
        for region in self.regions:
            for kind, given, known in (
                ("patch", region.patches, ids),
                ("link", region.links, links),
            ):
                unknown = [name for name in given if name not in known]
                if unknown:
                    raise ValueError(
                        f"region '{region.name}' has {kind} '{unknown[0]}'; allowed "
                        f"are {', '.join(dict.fromkeys(known))}"
                    )
            for number, patch in enumerate(skin.patches):
                if patch.id not in region.patches and patch.link not in region.links:
                    continue
                other = found[number]
                if other is not None:
                    raise ValueError(
                        f"patch '{patch.id}' is in '{other.name}' and "
                        f"'{region.name}'; allowed is one region a patch; name the "
                        "patches of one of them"
                    )
                found[number] = region
        return [region or ELSEWHERE for region in found]


def build_open_limits(skin: Skin, quasi_static_after: float) -> Limits:
    """Build regions without limits, one a link."""
    links = dict.fromkeys(patch.link for patch in skin.patches)
    regions = [Region(name=link, links=[link]) for link in links]
    return Limits(source="none", quasi_static_after=quasi_static_after, regions=regions)


def read_limits(path: Path, skin: Skin) -> Limits:
    """Read the limits for a skin.

    Raises:
        RecordingError: the file cannot be read, is no limits, or does not fit the skin.
    """
    try:
        text = read_file(path, MAX_YAML_BYTES).decode()
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be read ({error.strerror}); allowed is a YAML file of "
            "limits"
        ) from error
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path}: byte {error.start} is no UTF-8; save it as UTF-8"
        ) from None
    try:
        limits = Limits.model_validate(load_plain_yaml(text))
        limits.find_regions(skin)
    except ValidationError as error:
        raise RecordingError(f"{path}: {describe_first_error(error)}") from None
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    return limits
