"""Reading mesh files that a URDF names."""

import importlib
from pathlib import Path

import numpy as np

from eskin.errors import RobotError
from eskin.robot.shapes import TriangleMesh

__all__ = ["load_mesh"]


def load_mesh(
    uri: str, folder: Path, scale: tuple[float, ...], place: str
) -> TriangleMesh:
    """Read a mesh file through trimesh, which the extra `models` brings.

    Args:
        uri: A path, `file://` or `package://` address, as in the URDF.
        folder: The URDF's folder.
        scale: Factors along x, y and z.
        place: Where in the URDF the mesh is named, for messages.

    Raises:
        RobotError: trimesh is not installed, or the file is missing or no mesh.
    """
    path = resolve(uri, folder, place)
    try:
        trimesh = importlib.import_module("trimesh")
    except ImportError:
        raise RobotError(
            f"{place} has mesh {uri}, which needs trimesh: "
            "pip install 'eskin[models]', or load the URDF with meshes=False"
        ) from None
    try:
        mesh = trimesh.load(path, force="mesh")
        vertices = np.asarray(mesh.vertices, dtype=np.float64) * np.array(scale)
        faces = np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's readers raise whatever their formats do.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RobotError(f"{place}: {path} is no mesh ({reason})") from None
    if not len(faces):
        raise RobotError(f"{place}: mesh {path} holds no triangles; give one that does")
    # A mirroring scale turns triangles inside out.
    return TriangleMesh(vertices, faces[:, ::-1] if np.prod(scale) < 0 else faces)


def resolve(uri: str, folder: Path, place: str) -> Path:
    """The file that an address in a URDF means."""
    if uri.startswith("package://"):
        relative = uri.removeprefix("package://")
        # A package's folder may bear another name than the package: try without too.
        inside = relative.partition("/")[2]
        above = (folder, *folder.parents)
        candidates = [base / path for path in (relative, inside) for base in above]
    else:
        candidates = [folder / uri.removeprefix("file://")]
    found = next((path for path in candidates if path.is_file()), None)
    if found is None:
        raise RobotError(
            f"{place}: mesh {uri} is not in {folder}"
            f"{' or any folder above' if len(candidates) > 1 else ''}; put it there"
        )
    return found
