"""What a skin is: patches on links, and taxels in one fixed order."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

TaxelKind = Literal["pressure", "shear"]


@dataclass(frozen=True)
class Patch:
    """One irregular, replaceable module of skin on one link."""

    id: str
    """Name of the patch, unique in its skin."""

    link: str
    """Name of the robot's link that it is fixed to."""

    address: int
    """Address on the device bus, unique in its skin."""

    rows: int
    """Rows of its electrode grid; not every cell need hold a taxel."""

    columns: int
    """Columns of its electrode grid."""

    kind: TaxelKind = "pressure"
    """What a taxel measures: pressure, or pressure and shear."""

    units: str = "kPa"
    """Units of its calibrated pressure."""


@dataclass(frozen=True, eq=False)
class Skin:
    """All patches of a robot, with their taxels in one fixed order.

    Positions, normals and tangents are in the frame of the taxel's own link.
    """

    name: str
    """Name of the skin."""

    patches: tuple[Patch, ...]
    """The patches, in the order that `patch_index` counts."""

    patch_index: Int[np.ndarray, "taxel"]
    """The patch of each taxel, as an index into `patches`."""

    rows: Int[np.ndarray, "taxel"]
    """Row of each taxel in its patch."""

    columns: Int[np.ndarray, "taxel"]
    """Column of each taxel in its patch."""

    positions: Float[np.ndarray, "taxel 3"]
    """Centre of each taxel in its link's frame [m]."""

    normals: Float[np.ndarray, "taxel 3"]
    """Outward unit normal of each taxel in its link's frame."""

    areas: Float[np.ndarray, "taxel"]
    """Sensing area of each taxel [m2]."""

    tangents: Float[np.ndarray, "taxel 3"]
    """Local x axis of each taxel in its link's frame: unit, across the normal."""

    calibrated: bool = True
    """False where geometry and units are nominal, so that no distance is meant in m."""

    def __post_init__(self) -> None:
        """Refuse arrays whose shapes do not belong together."""
        count = len(self.patch_index)
        wanted = {
            "patch_index": (count,),
            "rows": (count,),
            "columns": (count,),
            "positions": (count, 3),
            "normals": (count, 3),
            "areas": (count,),
            "tangents": (count, 3),
        }
        for name, shape in wanted.items():
            got = np.shape(getattr(self, name))
            if got != shape:
                raise ValueError(
                    f"skin '{self.name}': {name} has shape {got}, allowed {shape} for "
                    f"{count} taxels; give every taxel one entry"
                )

    @property
    def count(self) -> int:
        """Number of taxels."""
        return len(self.patch_index)

    @property
    def link_names(self) -> tuple[str, ...]:
        """The link of each patch."""
        return tuple(patch.link for patch in self.patches)

    @property
    def has_shear(self) -> bool:
        """Whether any patch measures shear."""
        return any(patch.kind == "shear" for patch in self.patches)

    def find_taxels(self, patch_id: str) -> Int[np.ndarray, "part"]:
        """Indices of the taxels of one patch, in order."""
        ids = [patch.id for patch in self.patches]
        if patch_id not in ids:
            raise ValueError(
                f"skin '{self.name}' has no patch '{patch_id}'; "
                f"its patches: {', '.join(ids)}"
            )
        return np.flatnonzero(self.patch_index == ids.index(patch_id))
