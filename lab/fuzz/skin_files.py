"""Fuzz the reader of skin files."""

import random
from pathlib import Path
from typing import final

from eskin.errors import SkinError
from eskin.robot import load_robot
from eskin.skin import Skin, build_grid_skin, load_skin, skin_from_bytes, skin_to_bytes
from eskin.skin.files import ROBOT_URDF, format_manifest, read_robot_urdf
from eskin.skin.taxel_table import format_taxels
from lab.fuzz.mutation import mutate
from lab.fuzz.run import Target, check_refusal

BETWEEN = b"\n...\n"
"""Separator of `skin.yaml` and `taxels.csv` in an input."""
YAML_WORDS = (
    b"!!bool ",
    b"!!int ",
    b"!!float ",
    b"!!timestamp ",
    b"!!binary ",
    b"!!set ",
    b"!!python/name:os.system ",
    b"!!omap ",
    b"!!null ",
    b"!!merge ",
    b"!!pairs ",
    b"? [a]\n",
    b"? {a: b}\n",
    b"&a ",
    b"*a",
    b"<<: ",
    b"- ",
    b": ",
    b"\n",
    b"---\n",
    b"[" * 9,
    b"[" * 20_000,
    b"{" * 20_000,
    b"|\n",
    b">\n",
    b"'",
    b'"',
    b"#",
    b"2001-99-99",
    b"1:99",
    b"0x",
    b"1e999",
    b".inf",
    b".nan",
    b"9" * 5000,
    b"~",
    b"\t",
    b"\r",
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    "\u2028".encode(),
    b"../",
    b"%YAML 9.9\n",
    b'"\\U99999999"',
    b'"\\ud800"',
    b"/dev/",
    b"robot_sha256: ",
    b"a" * 64,
    b"0" * 64,
    b"taxels: ..\n",
    b"taxels: .\n",
    b"taxels: skin.yaml\n",
    b"taxels: a/b\n",
)
TABLE_WORDS = (
    b",",
    b"\n",
    b"\r",
    b'"',
    b"\0",
    b"nan",
    b"inf",
    b"-",
    b"1e308",
    b"1e-320",
    b"1E999999999",
    b"1E-999999999",
    b"9" * 5000,
    b"0x1",
    b"1_0",
    b"\xd9\xa3",
    b"NaN",
    b"sNaN",
    b"\xff",
    b"\xef\xbb\xbf",
    b"grid",
    b"tx,ty,tz",
    b"id",
    b"1e200",
)


def small_skin() -> Skin:
    """Build a skin of 30 taxels."""
    return build_grid_skin(5, 6, name="small")


@final
class SkinTarget(Target):
    """Fuzzes the readers of a skin's folder and of the text in a recording."""

    def __init__(self, folder: Path) -> None:
        """Start from a small skin; the inputs are written into the folder."""
        self.folder = folder
        skin = small_skin()
        urdf = load_robot("table").urdf
        (folder / ROBOT_URDF).write_bytes(urdf)
        self.manifest = format_manifest(skin, urdf).encode()
        self.table = format_taxels(skin).encode()

    def make(self, rng: random.Random) -> bytes:
        """Return both files, with one or both of them mutated."""
        which = rng.randrange(5)
        manifest = self.manifest
        table = self.table
        if which <= 2:
            manifest = mutate(manifest, rng, YAML_WORDS)
        if which >= 2:
            table = mutate(table, rng, TABLE_WORDS)
        return manifest + BETWEEN + table

    def feed(self, data: bytes) -> bool:
        """Load folder and text; an accepted skin must survive writing and reading."""
        manifest, _, table = data.partition(BETWEEN)
        (self.folder / "skin.yaml").write_bytes(manifest)
        (self.folder / "taxels.csv").write_bytes(table)
        try:
            skin = load_skin(self.folder)
            read_robot_urdf(self.folder)
        except SkinError as error:
            check_refusal(error)
            return False
        finally:
            refuses_or_reads(data)
        kept = skin_to_bytes(skin)
        if skin_to_bytes(skin_from_bytes(kept)) != kept:
            raise AssertionError("the skin differs after writing and reading")
        return True


def refuses_or_reads(data: bytes) -> None:
    """Read both files as one text, as from a recording."""
    try:
        skin_from_bytes(data)
    except SkinError as error:
        check_refusal(error)
