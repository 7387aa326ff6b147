"""This module reads and writes `taxels.csv` without loss of precision."""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinError
from eskin.skin.check import SkinProblem
from eskin.skin.manifest import shorten
from eskin.skin.skin import Patch, Skin

VECTORS = ("x", "y", "z", "nx", "ny", "nz")
COLUMNS = ("id", "patch", "row", "column", *VECTORS, "area_mm2")
TANGENT = ("tx", "ty", "tz")
SQUARE_MM_EXPONENT = 6
"""Power of ten of mm2 in one m2."""


@dataclass(frozen=True)
class TaxelTable:
    """A table holds the readable rows of a `taxels.csv`, in the order of the file."""

    ids: Int[np.ndarray, "taxel"]
    """Ids, which give the order of the taxels."""
    patch_index: Int[np.ndarray, "taxel"]
    """Index of each taxel's patch in the manifest."""
    rows: Int[np.ndarray, "taxel"]
    """Row of each taxel in its patch."""
    columns: Int[np.ndarray, "taxel"]
    """Column of each taxel in its patch."""
    positions: Float[np.ndarray, "taxel 3"]
    """Centres in the links' frames [m]."""
    normals: Float[np.ndarray, "taxel 3"]
    """Outward normals in the links' frames."""
    areas: Float[np.ndarray, "taxel"]
    """Sensing areas [m2]."""
    tangents: Float[np.ndarray, "taxel 3"] | None
    """Local x axes in the links' frames, where the file has them."""


class BadCellError(ValueError):
    """A cell has a value that its column does not allow."""


def parse_taxels(
    text: str, patches: tuple[Patch, ...], file: str
) -> tuple[TaxelTable, list[SkinProblem]]:
    """Read the rows that can be read and list what is wrong with the others.

    Raises:
        SkinError: The header is not that of a `taxels.csv`, or the text is no CSV.
    """
    lines = iterate_rows(text, file)
    header = [name.strip() for name in next(lines, (1, []))[1]]
    check_header(header, file)
    index = {patch.id: i for i, patch in enumerate(patches)}
    kept: list[tuple] = []
    problems: list[SkinProblem] = []
    lines_of: dict[int, int] = {}
    for line, cells in lines:
        if not cells:
            continue
        where = f"{file} line {line}"
        row = dict(zip(header, cells, strict=False))
        try:
            if len(cells) != len(header):
                raise BadCellError(
                    f"{where}: got {len(cells)} cells, allowed {len(header)}"
                )
            taxel = read_row(row, header, patches, index, where)
            if taxel[0] in lines_of:
                raise BadCellError(
                    f"{where}, column id: got {taxel[0]}, which line "
                    f"{lines_of[taxel[0]]} has too; allowed every id once"
                )
        except BadCellError as error:
            problems.append(build_problem(error, row))
            continue
        lines_of[taxel[0]] = line
        kept.append(taxel)
    return build_table(kept), problems


def iterate_rows(text: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of every row, with the number of the line that it ends on."""
    rows = csv.reader(io.StringIO(text, newline=None))
    try:
        for cells in rows:
            yield rows.line_num, cells
    except csv.Error as error:
        raise SkinError(
            f"{file} line {rows.line_num}: {error}; allowed are cells with commas "
            "between them"
        ) from None


def format_taxels(skin: Skin) -> str:
    """Return the text of a skin's `taxels.csv`; reading it gives the same bits."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    write((*COLUMNS, *TANGENT))
    ids = [patch.id for patch in skin.patches]
    for i in range(skin.count):
        numbers = (*skin.positions[i], *skin.normals[i])
        area = Decimal(repr(float(skin.areas[i]))).scaleb(SQUARE_MM_EXPONENT)
        write(
            (i, ids[skin.patch_index[i]], int(skin.rows[i]), int(skin.columns[i]))
            + tuple(repr(float(number)) for number in numbers)
            + (f"{area:f}",)
            + tuple(repr(float(number)) for number in skin.tangents[i])
        )
    return out.getvalue()


def check_header(header: list[str], file: str) -> None:
    """Raise where a header lacks a column, repeats one or has an unknown one."""
    has_tangent = any(name in header for name in TANGENT)
    wanted = COLUMNS + (TANGENT if has_tangent else ())
    missing = [name for name in wanted if name not in header]
    unknown = [name for name in header if name not in COLUMNS + TANGENT]
    repeated = sorted({name for name in header if header.count(name) > 1})
    for what, names in (
        ("is missing", missing),
        ("is not known", unknown),
        ("stands twice", repeated),
    ):
        if names:
            raise SkinError(
                f"{file} line 1: column {', '.join(map(shorten, names))} {what}; got "
                f"{shorten(','.join(header))}, allowed {','.join(COLUMNS)} and "
                f"optionally {','.join(TANGENT)}"
            )


def read_row(
    row: dict[str, str],
    header: list[str],
    patches: tuple[Patch, ...],
    index: dict[str, int],
    where: str,
) -> tuple:
    """Read one taxel: id, patch, row, column, vectors, area [m2], tangent or ()."""
    number = read_integer(row, "id", where, None)
    name = row["patch"].strip()
    if name not in index:
        raise BadCellError(
            f"{where}, column patch: got {shorten(name)}, allowed the patches of "
            f"skin.yaml: {', '.join(index)}"
        )
    patch = patches[index[name]]
    return (
        number,
        index[name],
        read_integer(row, "row", where, patch.rows),
        read_integer(row, "column", where, patch.columns),
        tuple(read_float(row, column, where) for column in VECTORS),
        read_area(row, where),
        tuple(read_float(row, column, where) for column in TANGENT if column in header),
    )


def read_integer(row: dict[str, str], column: str, where: str, end: int | None) -> int:
    """Read an integer from 0 to the end, which is excluded."""
    allowed = "an integer from 0" + ("" if end is None else f" to {end - 1}")
    text = row[column].strip()
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 19 else -1
    if value < 0 or (end is not None and value >= end):
        raise BadCellError(
            f"{where}, column {column}: got {shorten(row[column])}, allowed {allowed}"
        )
    return value


def read_float(row: dict[str, str], column: str, where: str) -> float:
    """Read a finite number."""
    try:
        value = float(row[column])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise BadCellError(
            f"{where}, column {column}: got {shorten(row[column])}, "
            "allowed a finite number"
        )
    return value


def read_area(row: dict[str, str], where: str) -> float:
    """Read an area in mm2 and return it in m2; moving the decimal point is exact."""
    try:
        value = float(Decimal(row["area_mm2"].strip()).scaleb(-SQUARE_MM_EXPONENT))
    except ArithmeticError:
        value = np.nan
    if not (np.isfinite(value) and value > 0):
        raise BadCellError(
            f"{where}, column area_mm2: got {shorten(row['area_mm2'])}, "
            "allowed a finite number above 0"
        )
    return value


def build_problem(error: BadCellError, row: dict[str, str]) -> SkinProblem:
    """Build the problem of a bad cell, with patch and taxel where they are readable."""
    taxel = row.get("id", "").strip()
    known = taxel.isascii() and taxel.isdigit() and len(taxel) < 19
    patch = row.get("patch", "").strip()
    return SkinProblem(str(error), patch or None, int(taxel) if known else None)


def build_table(kept: list[tuple]) -> TaxelTable:
    """Build arrays of the rows that could be read."""

    def integers(field: int) -> Int[np.ndarray, "taxel"]:
        return np.array([taxel[field] for taxel in kept], dtype=np.int64)

    vectors = np.array([taxel[4] for taxel in kept], dtype=float).reshape(-1, 6)
    has_tangent = bool(kept) and len(kept[0][6]) == 3
    return TaxelTable(
        ids=integers(0),
        patch_index=integers(1),
        rows=integers(2),
        columns=integers(3),
        positions=vectors[:, :3].copy(),
        normals=vectors[:, 3:].copy(),
        areas=np.array([taxel[5] for taxel in kept], dtype=float),
        tangents=np.array([taxel[6] for taxel in kept]) if has_tangent else None,
    )
