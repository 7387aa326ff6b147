"""These tests check how tuned numbers are found, changed and compared."""

import ast
import json
import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from lab.vary.matrix import DEAD, FULL_SCALE, MatrixPlan, simulate
from lab.vary.numbers import Sources
from lab.vary.play import AS_IS, FACTORS, Variant, find_moved, list_variants, write_line
from lab.vary.rewrite import Slots, set_defaults, write_copy, write_edited
from lab.vary.table import compare, describe

KERNELS = '''"""Kernels."""
from typing import NamedTuple

from numba import njit

NOWHERE = -1.0
FIRST, LAST = 0, 1
LIMIT, SHARES = 3.0, (0.25, 4)
COUNT = 3
DONE = True
FACTOR = 0.5 * LIMIT
WHOLE = round(FACTOR)


class Shape(NamedTuple):
    """A record of constants."""

    scale: float = 1.5
    widths: tuple[float, float] = (2.0, 5.0)


SHAPE = Shape()
TWICE = 2.0 * SHAPE.scale


@njit
def weigh(values):
    """Return a sum that depends on each constant."""
    total = values[FIRST] * LIMIT + values[LAST] * SHARES[0] * WHOLE
    for k in range(COUNT):
        total += k * SHARES[1]
    return total * SHAPE.scale + SHAPE.widths[1]
'''
RULES = '''"""Rules."""
from dataclasses import dataclass

from eskin.touch.kernels import COUNT as MANY, FACTOR, SHAPE, TWICE, weigh


@dataclass(frozen=True)
class RuleConfig:
    """Settings."""

    least: float = 0.7
    name: str = "rule"
    half: float = FACTOR


def judge(values, config=None):
    """Return a list of what constants and settings give."""
    config = config or RuleConfig()

    def add(one):
        return one + FACTOR

    settings = [config.least, RuleConfig.least, config.half, SHAPE.scale, TWICE]
    return [float(weigh(values)), add(MANY), *settings]


def hide(FACTOR):
    """Return an argument that has the name of a constant."""
    return FACTOR
'''
PLAY = """
import json, sys
from pathlib import Path
import numpy as np
from lab.vary.numbers import Sources
from lab.vary.rewrite import Slots, change_numbers, keep_no_code
keep_no_code()
from eskin.touch.rules import hide, judge
found = []
for changed in json.loads(sys.argv[2]):
    if sys.argv[1]:
        change_numbers(Slots.build(Sources(Path(sys.argv[1]))), changed)
    found.append([*judge(np.ones(2)), hide(7.0)])
print(json.dumps(found))
"""
CHANGES = (
    {},
    {"touch.kernels:LIMIT": 6.0},
    {"touch.kernels:SHARES[1]": 8},
    {"touch.kernels:COUNT": 6},
    {"touch.rules:RuleConfig.least": 1.4},
    {"touch.kernels:Shape.scale": 4.5},
    {"touch.kernels:Shape.widths[1]": 7.0},
)


@pytest.fixture
def sources(tmp_path):
    """Sources of a small package, as of the front end."""
    folder = tmp_path / "eskin"
    (folder / "touch").mkdir(parents=True)
    (folder / "touch" / "__init__.py").write_text('"""Package."""\n')
    (folder / "__init__.py").write_text('"""Package."""\n')
    (folder / "touch" / "kernels.py").write_text(KERNELS)
    (folder / "touch" / "rules.py").write_text(RULES)
    return Sources(folder)


def run_copy(place, sources, changes):
    """Return what a copy of the small package gives, for each of some changes."""
    paths = os.pathsep.join([str(place), os.getcwd()])
    command = [sys.executable, "-c", PLAY, sources, json.dumps(changes)]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_tuned_are_named_numbers_and_defaults_of_configurations(sources):
    assert {one.label: one.value for one in sources.list_numbers()} == {
        "LIMIT": 3.0,
        "SHARES[0]": 0.25,
        "SHARES[1]": 4,
        "COUNT": 3,
        "Shape.scale": 1.5,
        "Shape.widths[0]": 2.0,
        "Shape.widths[1]": 5.0,
        "RuleConfig.least": 0.7,
    }


def test_what_is_not_tuned_says_why(sources):
    why = {place[1]: sources.why_not_tuned(place) for place in sources.list_places()}
    assert why["FIRST"] == "index"
    assert why["NOWHERE"] == "stands for nothing"
    assert why["FACTOR"] == why["RuleConfig.half"] == "computed from others"


def test_a_computed_constant_follows_the_number_it_is_computed_from(sources):
    changed = {"touch.kernels:LIMIT": 6.0}
    assert sources.compute(("touch.kernels", "WHOLE")) == 2
    assert sources.compute(("touch.kernels", "WHOLE"), changed) == 3
    assert sources.compute(("touch.rules", "RuleConfig.half"), changed) == 3.0
    changed = {"touch.kernels:Shape.scale": 4.5}
    assert sources.compute(("touch.kernels", "TWICE"), changed) == 9.0


@pytest.mark.slow
def test_a_changed_element_gives_what_changed_sources_give(sources, tmp_path):
    write_copy(Slots.build(sources), tmp_path / "copy")
    found = run_copy(tmp_path / "copy", str(sources.folder), CHANGES)
    for n, changed in enumerate(CHANGES):
        write_edited(sources, changed, tmp_path / str(n))
        assert run_copy(tmp_path / str(n), "", [{}]) == [found[n]]
    assert len({json.dumps(one) for one in found}) == len(CHANGES)


def test_an_edited_copy_keeps_all_other_numbers(sources, tmp_path):
    write_edited(sources, {"touch.kernels:SHARES[1]": 8}, tmp_path / "copy")
    tree = ast.parse((tmp_path / "copy/eskin/touch/kernels.py").read_text())
    text = ast.unparse(tree)
    assert text == ast.unparse(ast.parse(KERNELS.replace("(0.25, 4)", "(0.25, 8)")))


def test_defaults_hold_for_new_configurations_and_their_class():
    @dataclass(frozen=True)
    class Config:
        first: float = 1.0
        second: float = 2.0

    set_defaults(Config, {"second": 4.0})
    assert Config() == Config(1.0, 4.0)
    assert Config.second == 4.0


def test_each_number_is_halved_and_doubled_and_whole_ones_stay_whole(sources):
    variants = list_variants(sources.list_numbers())
    assert variants[0] == AS_IS
    assert {one.factor for one in variants[1:]} == set(FACTORS)
    values = {(one.key, one.factor): one.value for one in variants}
    assert values["touch.kernels:COUNT", 0.5] == 2
    assert isinstance(values["touch.kernels:COUNT", 0.5], int)
    assert values["touch.rules:RuleConfig.least", 2.0] == 1.4


def make_figures(felt="1111", deaf=0.1, openings=2.0):
    """Return figures of one world."""
    counts = dict.fromkeys(
        ("masked", "polarity", "faults", "onset error", "end error"), 0.0
    )
    counts |= dict.fromkeys(("force", "false seconds", "parts"), 0.0)
    counts |= {"deaf": deaf, "openings": openings, "touches": float(len(felt))}
    return {"world": {"outcomes": {"felt": felt}, "counts": counts}}


def test_only_a_difference_that_chance_does_not_explain_is_clear():
    usual = make_figures("1" * 20 + "0" * 20)
    line = {"error": "", "figures": make_figures("1" * 14 + "0" * 24 + "11")}
    assert describe(line, usual) == "little"
    line["figures"] = make_figures("1" * 14 + "0" * 26)
    assert describe(line, usual) == "felt 20 to 14 (+0 -6)"
    line["figures"] = usual
    assert describe(line, usual) == "nothing"


def test_shares_and_counts_are_compared_too():
    found = compare(make_figures(), make_figures(deaf=0.2, openings=12.0))
    assert [one.text for one in found] == [
        "deaf 10.00 % to 20.00 %",
        "openings 2 to 12",
    ]
    assert all(one.size >= 1.0 for one in found)


def test_variants_that_moved_are_found_in_a_file(tmp_path):
    path = tmp_path / "found.jsonl"
    usual = make_figures()
    write_line(path, AS_IS, "digest", usual)
    write_line(path, Variant("a:B", 0.5, 1.0), "digest", usual)
    write_line(path, Variant("a:B", 2.0, 4.0), "digest", make_figures("1110"))
    assert find_moved(path) == {("a:B", 2.0)}


def test_a_seed_gives_the_same_matrix_and_another_one_another():
    one, same, other = (simulate(MatrixPlan(), 4.0, seed) for seed in (1, 1, 2))
    assert (one.counts == same.counts).all()
    assert (one.rest != other.rest).all()


def test_crosstalk_adds_counts_under_a_touch_alone():
    quiet, loud = (simulate(MatrixPlan(talk), 6.0, 3) for talk in (0.0, 0.05))
    added = loud.counts.astype(int) - quiet.counts
    pressed = np.zeros(len(added), bool)
    for truth in loud.truths:
        pressed[np.isin(loud.stamps, truth.stamps[truth.force > 0.0])] = True
    assert (added[~pressed] == 0).all()
    assert (added >= 0).all()
    assert (added[pressed].sum(axis=1) > 0).all()


def test_a_dead_column_is_zero_and_not_sound():
    found = simulate(MatrixPlan(dead=True), 4.0, 1)
    dead = np.arange(found.counts.shape[1]) % 16 == DEAD
    assert (found.counts[:, dead] == 0).all()
    assert (found.sound == ~dead).all()


def test_a_sensor_that_releases_slowly_stays_above_rest_after_a_touch():
    quick, slow = (simulate(MatrixPlan(0.0, release=s), 8.0, 4) for s in (0.0, 0.5))
    truth = quick.truths[0]
    after = np.searchsorted(quick.stamps, truth.stamps[truth.pressed][-1]) + 5
    above = [(one.counts[after] - one.rest).max() for one in (quick, slow)]
    assert above[0] < 10 < above[1] <= FULL_SCALE
