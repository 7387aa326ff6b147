"""This module reads the mesh files of a URDF, within its packages and within limits."""

import os
from contextlib import suppress
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, final
from xml.etree import ElementTree

import numpy as np

from eskin.errors import RobotError
from eskin.files import parse_number, read_file
from eskin.registry import advise_install
from eskin.robot.shapes import TriangleMesh

READERS = {"trimesh": "trimesh", "collada": "pycollada"}
"""Packages that read meshes, by the modules that they install; the second for `.dae`.
"""
FORMATS = (".stl", ".obj", ".ply", ".off", ".dae")
"""Suffixes of mesh files that are read: one file each, none of them compressed."""
MAX_MESH_BYTES = 32 << 20
"""Largest size of a mesh file [bytes]."""
MAX_ROBOT_BYTES = 256 << 20
"""Largest size of all mesh files of a robot [bytes]."""
MAX_TRIANGLES = 1_000_000
"""Largest number of triangles of all meshes of a robot, repeated ones included."""
MAX_INSTANCES = 8
"""Largest number of parts that a COLLADA file repeats: each may double its size."""
PACKAGE_FILE = "package.xml"
"""File in the folder of every ROS package."""
URDF_FOLDERS = ("urdf", "robots")
"""Names of folders for the URDFs of a package; the package is the folder around."""
MESH_FOLDERS = ("meshes", "mesh", "assets")
"""Names of folders beside the folder of the URDF in which meshes may lie."""


@final
class MeshReader:
    """Reads the meshes of one URDF with trimesh and pycollada (extra `design`).

    A mesh lies in the folder of the URDF, in one named `meshes` beside it, in a package
    around the URDF, or in a package that a `package://` address names. A package is a
    folder with `package.xml`, the folder around one named `urdf`, or a folder above
    that has the package's name.
    """

    def __init__(self, folder: Path) -> None:
        """Start without meshes, for a URDF in a folder."""
        self.folder = folder
        self.packages = find_packages(folder)
        self.files: dict[Path, TriangleMesh] = {}
        self.bytes = self.triangles = 0

    def read(self, address: str, scale: tuple[float, ...], place: str) -> TriangleMesh:
        """Read a mesh, scaled along x, y and z.

        Args:
            address: path, `file://` or `package://` address.
            scale: factors along x, y and z.
            place: where in the URDF it is given, for messages.

        Raises:
            RobotError: there is no such mesh, or it cannot be used.
        """
        path = self.find(address, place)
        if path not in self.files:
            data = self.read_bytes(path, place)
            for module, package in READERS.items():
                if module == "trimesh" or path.suffix.lower() == ".dae":
                    check_reader(module, package, path, place)
            self.files[path] = parse_mesh(data, path, place)
        found = self.files[path]
        self.triangles += len(found.faces)
        check_triangles(self.triangles, path, place)
        if not np.all(scale):
            raise RobotError(
                f"{place}: <mesh> scale is '{' '.join(f'{s:g}' for s in scale)}'; "
                "wanted: three numbers other than 0"
            )
        with np.errstate(over="ignore"):
            vertices = found.vertices * np.array(scale)
        # A mirroring scale turns triangles inside out.
        mirrored = np.prod(np.sign(scale)) < 0
        return TriangleMesh(vertices, found.faces[:, ::-1] if mirrored else found.faces)

    def read_bytes(self, path: Path, place: str) -> bytes:
        """Read a file, and count its size."""
        if path.suffix.lower() not in FORMATS:
            raise RobotError(
                f"{place}: mesh {path} is no {', '.join(FORMATS)}; convert it to one"
            )
        try:
            data = read_file(path, MAX_MESH_BYTES)
        except OSError as error:
            raise RobotError(
                f"{place}: mesh {path} cannot be read: {error.strerror}"
            ) from None
        self.bytes += len(data)
        if self.bytes > MAX_ROBOT_BYTES:
            raise RobotError(
                f"{place}: meshes up to {path} have {self.bytes:,} bytes; allowed are "
                f"{MAX_ROBOT_BYTES:,}; simplify them"
            )
        return data

    def find(self, address: str, place: str) -> Path:
        """Return the file of an address, with symbolic links followed."""
        roots = [self.folder, *self.packages]
        candidates = [self.folder / address.removeprefix("file://")]
        if address.startswith("package://"):
            name, _, inside = address.removeprefix("package://").partition("/")
            above = (self.folder, *self.folder.parents)
            named = [base / name for base in above]
            candidates = [base / inside for base in (*named, *roots)]
            roots += [base for base in named if is_package(base) or base in above]
        beside = (self.folder.parent / name for name in MESH_FOLDERS)
        roots += [base for base in beside if not base.is_symlink()]
        try:
            found = [path.resolve() for path in candidates if path.exists()]
        except (OSError, RuntimeError, ValueError):  # A loop of links, a zero byte.
            found = []
        if not found:
            raise RobotError(
                f"{place}: mesh {address} is not in {self.folder} nor in its packages; "
                "put it there"
            )
        # A root that is a link to elsewhere is followed, a mesh in it not out of it.
        inside_roots = [
            path
            for path in found
            if any(path.is_relative_to(root.resolve()) for root in roots)
        ]
        if not inside_roots:
            around = Path(os.path.commonpath([found[0], self.folder.resolve()]))
            allow = (
                f", or an empty {PACKAGE_FILE} into {around}, which allows its meshes"
            )
            raise RobotError(
                f"{place}: mesh {address} is {found[0]}, outside {self.folder} and its "
                f"packages; put it there{allow if around.name else ''}"
            )
        return inside_roots[0]


def find_packages(folder: Path) -> list[Path]:
    """Return the packages that a URDF's folder belongs to, the innermost first."""
    above = (folder, *folder.parents)
    packages = [base for base in above if is_package(base)]
    return packages or [folder.parent] * (folder.name in URDF_FOLDERS)


def is_package(folder: Path) -> bool:
    """Return whether a folder is a ROS package."""
    return (folder / PACKAGE_FILE).is_file()


def check_reader(module: str, package: str, path: Path, place: str) -> None:
    """Raise where a package that reads a mesh is missing."""
    try:
        import_module(module)
    except ImportError:
        raise RobotError(
            f"{place}: mesh {path} cannot be read: needs {package}; "
            f"{advise_install('design')}"
        ) from None


def parse_mesh(data: bytes, path: Path, place: str) -> TriangleMesh:
    """Parse a mesh file, whose triangles are joined.

    Lengths are in the unit of the file; a COLLADA file tells it. Its `<up_axis>` is
    ignored, as RViz, MoveIt and Pinocchio do: coordinates are those of the link.
    """
    trimesh = import_module("trimesh")
    suffix = path.suffix.lower()
    unit = 1.0
    if suffix == ".dae":
        check_collada(data, path, place)
    try:
        if suffix == ".dae":
            unit = read_collada_unit(data, path, place)
        # Without a resolver, no further file that this one names is opened.
        loaded = trimesh.load(BytesIO(data), file_type=suffix[1:], resolver=None)
        check_triangles(count_triangles(loaded), path, place)
        mesh = loaded.to_mesh() if hasattr(loaded, "geometry") else loaded
        vertices = unit * np.asarray(mesh.vertices, dtype=np.float64)
        faces = np.asarray(mesh.faces, dtype=np.int64)
    except RobotError:
        raise
    except Exception as error:  # trimesh's readers raise anything.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RobotError(f"{place}: {path} is no mesh ({reason:.200})") from None
    if not len(faces):
        raise RobotError(f"{place}: mesh {path} holds no triangles; give one that does")
    if not (np.isfinite(vertices).all() and 0 <= faces.min() <= faces.max()):
        raise RobotError(f"{place}: mesh {path} has vertices that are not finite")
    if faces.max() >= len(vertices):
        raise RobotError(f"{place}: mesh {path} has triangles without their vertices")
    return TriangleMesh(vertices, faces)


def count_triangles(loaded: Any) -> int:  # noqa: ANN401
    """Return the number of triangles of a mesh or scene, before it is joined."""
    if not hasattr(loaded, "geometry"):
        return len(loaded.faces)
    graph = loaded.graph
    parts = (loaded.geometry[graph[node][1]] for node in graph.nodes_geometry)
    return sum(len(part.faces) for part in parts if hasattr(part, "faces"))


def check_triangles(count: int, path: Path, place: str) -> None:
    """Raise where there are too many triangles."""
    if count > MAX_TRIANGLES:
        raise RobotError(
            f"{place}: meshes up to {path} have {count:,} triangles; allowed are "
            f"{MAX_TRIANGLES:,}; simplify them"
        )


def check_collada(data: bytes, path: Path, place: str) -> None:
    """Raise where a COLLADA file may become much larger when it is read."""
    plain = data.replace(b"\0", b"")  # in UTF-16 too
    if data[:2] == b"PK" or b"<!DOCTYPE" in plain:
        raise RobotError(
            f"{place}: mesh {path} is compressed or has a <!DOCTYPE>; export it again"
        )
    if plain.count(b"instance_node") > 2 * MAX_INSTANCES:
        raise RobotError(
            f"{place}: mesh {path} repeats more than {MAX_INSTANCES} parts; join them"
        )


def read_collada_unit(data: bytes, path: Path, place: str) -> float:
    """Return the unit of length of a COLLADA file [m]."""
    for _, element in ElementTree.iterparse(BytesIO(data), ("start",)):
        if element.tag.rpartition("}")[2] == "unit":
            text = element.get("meter", "1")
            with suppress(ValueError):
                if (metres := parse_number(text)) > 0:
                    return metres
            raise RobotError(
                f"{place}: mesh {path} has <unit meter='{text:.40}'>; wanted: its "
                "length in metres, above 0"
            )
    return 1.0
