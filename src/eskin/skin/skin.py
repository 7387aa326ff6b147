"""This module describes a skin: patches on links, with taxels in one fixed order."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

TaxelKind = Literal["pressure", "shear"]


@dataclass(frozen=True)
class Patch:
    """A patch is one irregular, replaceable module of skin on one link."""

    id: str
    """Name of the patch, unique in its skin."""

    link: str
    """Name of the robot's link that it is mounted on."""

    address: int
    """Address on the device bus, unique in its skin."""

    rows: int
    """Number of rows of its electrode grid; some cells may have no taxel."""

    columns: int
    """Number of columns of its electrode grid."""

    kind: TaxelKind = "pressure"
    """Quantity that a taxel measures: pressure, or pressure and shear."""

    units: str = "kPa"
    """Unit of its calibrated pressure."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A skin holds all patches of a robot, with their taxels in one fixed order.

    Positions, normals and tangents are in the frame of the taxel's own link.
    """

    name: str
    """Name of the skin."""

    patches: tuple[Patch, ...]
    """Patches, in the order of `patch_index`."""

    patch_index: Int[np.ndarray, "taxel"]
    """Index of each taxel's patch in `patches`."""

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
    """Local x axis of each taxel in its link's frame: a unit tangent."""

    calibrated: bool = True
    """False where geometry and units are nominal, so that lengths are not in metres."""

    def __post_init__(self) -> None:
        """Raise where the shapes of the arrays do not match."""
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
        """Return the number of taxels."""
        return len(self.patch_index)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Return the link of each patch."""
        return tuple(patch.link for patch in self.patches)

    @property
    def has_shear(self) -> bool:
        """Return whether any patch measures shear."""
        return any(patch.kind == "shear" for patch in self.patches)

    def find_taxels(self, patch_id: str) -> Int[np.ndarray, "part"]:
        """Return the indices of the taxels of one patch, in order."""
        ids = [patch.id for patch in self.patches]
        if patch_id not in ids:
            raise ValueError(
                f"skin '{self.name}' has no patch '{patch_id}'; "
                f"its patches: {', '.join(ids)}"
            )
        return np.flatnonzero(self.patch_index == ids.index(patch_id))
