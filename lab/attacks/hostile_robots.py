"""Hostile URDFs and meshes: small files that take memory, or name files elsewhere."""

import zipfile
from io import BytesIO
from pathlib import Path

from lab.attacks.hostile_texts import (
    MEGABYTE,
    OUTSIDE,
    Write,
    write_hole,
    write_noise,
    write_text,
)


def write_mesh(address: str, content: bytes | None = None) -> Write:
    """Return a function that writes a URDF with a mesh, and its file beside it.

    Args:
        address: address of the mesh.
        content: content of the file; None writes none.
    """

    def write(path: Path) -> None:
        if content is not None:
            (path.parent / address).write_bytes(content)
        path.write_text(
            '<robot name="r"><link name="table"><collision><geometry>'
            f'<mesh filename="{address}"/></geometry></collision></link></robot>'
        )

    return write


def write_linked_mesh(path: Path) -> None:
    """Write a URDF whose mesh is a symbolic link to a file elsewhere."""
    write_mesh("linked.stl")(path)
    (path.parent / "linked.stl").symlink_to("/etc/passwd")


def write_zipped_mesh(path: Path) -> None:
    """Write a URDF with a small 3MF that unpacks to 300 MB."""
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(300 * MEGABYTE))
    write_mesh("a.3mf", out.getvalue())(path)


def write_chain(count: int) -> Write:
    """Return a function that writes a URDF of links that are joined in a row."""
    links = "".join(f'<link name="l{n}"/>' for n in range(count))
    joints = "".join(
        f'<joint name="j{n}" type="fixed"><parent link="l{n}"/>'
        f'<child link="l{n + 1}"/></joint>'
        for n in range(count - 1)
    )
    return write_text(f'<robot name="r">{links}{joints}</robot>')


ENTITIES = "".join(
    f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">'
    for n in range(1, 10)  # a9 has a billion characters
)
BILLION_LAUGHS = (
    f'<!DOCTYPE robot [<!ENTITY a0 "ha">{ENTITIES}]>'
    '<robot name="&a9;"><link name="table"/></robot>'
)
EXTERNAL = (
    '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
    '<robot name="&a;"><link name="table"/></robot>'
)
PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n"
)
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 %d\n"
NODES = "".join(
    f'<node id="n{n}">' + f'<instance_node url="#n{n - 1}"/>' * 2 + "</node>"
    for n in range(1, 40)
)
COLLADA = f"<COLLADA><library_nodes>{NODES}</library_nodes></COLLADA>"

ROBOTS: dict[str, Write] = {
    "a billion laughs": write_text(BILLION_LAUGHS),
    "an external entity": write_text(EXTERNAL),
    "20,000 links": write_chain(20_000),
    "elements 100,000 deep": write_text("<robot>" + "<a>" * 100_000),
    "1,000,000 elements": write_text("<robot>" + "<a/>" * 1_000_000 + "</robot>"),
    "a hole of 1 TB": write_hole(1 << 40),
    "noise": write_noise,
    "a mesh at /etc/passwd": write_mesh("/etc/passwd"),
    "a mesh at ../../etc/passwd": write_mesh(OUTSIDE),
    "a mesh at file:///etc/passwd": write_mesh("file:///etc/passwd"),
    "a mesh at package://etc/passwd": write_mesh("package://etc/passwd"),
    "a mesh that is a link to /etc/passwd": write_linked_mesh,
    "a mesh of 64 MB": write_mesh("a.stl", bytes(64 * MEGABYTE)),
    "a 3MF of 300 MB in 300 kB": write_zipped_mesh,
    "a PLY of 1e11 vertices": write_mesh("a.ply", PLY),
    "an STL of 4e9 triangles": write_mesh("a.stl", bytes(80) + b"\xff" * 104),
    "a triangle of corners that are not there": write_mesh("a.obj", TRIANGLE % 10**8),
    "a COLLADA of 2^39 parts": write_mesh("a.dae", COLLADA.encode()),
}
