"""Tests of the page that leads from the paper to its places here.

The commands, functions, modules and files that it names are checked by `test_docs.py`,
as are those of all pages.
"""

import re
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest

from conftest import SHARED
from eskin.live import FixedNeighbours
from eskin.skin import load_skin
from lab.comparison.methods import METHODS
from test_docs import find_program, resolve

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "paper.md").read_text()
PAPER = SHARED / "paper.tex"

SECTIONS = (
    "I",
    "II",
    "III-A",
    "III-B",
    "IV-A1",
    "IV-A2",
    "IV-A3",
    "IV-A4",
    "IV-A5",
    "IV-B",
    "IV-C1",
    "IV-C2",
    "IV-C3",
    "IV-C4",
    "IV-D",
    "V-A",
    "V-B",
    "V-C",
    "VI",
)
"""Sections of the paper without sections of their own, by their printed numbers."""
EQUATIONS = ("eq. (1)", "eq. (2)")
TABLES = ("Table I", "Table II", "Table III")
FIGURES = tuple(f"Fig. {number}" for number in range(1, 13))
NUMBERED = (*EQUATIONS, *TABLES, *FIGURES)

PICTURE_OF_ALL = "Fig. 1"
"""The skin on the robot, which no function of eskin implements."""
VERDICTS = ("same", "better", "different because", "missing")
ROMAN = ("", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X")

SPAN = re.compile(r"`([^`\n]+)`")
NAME = re.compile(r"(?:eskin|eskin_paper_network|lab)(?:\.\w+)+")
FILE = re.compile(r"[\w.-]+(?:/[\w.-]+)+\.\w+")
PROGRAM = re.compile(r"python -m ([\w.]+)")
METHOD_TABLE = "## Table I:"
FIXED_EDGES = 16_872
"""Edges of the paper's skin (section IV-C4)."""
TAXELS = 2112
K = 8


def read_rows(after):
    """Return the cells of the first table after a heading, without its head."""
    text = PAGE.split(after, 1)[1]
    table = re.search(r"^\|.*?(?=^[^|])", text, re.MULTILINE | re.DOTALL)
    assert table is not None, after
    lines = table[0].strip().splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


ROWS = read_rows("## Sections, equations and figures")


def find_spans(pattern, text=PAGE):
    """Return the code spans of a text that match a pattern as a whole, once each."""
    return sorted({span for span in SPAN.findall(text) if pattern.fullmatch(span)})


def is_named(label, text):
    """Tell whether a text has a printed number, which is not the start of another."""
    return re.search(rf"(?<![\w-]){re.escape(label)}(?![\w-])", text) is not None


def is_stated(label, text):
    """Tell whether a text has a printed number, be it of one part of a figure."""
    return re.search(rf"{re.escape(label)}(?![\dI])", text) is not None


def count_numbered(tex):
    """Return the printed numbers of a paper in LaTeX, counted in their order."""
    kinds = {"equation": "eq. ({})", "table": "Table {}", "figure": "Fig. {}"}
    found = []
    for kind, form in kinds.items():
        count = len(re.findall(rf"\\begin\{{{kind}\*?\}}", tex))
        numbers = range(1, count + 1)
        found += [form.format(ROMAN[n] if kind == "table" else n) for n in numbers]
    return tuple(found)


def number_sections(tex):
    """Return the printed numbers of the sections that have no sections of their own."""
    found = []
    counts = [0, 0, 0]
    for prefix in re.findall(r"^\\(sub|subsub|)section\{", tex, re.MULTILINE):
        level = ("", "sub", "subsub").index(prefix)
        counts[level] += 1
        counts[level + 1 :] = [0] * (2 - level)
        section, part, detail = counts
        name = ROMAN[section]
        name += f"-{chr(ord('A') + part - 1)}" if part else ""
        found.append(name + (str(detail) if detail else ""))
    parents = {name.split("-")[0] for name in found if "-" in name}
    parents |= {name.rstrip("0123456789") for name in found if name[-1].isdigit()}
    return tuple(name for name in found if name not in parents)


@pytest.mark.skipif(not PAPER.exists(), reason="the paper is not in this checkout")
def test_numbers_of_the_paper_are_those_that_its_source_prints():
    tex = PAPER.read_text()
    assert count_numbered(tex) == NUMBERED
    assert number_sections(tex) == SECTIONS


@pytest.mark.parametrize("item", [*SECTIONS, *NUMBERED])
def test_every_section_equation_table_and_figure_has_a_row(item):
    assert [row for row in ROWS if is_named(item, row[0])], item


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_every_row_has_a_place_and_a_verdict(row):
    assert len(row) == 4
    assert any(f"`{verdict}`" in row[3] for verdict in VERDICTS)
    assert SPAN.search(row[2]) or "](" in row[2] or "Fig. 3" in row[2]


def test_every_method_of_table_i_is_one_that_can_be_compared():
    rows = read_rows(METHOD_TABLE)
    assert len(rows) == 12
    for row in rows:
        methods = [name for name in SPAN.findall(row[5]) if "eskin " not in name]
        assert methods, row[0]
        assert set(methods) <= set(METHODS), row[0]


@pytest.mark.parametrize(
    "row",
    [row for row in ROWS if any(is_named(item, row[0]) for item in NUMBERED)],
    ids=lambda row: row[0],
)
def test_what_implements_a_numbered_item_states_its_number_or_section(row):
    labels = [item for item in NUMBERED if is_named(item, row[0])]
    sections = [item for item in SECTIONS if is_named(item, row[0])]
    docs = [resolve(name).__doc__ or "" for name in find_spans(NAME, row[2])]
    docs += [(ROOT / path).read_text() for path in find_spans(FILE, row[2])]
    docs += [find_program(name).read_text() for name in PROGRAM.findall(row[2])]
    stated = " ".join(" ".join(docs).split())
    in_section = any(is_named(f"section {item}", stated) for item in sections)
    for label in labels:
        exempt = label == PICTURE_OF_ALL or "](#table-i-" in row[2]
        assert exempt or in_section or is_stated(label, stated), label


def count_lacking_edges(taxels):
    """Return how many of its K edges a taxel the taxels of one patch lack together."""
    return taxels * max(0, K - (taxels - 1))


def test_skin_has_eight_fixed_edges_a_taxel():
    skin = load_skin("ur5")
    table = FixedNeighbours(skin, K).table
    assert skin.count == TAXELS and np.bincount(skin.patch_index).min() >= 52
    assert (table >= 0).sum() == TAXELS * K == 16_896
    source = table.ravel().tolist()
    target = np.repeat(np.arange(TAXELS), K).tolist()
    pairs = {frozenset(pair) for pair in zip(source, target, strict=True)}
    assert 2 * len(pairs) == 17_712


def test_only_three_patches_of_one_or_eight_taxels_lack_the_24_edges_of_the_paper():
    lacking = TAXELS * K - FIXED_EDGES
    sizes = range(1, K + 1)
    found = {
        patches
        for count in range(1, lacking + 1)
        for patches in combinations_with_replacement(sizes, count)
        if count * K <= lacking and sum(map(count_lacking_edges, patches)) == lacking
    }
    assert found == {(1, 1, 1), (1, 1, 8), (1, 8, 8), (8, 8, 8)}
    assert FIXED_EDGES == 2109 * K


def test_table_of_lacking_edges_is_that_of_the_formula():
    numbers = re.search(r"\| edges that it lacks \|(.*)\|", PAGE)
    assert numbers is not None
    shown = [int(cell) for cell in numbers[1].split("|")]
    assert shown == [count_lacking_edges(taxels) for taxels in range(1, 10)]
