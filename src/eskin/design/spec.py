"""This module describes what skin is asked for, and reads it from a YAML file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from eskin.design.zones import (
    BallZone,
    BoxZone,
    LinkZone,
    PaintedZone,
    Vector,
    Zone,
)
from eskin.errors import SkinError
from eskin.files import (
    MAX_YAML_BYTES,
    Name,
    atomic_path,
    describe_first_error,
    load_plain_yaml,
    read_file,
)

PER_CM2 = 1e4
"""Number of square centimetres in one square metre."""
MM = 1e-3
MAX_BALLS = 2000
"""Largest number of balls of a specification, which limits on its values allow."""


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
    """Smallest distance of the skin from other links, while one joint moves [m]."""
    poses: int = 256
    """Number of combined poses, of all joints at once, in which it is checked too."""
    clears_poses: bool = False
    """Whether taxels nearer in a combined pose are left out, or only reported."""
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


Ball = Annotated[list[float], Field(min_length=4, max_length=4)]


class ZoneEntry(BaseModel):
    """An entry describes a zone of a link in a specification."""

    model_config = ConfigDict(extra="forbid", strict=True)

    link: Name
    box_mm: Annotated[list[list[float]], Field(min_length=2, max_length=2)] | None = (
        None
    )
    point_mm: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    radius_mm: Annotated[float, Field(gt=0)] | None = None
    balls_mm: Annotated[list[Ball], Field(min_length=1)] | None = None
    """Balls as x, y, z and radius, as they are painted."""

    @model_validator(mode="after")
    def check_shape(self) -> "ZoneEntry":
        """Raise where the zone is none of a link, a box, a ball and some balls."""
        if (self.point_mm is None) != (self.radius_mm is None):
            raise ValueError("point_mm and radius_mm belong together; give both")
        shapes = (self.box_mm, self.point_mm, self.balls_mm)
        if sum(shape is not None for shape in shapes) > 1:
            raise ValueError("a zone is a box, a ball or some balls; give one of them")
        if self.balls_mm is not None and min(ball[3] for ball in self.balls_mm) <= 0:
            raise ValueError("a ball of balls_mm has a radius above 0")
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
        if self.balls_mm is not None:
            balls = [
                BallZone(self.link, to_vector(ball[:3]), MM * ball[3])
                for ball in self.balls_mm
            ]
            return PaintedZone(self.link, tuple(balls))
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

    def build(self, density: float) -> tuple[tuple[RegionSpec, ...], tuple[Zone, ...]]:
        """Build regions and keep-out zones; see `read_spec`."""
        regions = tuple(
            RegionSpec(
                entry.build(),
                density
                if entry.density_per_cm2 is None
                else PER_CM2 * entry.density_per_cm2,
            )
            for entry in self.regions
        )
        return regions, tuple(entry.build() for entry in self.keep_out)


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
    return read_spec_file(path).build(density)


def read_spec_file(path: Path) -> SpecFile:
    """Read the entries of a YAML file; errors are as of `read_spec`."""
    try:
        data = load_plain_yaml(read_file(path, MAX_YAML_BYTES).decode())
        return SpecFile.model_validate(data)
    except OSError as error:
        raise SkinError(f"cannot read {path}: {error.strerror}") from None
    except ValidationError as error:
        raise SkinError(
            f"{path}: {describe_first_error(error)}; allowed are regions and keep_out, "
            "each a list of {link, and box_mm, or point_mm and radius_mm, or "
            "balls_mm}, regions with density_per_cm2 too"
        ) from None
    except ValueError as error:
        raise SkinError(f"{path}{error}") from None


def write_spec_file(path: Path, entries: SpecFile) -> None:
    """Write the entries of a specification as YAML."""
    data = entries.model_dump(exclude_none=True)
    text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8")
