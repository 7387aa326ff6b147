"""This module reads and writes `taxels.csv` without loss of precision."""

import csv
import io
from collections.abc import Iterator
from decimal import Decimal
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float

from eskin.errors import SkinError
from eskin.files import parse_number, shorten
from eskin.skin.check import SkinProblem
from eskin.skin.skin import Patch, Skin

VECTORS = ("x", "y", "z", "nx", "ny", "nz")
COLUMNS = ("id", "patch", "row", "column", *VECTORS, "area_mm2")
TANGENT = ("tx", "ty", "tz")
SQUARE_MM_EXPONENT = 6
"""Power of ten of mm2 in one m2."""
MAX_TAXELS = 200_000
"""Largest number of taxels of a skin."""
MAX_TABLE_BYTES = 64 << 20
"""Largest size of a `taxels.csv` [bytes]."""
MAX_ROW_LINES = 10
MAX_LINE = 200_000
"""Largest number of lines of one row, and of characters of one line."""
MAX_PROBLEMS = 1000
"""Number of problems after which the rest of a table is not read."""


class TaxelRow(NamedTuple):
    """A row holds one taxel of a `taxels.csv`."""

    id: int
    patch: int
    row: int
    column: int
    vectors: tuple[float, ...]
    """Position [m] and normal."""
    area: float
    """Area [m2]."""
    tangent: tuple[float, ...]
    """Local x axis; empty where the file has none."""


@final
class BadCellError(ValueError):
    """A cell has a value that its column does not allow.

    Attributes:
        kind: word for the rule that is broken, the same for all rows.
    """

    def __init__(self, kind: str, message: str) -> None:
        """Keep both."""
        super().__init__(message)
        self.kind = kind


def parse_taxels(
    text: str, patches: tuple[Patch, ...], file: str
) -> tuple[list[TaxelRow], list[SkinProblem]]:
    """Read the valid rows by their ids, and list the mistakes of the others.

    The rest is not read after `MAX_PROBLEMS` problems.

    Raises:
        SkinError: There are too many lines or taxels, the header is not that of a
            `taxels.csv`, or the text is no CSV.
    """
    lines = iterate_rows(text, file)
    header = [name.strip() for name in next(lines, (1, []))[1]]
    check_header(header, file)
    index = {patch.id: i for i, patch in enumerate(patches)}
    taxels: list[TaxelRow] = []
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
                    "number of cells",
                    f"{where}: got {len(cells)} cells, allowed {len(header)}",
                )
            taxel = read_row(row, patches, index, where)
            if taxel.id in lines_of:
                raise BadCellError(
                    "repeated id",
                    f"{where}, column id: got {taxel.id}, which line "
                    f"{lines_of[taxel.id]} has too; allowed every id once",
                )
        except BadCellError as error:
            problems.append(build_problem(error, row))
            if len(problems) >= MAX_PROBLEMS:
                break
            continue
        if len(taxels) >= MAX_TAXELS:
            raise SkinError(
                f"{file} line {line}: got more than {MAX_TAXELS:,} taxels, allowed are "
                "fewer; split the skin"
            )
        lines_of[taxel.id] = line
        taxels.append(taxel)
    return sorted(taxels, key=lambda taxel: taxel.id), problems


def iterate_rows(text: str, file: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the last line of every row, and its cells."""
    if text.count("\n") + text.count("\r") > 2 * MAX_TAXELS:
        raise SkinError(
            f"{file}: got more than {2 * MAX_TAXELS:,} lines, allowed are "
            f"{MAX_TAXELS:,} taxels"
        )
    begun = 0

    def check_lines() -> Iterator[str]:
        for number, line in enumerate(io.StringIO(text, newline=None)):
            if number - begun >= MAX_ROW_LINES or len(line) > MAX_LINE:
                raise SkinError(
                    f"{file} line {number + 1}: got a row of more than {MAX_LINE:,} "
                    f"characters or {MAX_ROW_LINES} lines, allowed are shorter ones"
                )
            yield line

    rows = csv.reader(check_lines())
    try:
        for cells in rows:
            begun = rows.line_num
            yield rows.line_num, cells
    except csv.Error as error:
        raise SkinError(
            f"{file} line {rows.line_num}: {error}; allowed are cells with commas "
            "between them"
        ) from None


def format_taxels(skin: Skin) -> str:
    """Return the text of a skin's `taxels.csv`, without loss of precision."""
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    write((*COLUMNS, *TANGENT))
    ids = [patch.id for patch in skin.patches]
    for i in range(skin.count):
        area = Decimal(repr(float(skin.areas[i]))).scaleb(SQUARE_MM_EXPONENT)
        write(
            (
                i,
                ids[skin.patch_index[i]],
                int(skin.rows[i]),
                int(skin.columns[i]),
                *map(repr, skin.positions[i].tolist() + skin.normals[i].tolist()),
                f"{area:f}",
                *map(repr, skin.tangents[i].tolist()),
            )
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
    row: dict[str, str], patches: tuple[Patch, ...], index: dict[str, int], where: str
) -> TaxelRow:
    """Read one taxel from the cells of a row."""
    number = read_integer(row, "id", where, None)
    name = row["patch"].strip()
    if name not in index:
        allowed = f"the patches of skin.yaml: {', '.join(index)}"
        raise refuse_cell(where, "patch", name, allowed)
    patch = patches[index[name]]
    return TaxelRow(
        number,
        index[name],
        read_integer(row, "row", where, patch.rows),
        read_integer(row, "column", where, patch.columns),
        tuple(read_float(row, column, where) for column in VECTORS),
        read_area(row, where),
        tuple(read_float(row, column, where) for column in TANGENT if column in row),
    )


def read_integer(row: dict[str, str], column: str, where: str, end: int | None) -> int:
    """Read an integer from 0 to the end, which is excluded."""
    allowed = "an integer from 0" + ("" if end is None else f" to {end - 1}")
    value = parse_integer(row[column])
    if value is None or (end is not None and value >= end):
        raise refuse_cell(where, column, row[column], allowed)
    return value


def parse_integer(text: str) -> int | None:
    """Return the integer of a text with up to 18 digits, else None."""
    text = text.strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else None


def read_float(row: dict[str, str], column: str, where: str) -> float:
    """Read a finite number."""
    try:
        return parse_number(row[column])
    except ValueError:
        raise refuse_cell(where, column, row[column], "a finite number") from None


def read_area(row: dict[str, str], where: str) -> float:
    """Read an area in mm2 and return it in m2, exactly, by a shift of the point."""
    try:
        parse_number(row["area_mm2"])
        value = float(Decimal(row["area_mm2"].strip()).scaleb(-SQUARE_MM_EXPONENT))
    except (ArithmeticError, ValueError):
        value = np.nan
    if not (np.isfinite(value) and value > 0):
        allowed = "a finite number above 0"
        raise refuse_cell(where, "area_mm2", row["area_mm2"], allowed)
    return value


def refuse_cell(where: str, column: str, text: str, allowed: str) -> BadCellError:
    """Return the error of a wrong cell: the given and the allowed text."""
    message = f"{where}, column {column}: got {shorten(text)}, allowed {allowed}"
    return BadCellError(f"column {column}", message)


def build_problem(error: BadCellError, row: dict[str, str]) -> SkinProblem:
    """Build the problem of a bad cell, with patch and taxel where they can be read."""
    patch = row.get("patch", "").strip()
    taxel = parse_integer(row.get("id", ""))
    return SkinProblem(str(error), error.kind, patch or None, taxel)


def build_arrays(taxels: list[TaxelRow]) -> dict[str, np.ndarray]:
    """Build the arrays of a `Skin` of some taxels, by their names."""
    fields = zip(*taxels, strict=True) if taxels else [()] * len(TaxelRow._fields)
    _, patches, rows, columns, vectors, areas, tangents = fields
    vectors = np.array(vectors, dtype=float).reshape(-1, 6)
    normals = vectors[:, 3:].copy()
    return {
        "patch_index": np.array(patches, dtype=np.int64),
        "rows": np.array(rows, dtype=np.int64),
        "columns": np.array(columns, dtype=np.int64),
        "positions": vectors[:, :3].copy(),
        "normals": normals,
        "areas": np.array(areas, dtype=float),
        "tangents": (
            np.array(tangents)
            if tangents and tangents[0]
            else compute_default_tangents(normals)
        ),
    }


# A vector that overflows is not a unit vector and is refused later.
@np.errstate(over="ignore", invalid="ignore")
def compute_default_tangents(
    normals: Float[np.ndarray, "taxel 3"],
) -> Float[np.ndarray, "taxel 3"]:
    """Compute local x axes by projecting the link's x axis onto the tangent planes.

    Where the normal is nearly along x, the link's y axis is projected instead.
    """
    seed = np.where(np.abs(normals[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    across = seed - np.sum(seed * normals, axis=1, keepdims=True) * normals
    return across / np.linalg.norm(across, axis=1, keepdims=True)
