"""Hostile models, skins, robots and texts: small files that take time or memory.

Each is written by a function that takes its path.
"""

import gzip
import json
import math
import os
import random
import socket
import stat
import zipfile
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save_file

from eskin.skin import Skin, build_grid_skin, save_skin
from eskin.skin.taxel_table import format_taxels

Write = Callable[[Path], object]
"""Function that writes a file, or a folder of files, at a path."""
MEGABYTE = 1 << 20
SMALL = build_grid_skin(5, 6, name="small")


def write_text(text: str) -> Write:
    """Return a function that writes a text."""
    return lambda path: path.write_text(text)


def write_hole(size: int, head: bytes = b"") -> Write:
    """Return a function that writes a head, and a hole up to a size [bytes]."""

    def write(path: Path) -> None:
        path.write_bytes(head)
        os.truncate(path, size)

    return write


def write_noise(path: Path) -> None:
    """Write a megabyte of random bytes."""
    path.write_bytes(random.Random(0).randbytes(MEGABYTE))


def write_special(kind: int) -> Write:
    """Return a function that makes an irregular file, by its kind in `stat`."""

    def write(path: Path) -> None:
        if kind == stat.S_IFIFO:
            os.mkfifo(path)
        elif kind == stat.S_IFSOCK:
            # The name of a socket may be no longer than a hundred characters.
            with socket.socket(socket.AF_UNIX) as listener:
                listener.bind(os.path.relpath(path))
        elif kind == stat.S_IFDIR:
            path.mkdir()
        else:
            path.symlink_to("/dev/zero")

    return write


SPECIAL: dict[str, Write] = {
    "a FIFO": write_special(stat.S_IFIFO),
    "/dev/zero": write_special(stat.S_IFCHR),
    "a socket": write_special(stat.S_IFSOCK),
    "a folder": write_special(stat.S_IFDIR),
}
"""Irregular files, for every reader."""


def write_card(**entries: Any) -> Write:  # noqa: ANN401
    """Return a function that writes a model with a card of some entries."""

    def write(path: Path) -> None:
        card = {"vocabulary": ["none", "poke"]} | entries
        weights = {"w": np.zeros(2, np.float32)}
        save_file(weights, path, metadata={"eskin": json.dumps(card)})

    return write


def write_tare(**entries: float) -> Write:
    """Return a function that writes a model with settings of the calibration."""
    return write_card(pipeline={"calibration": entries})


MODELS: dict[str, Write] = {
    "tare_rank of 1e12": write_tare(tare_rank=1e12),
    "tare_rank of 1e6": write_tare(tare_rank=1e6),
    "tare_rank of -1e6": write_tare(tare_rank=-1e6),
    "tare_samples of 1e9": write_tare(tare_samples=10**9),
    "1e9 layers": write_card(network={"layers": 10**9}),
    "a width of 1e7": write_card(network={"width": 10**7}),
    "1e7 channels": write_card(network={"channels": 10**7}),
    "1e9 slots": write_card(network={"slots": 10**9}),
    "1e9 fixed neighbours": write_card(graph={"fixed": 10**9}),
    "1e9 live neighbours": write_card(graph={"live": 10**9}),
    "contacts that reach 1e9": write_card(pipeline={"contacts": {"reach": 1e9}}),
    "a temperature of 0": write_card(temperature=0),
    "weights that are not those of its card": write_card(),
    "a card of 2 MB": write_card(training={"a": "a" * 2 * MEGABYTE}),
    "a header of 2^63 bytes": write_hole(4096, b"\xff" * 7 + b"\x7f"),
    "a hole of 1 TB": write_hole(1 << 40),
    "noise": write_noise,
}

LAUGHS = "\n".join(
    ["- &a0 {start_s: 1, end_s: 2, gesture: poke}"]
    + [f"- &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 10)]
)
"""YAML of 430 bytes with billions of values."""
YAML: dict[str, str] = {
    "aliases of aliases": LAUGHS,
    "200,000 brackets": "[" * 200_000,
    "200,000 values": "[" + "1," * 200_000 + "1]",
    "a number of 200,000 digits to the base 60": "- 1" + ":1" * 200_000,
    "16 MB of spaces": " " * 16 * MEGABYTE,
}
TEXTS: dict[str, Write] = {
    **{name: write_text(text) for name, text in YAML.items()},
    "a hole of 1 TB": write_hole(1 << 40),
    "noise": write_noise,
}
"""Ranges and command maps."""

KEYS: dict[str, Write] = {"a hole of 1 TB": write_hole(1 << 40), "noise": write_noise}

CALIBRATIONS: dict[str, Write] = {
    "100,000 brackets": write_text("[" * 100_000),
    "10,000,000 gains": write_text('{"gain": [' + "1," * 10_000_000 + "1]}"),
}


def write_skin(
    taxels: Callable[[str], str] = str, manifest: Callable[[str], str] = str
) -> Write:
    """Return a function that writes a small skin, with the texts of its files changed.

    Args:
        taxels: function that changes `taxels.csv`.
        manifest: function that changes `skin.yaml`.
    """

    def write(path: Path) -> None:
        save_skin(SMALL, path)
        for file, change in (("taxels.csv", taxels), ("skin.yaml", manifest)):
            (path / file).write_text(change((path / file).read_text()))

    return write


def write_skin_without_table(write: Write) -> Write:
    """Return a function that writes a skin with something in place of its taxels."""

    def write_folder(path: Path) -> None:
        save_skin(SMALL, path)
        (path / "taxels.csv").unlink()
        write(path / "taxels.csv")

    return write_folder


def stack_taxels(count: int, far: float = 0.0) -> Skin:
    """Build a skin whose taxels lie in one point, but for four at a distance [m]."""
    skin = build_grid_skin(1, count, name="stack")
    positions = np.zeros((count, 3))
    positions[:4, 0] = far * np.arange(4)
    return replace(skin, positions=positions)


def write_stacked_skin(path: Path) -> None:
    """Write a skin whose taxels lie in one point, which `save_skin` refuses."""
    save_skin(build_grid_skin(1, 10_000, 4e-4, name="stack"), path)
    (path / "taxels.csv").write_text(format_taxels(stack_taxels(10_000)))


def squeeze_taxels(count: int, far: float = 0.0) -> Skin:
    """Build a skin of taxels 0.3 mm apart, but for four at a distance [m]."""
    side = math.isqrt(count)
    skin = build_grid_skin(side, side, 3e-4, name="squeezed", calibrated=True)
    positions = skin.positions.copy()
    positions[:4, 2] = far * np.arange(4)
    return replace(skin, positions=positions)


PATCH = "- {id: p%d, link: table, address: %d, rows: 1, columns: 1}\n"
PATCHES = "name: a\npatches:\n" + "".join(PATCH % (n, n) for n in range(1500))
OUTSIDE = "../" * 20 + "etc/passwd"

CHANGES: tuple[tuple[str, str, str], ...] = (
    ("name: small", "name: !!bool 1", "line 2, column 7"),
    ("name: small", "name: !!int ''", "''"),
    ("name: small", "name: !!timestamp a", "'a'"),
    ("name: small", "name: !!float a", "'a'"),
    ("name: small", "name: 2001-99-99", "'2001-99-99'"),
    ("name: small", "name: " + "9" * 5000, "int"),
    ("name: small", "? [a]\n: b\nname: small", "key"),
    ("name: small", "? {a: b}\n: b\nname: small", "key"),
    ("name: small", '"a\\nb": 1\nname: small', r"'a\nb'"),
    ("name: small", 'name: "a\\vb"', r"name: got 'a\x0bb'"),
    ("name: small", 'name: "a\\u2028b"', r"name: got 'a\u2028b'"),
    ("name: small", 'name: "\\U99999999"', "YAML"),
    ("name: small", 'name: "\\UFFFFFFFF"', "YAML"),
    ("name: small", 'name: "\\ud800"', "name: got"),
    ("name: small", '"\\ud800": 1', "skin.yaml: "),
    ("name: small", "%YAML " + "9" * 5000 + ".1\n---\nname: small", "YAML"),
    ("name: small", "name: " + "[" * 100_000, "20 nested collections"),
    ("name: small", "name: !!python/object/apply:os.getcwd []", "YAML"),
    (",100,", ",1e999999999,", "area_mm2: got '1e999999999'"),
    (",100,", ",sNaN,", "area_mm2: got 'sNaN'"),
    (",1.0,100", ",1e200,100", "normal has length inf"),
    ("0,grid", "0,gr\x0bid\u2028", "taxel 0"),
    ("0,grid", '0,"' + "a" * 140_000, "field"),
)
"""Changes of the texts of a small skin that broke its reader once: a text, what takes
its first place, and a part of the message."""


def write_changed_skin(old: str, new: str) -> Write:
    """Return a function that writes a small skin with a text replaced once."""

    def change(text: str) -> str:
        return text.replace(old, new, 1)

    return write_skin(change, change)


SKINS: dict[str, Write] = {
    **{
        f"{old} as {ascii(new):.40}": write_changed_skin(old, new)
        for old, new, _ in CHANGES
    },
    **{
        f"skin.yaml with {name}": write_skin(manifest=lambda _, text=text: text)
        for name, text in YAML.items()
    },
    "1,500 patches": write_skin(manifest=lambda text: PATCHES),
    "taxels in /etc/passwd": write_skin(
        manifest=lambda text: text.replace("taxels.csv", OUTSIDE)
    ),
    "500,000 lines": write_skin(lambda text: text + "\n" * 500_000),
    "10,000 taxels in one point": write_stacked_skin,
    "a line of 32 MB": write_skin(lambda text: text + "," * (1 << 25)),
    "a cell over 99,999 lines": write_skin(lambda text: text + '"\n' * 99_999),
    "100,000 wrong rows": write_skin(lambda text: text + "x\n" * 100_000),
    "a taxels.csv of 1 TB": write_skin_without_table(write_hole(1 << 40)),
    **{
        f"{name} as taxels.csv": write_skin_without_table(write)
        for name, write in SPECIAL.items()
    },
}


def write_dataset(content: bytes, suffix: str = ".json") -> Write:
    """Return a function that writes a folder of the sleeve dataset with one file."""

    def write(path: Path) -> None:
        path.mkdir()
        (path / f"tap_20250101000000{suffix}").write_bytes(content)

    return write


def write_many_zeros(path: Path) -> None:
    """Write a gzipped file of a gigabyte of zeros."""
    write_dataset(gzip.compress(bytes(MEGABYTE << 8), 9) * 4, ".json.gz")(path)


DATASETS: dict[str, Write] = {
    "1 GB of zeros in 1 MB": write_many_zeros,
    "5,000,000 lists": write_dataset(b'{"frames": [' + b"[]," * 5_000_000 + b"[]]}"),
    "100,000 brackets": write_dataset(b"[" * 100_000),
}


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
