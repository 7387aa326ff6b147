"""This module describes what skin is asked for, and reads it from a YAML file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from eskin.design.zones import BallZone, BoxZone, LinkZone, Vector, Zone
from eskin.errors import SkinError
from eskin.files import read_file
from eskin.plain_yaml import (
    MAX_YAML_BYTES,
    Name,
    format_entry_path,
    load_plain_yaml,
    shorten,
)

PER_CM2 = 1e4
"""Number of square centimetres in one square metre."""
MM = 1e-3


@dataclass(frozen=True)
class DesignLimits:
    """Limits hold for the whole skin."""

    min_spacing: float = 0.0025
    """Smallest distance of neighbouring taxels [m]."""
    max_rows: int = 16
    """Largest number of rows that a readout board reads."""
    max_columns: int = 16
    """Largest number of columns that a readout board reads."""
    max_distortion: float = 0.08
    """Largest relative error of the unrolled distance of neighbouring taxels."""
    clearance: float = 0.003
    """Smallest distance of the skin from other links, at all joint values [m]."""
    min_exposure: float = 0.35
    """Smallest fraction of the directions from which a place can be touched."""
    max_bend: float = 0.7
    """Largest angle of an edge of the surface over which a patch is bent [rad]."""
    min_taxels: int = 8
    """Smallest number of taxels of a patch."""
    rate: float = 100.0
    """Rate at which the skin is read, for the bandwidth [Hz]."""


@dataclass(frozen=True)
class RegionSpec:
    """A region of a link is to be covered at one density."""

    zone: Zone
    """Link, or part of it, that is to be covered."""
    density: float
    """Number of taxels per area [1/m2]."""


@dataclass(frozen=True)
class DesignSpec:
    """A specification says where skin is asked for, and at which density."""

    name: str
    """Name of the skin."""
    regions: tuple[RegionSpec, ...]
    """Regions to cover; where several hold a place, the first counts."""
    keep_outs: tuple[Zone, ...] = ()
    """Zones without skin, such as screws, plugs and cables."""
    limits: DesignLimits = field(default_factory=DesignLimits)


class ZoneEntry(BaseModel):
    """An entry describes a zone of a link in a specification."""

    model_config = ConfigDict(extra="forbid", strict=True)

    link: Name
    box_mm: Annotated[list[list[float]], Field(min_length=2, max_length=2)] | None = (
        None
    )
    point_mm: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    radius_mm: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def check_shape(self) -> "ZoneEntry":
        """Raise where the zone is neither a link, nor a box, nor a ball."""
        if (self.point_mm is None) != (self.radius_mm is None):
            raise ValueError("point_mm and radius_mm belong together; give both")
        if self.box_mm is not None and self.point_mm is not None:
            raise ValueError("a zone is a box or a ball; give one of them")
        if self.box_mm is not None:
            low, high = self.box_mm
            if not len(low) == len(high) == 3 or any(
                a >= b for a, b in zip(low, high, strict=False)
            ):
                raise ValueError(
                    "box_mm is [[x, y, z], [x, y, z]], the smallest corner first"
                )
        return self

    def build(self) -> Zone:
        """Build the zone, in metres."""
        if self.box_mm is not None:
            low, high = map(to_vector, self.box_mm)
            return BoxZone(self.link, low, high)
        if self.point_mm is not None and self.radius_mm is not None:
            return BallZone(self.link, to_vector(self.point_mm), MM * self.radius_mm)
        return LinkZone(self.link)


class RegionEntry(ZoneEntry):
    """An entry describes a region in a specification."""

    density_per_cm2: Annotated[float, Field(gt=0, le=1e4)] | None = None


class SpecFile(BaseModel):
    """A specification file holds regions and keep-out zones."""

    model_config = ConfigDict(extra="forbid", strict=True)

    version: Annotated[int, Field(ge=1, le=1)] = 1
    regions: list[RegionEntry] = []
    keep_out: list[ZoneEntry] = []


def to_vector(numbers: list[float]) -> Vector:
    """Return three numbers in millimetres as metres."""
    x, y, z = (MM * number for number in numbers)
    return (x, y, z)


def read_spec(
    path: Path, density: float
) -> tuple[tuple[RegionSpec, ...], tuple[Zone, ...]]:
    """Read regions and keep-out zones from a YAML file.

    Args:
        path: the file.
        density: density of the regions that give none [1/m2].

    Raises:
        SkinError: The file cannot be read, or has an error.
    """
    try:
        data = load_plain_yaml(read_file(path, MAX_YAML_BYTES).decode())
        entries = SpecFile.model_validate(data)
    except OSError as error:
        raise SkinError(f"cannot read {path}: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = format_entry_path(first["loc"]) or "the file"
        raise SkinError(
            f"{path}: {where}: {first['msg']}, got {shorten(first['input'])}; allowed "
            "are regions and keep_out, each a list of {link, and box_mm, or point_mm "
            "and radius_mm}, regions with density_per_cm2 too"
        ) from None
    except ValueError as error:
        raise SkinError(f"{path}{error}") from None
    regions = tuple(
        RegionSpec(
            entry.build(),
            density
            if entry.density_per_cm2 is None
            else PER_CM2 * entry.density_per_cm2,
        )
        for entry in entries.regions
    )
    return regions, tuple(entry.build() for entry in entries.keep_out)
