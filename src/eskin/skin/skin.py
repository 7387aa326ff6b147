"""This module describes skins, and computes the poses of their taxels on a robot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinMismatchError
from eskin.robot import Kinematics, Robot
from eskin.units import format_count, format_index

TaxelKind = Literal["pressure", "shear"]


@dataclass(frozen=True)
class Patch:
    """A patch is one replaceable module of skin, of any outline, on one link."""

    id: str
    """Name of the patch, unique in its skin."""
    link: str
    """Name of the link that it is mounted on."""
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

    def describe_cell(self, row: int | None, column: int | None) -> str:
        """Describe a row, a column or, with both, a cell of the patch, with ranges.

        Rows and columns count from 0.
        """
        names = []
        if row is not None:
            names.append(format_index("row", row, self.rows))
        if column is not None:
            names.append(format_index("column", column, self.columns))
        return ", ".join(names)


@dataclass(frozen=True, eq=False)
class Skin:
    """A skin holds all patches of a robot, with their taxels in one fixed order.

    Positions, normals and tangents are in the frame of the taxel's own link.
    """

    name: str
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
        vectors = ("positions", "normals", "tangents")
        for name in ("patch_index", "rows", "columns", "areas", *vectors):
            allowed = (count, 3) if name in vectors else (count,)
            if (got := np.shape(getattr(self, name))) != allowed:
                raise ValueError(
                    f"skin '{self.name}': {name} has shape {got}, allowed {allowed} "
                    f"for {count} taxels; give every taxel one entry"
                )

    def __repr__(self) -> str:
        """Describe the skin in a line."""
        return (
            f"<Skin '{self.name}': {format_count(self.count, 'taxel')} in "
            f"{format_count(len(self.patches), 'patch')}>"
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

    def describe_taxel(self, taxel: int) -> str:
        """Describe the row, the column and the patch of a taxel."""
        patch = self.patches[int(self.patch_index[taxel])]
        cell = patch.describe_cell(int(self.rows[taxel]), int(self.columns[taxel]))
        return f"{cell} of patch '{patch.id}'"

    def find_taxels(self, patch_id: str) -> Int[np.ndarray, "part"]:
        """Return the indices of the taxels of one patch, in order.

        Raises:
            ValueError: The skin has no such patch.
        """
        return np.flatnonzero(self.patch_index == self.find_patches((patch_id,))[0])

    def find_patches(self, names: Sequence[str]) -> tuple[int, ...]:
        """Return the indices of patches, of all where none is named.

        Raises:
            ValueError: The skin has no patch of a name.
        """
        known = [patch.id for patch in self.patches]
        unknown = sorted(set(names) - set(known))
        if unknown:
            raise ValueError(
                f"no patch '{unknown[0]}'; allowed are {', '.join(known)}; name some "
                "of them"
            )
        return tuple(n for n, name in enumerate(known) if not names or name in names)


@final
class MountedSkin:
    """A mounted skin combines a skin with a robot that has all its links.

    Attributes:
        skin: the skin.
        robot: the robot.
        kinematics: forward kinematics of the robot.
        taxel_link_index: index of each taxel's link in `robot.links`.
    """

    def __init__(self, skin: Skin, robot: Robot) -> None:
        """Mount a skin on a robot.

        Raises:
            SkinMismatchError: The robot lacks a link that the skin lies on.
        """
        lacking = sorted(set(skin.link_names) - set(robot.link_names))
        if lacking:
            raise SkinMismatchError(
                f"skin '{skin.name}' lies on links that robot '{robot.name}' does not "
                f"have: {', '.join(lacking)}; its links: "
                f"{', '.join(robot.link_names)}; mount it on the robot it was made for"
            )
        self.skin = skin
        self.robot = robot
        self.kinematics = Kinematics(robot)
        links = np.array([robot.link_index(n) for n in skin.link_names], dtype=np.int64)
        self.taxel_link_index = links[skin.patch_index]

    def place_taxels(
        self,
        q: Float[np.ndarray, "*batch joint"],
        taxels: Int[np.ndarray, "selected"] | None = None,
    ) -> tuple[
        Float[np.ndarray, "*batch selected 3"], Float[np.ndarray, "*batch selected 3"]
    ]:
        """Return positions [m] and outward normals of taxels in the world.

        q is in the order of `robot.joint_names` [rad], or a batch; None takes all
        taxels. Jiang et al. 2025 (section IV-C1) have these poses as features of nodes.
        """
        selected = np.arange(self.skin.count) if taxels is None else taxels
        rotations, origins = self.get_link_poses(q, selected)
        product = "...tij,tj->...ti"
        p_world = np.einsum(product, rotations, self.skin.positions[selected]) + origins
        return p_world, np.einsum(product, rotations, self.skin.normals[selected])

    def compute_frames(
        self,
        q: Float[np.ndarray, "*batch joint"],
        taxels: Int[np.ndarray, "selected"] | None = None,
    ) -> Float[np.ndarray, "*batch selected 3 3"]:
        """Return R_world_taxel, with tangent x, tangent y and normal as columns.

        Arguments are as for `place_taxels`.
        """
        selected = np.arange(self.skin.count) if taxels is None else taxels
        rotations, _ = self.get_link_poses(q, selected)
        x = self.skin.tangents[selected]
        z = self.skin.normals[selected]
        return rotations @ np.stack([x, np.cross(z, x), z], axis=-1)

    def get_link_poses(
        self, q: Float[np.ndarray, "*batch joint"], taxels: Int[np.ndarray, "selected"]
    ) -> tuple[
        Float[np.ndarray, "*batch selected 3 3"], Float[np.ndarray, "*batch selected 3"]
    ]:
        """Return rotation and origin [m] in the world of each selected taxel's link."""
        links = self.taxel_link_index[taxels]
        T_world_link = self.kinematics.poses(q)[..., links, :, :]
        return T_world_link[..., :3, :3], T_world_link[..., :3, 3]
