"""This module saves the map between the drawing of a patch and its link.

A file holds one map as JSON: a plane or a tube by its pose, any other surface by the
triangles around the patch, on the link and in the plane.
"""

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eskin.design.patches import PatchLayout
from eskin.design.unroll import UnrolledMesh
from eskin.errors import SkinError
from eskin.files import atomic_path, describe_first_error, read_file
from eskin.skin import Plane, Surface, Tube

MAX_MAP_BYTES = 64 << 20
"""Largest size of a file [bytes]."""
MARGIN = 1.0
"""Distance around the cells of a patch of which the triangles are kept [pitches]."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]


class MapFile(BaseModel):
    """A map file holds one surface; lengths are in metres, in the frame of the link."""

    model_config = ConfigDict(extra="forbid")

    version: Literal[1] = 1
    link: str
    surface: Literal["plane", "tube", "mesh"]
    T_link_surface: Annotated[list[Row], Field(min_length=4, max_length=4)] | None = (
        None
    )
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    vertices: list[Vector] | None = None
    normals: list[Vector] | None = None
    faces: list[Annotated[list[int], Field(min_length=3, max_length=3)]] | None = None
    flat: list[Annotated[list[Number], Field(min_length=2, max_length=2)]] | None = None

    def build(self) -> Surface:
        """Build the surface.

        Raises:
            ValueError: An entry is missing, or does not fit the others.
        """
        if self.surface == "mesh":
            return self.build_mesh()
        if self.T_link_surface is None or (self.surface == "tube") == (not self.radius):
            raise ValueError(
                f"surface is {self.surface}; allowed are a plane with T_link_surface, "
                "and a tube with T_link_surface and radius"
            )
        pose = np.array(self.T_link_surface)
        return Plane(pose) if self.radius is None else Tube(self.radius, pose)

    def build_mesh(self) -> UnrolledMesh:
        """Build a surface of triangles."""
        vertices, normals, flat = (
            np.array(rows or [], dtype=np.float64)
            for rows in (self.vertices, self.normals, self.flat)
        )
        faces = np.array(self.faces or [], dtype=np.int64)
        count = len(vertices)
        if not count or not len(faces) or not len(normals) == len(flat) == count:
            raise ValueError(
                f"a mesh of {count} vertices, {len(normals)} normals, {len(flat)} flat "
                f"points and {len(faces)} faces; allowed are as many of the first "
                "three, and one face or more"
            )
        if faces.min() < 0 or faces.max() >= count:
            raise ValueError(
                f"a face has vertex {faces.max()}; allowed are 0 to {count - 1}"
            )
        return UnrolledMesh(vertices, normals, faces, flat)


def save_map(path: Path, link: str, layout: PatchLayout) -> None:
    """Write the map of a patch.

    Args:
        path: the file.
        link: link that the patch lies on.
        layout: layout of the patch.
    """
    match layout.surface:
        case UnrolledMesh() as mesh:
            facts = describe_mesh(mesh, find_faces_around(mesh, layout))
        case Tube() as tube:
            facts = {"surface": "tube", "radius": tube.radius}
            facts["T_link_surface"] = tube.T_link_surface.tolist()
        case plane:
            facts = {"surface": "plane"}
            facts["T_link_surface"] = plane.T_link_surface.tolist()
    with atomic_path(path) as part:
        text = json.dumps({"version": 1, "link": link, **facts})
        part.write_text(text + "\n", encoding="utf-8")


def find_faces_around(
    mesh: UnrolledMesh, layout: PatchLayout
) -> Bool[np.ndarray, "face"]:
    """Find the triangles of a mesh that lie near the cells of a patch."""
    flat = layout.grid.unrolled()
    grid = layout.grid
    reach = (0.5 + MARGIN) * max(grid.row_pitch, grid.column_pitch)
    low, high = flat.min(axis=0) - reach, flat.max(axis=0) + reach
    corners = mesh.flat[mesh.faces]
    beyond = (corners.max(axis=1) < low) | (corners.min(axis=1) > high)
    return ~beyond.any(axis=1)


def describe_mesh(
    mesh: UnrolledMesh, kept: Bool[np.ndarray, "face"]
) -> dict[str, object]:
    """Return the entries of some triangles of a mesh."""
    used, faces = np.unique(mesh.faces[kept], return_inverse=True)
    return {
        "surface": "mesh",
        "vertices": mesh.vertices[used].tolist(),
        "normals": mesh.normals[used].tolist(),
        "faces": faces.reshape(-1, 3).tolist(),
        "flat": mesh.flat[used].tolist(),
    }


def load_map(path: Path) -> tuple[str, Surface]:
    """Load what `save_map` wrote.

    Returns:
        The link, and the surface: `wrap` maps places of the drawing [m] to the link,
        `unroll` maps places of the link to the drawing.

    Raises:
        SkinError: The file cannot be read, or has an error.
    """
    try:
        entries = MapFile.model_validate_json(read_file(path, MAX_MAP_BYTES))
        return entries.link, entries.build()
    except OSError as error:
        raise SkinError(f"cannot read {path}: {error.strerror}") from None
    except ValidationError as error:
        raise SkinError(
            f"{path}: {describe_first_error(error)}; allowed is a map that `eskin skin "
            "design` wrote; design the skin again"
        ) from None
    except ValueError as error:
        raise SkinError(f"{path}: {error}; design the skin again") from None
