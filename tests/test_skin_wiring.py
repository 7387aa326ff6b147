"""What three presses a patch tell of its wiring."""

import numpy as np
import pytest

from eskin.skin import load_skin
from eskin.skin.wiring import PressResponse, check_wiring, choose_press_targets

SKIN = load_skin("ur5")


def answered(wire):
    """Every spot pressed; `wire` gives who answers for a taxel."""
    return [
        PressResponse(spot, wire(spot.taxel)) for spot in choose_press_targets(SKIN)
    ]


def cell(patch, row, column):
    """The taxel of a patch nearest to a row and column."""
    taxels = SKIN.find_taxels(patch)
    away = np.hypot(SKIN.rows[taxels] - row, SKIN.columns[taxels] - column)
    return int(taxels[np.argmin(away)])


def patch_of(taxel):
    return SKIN.patches[SKIN.patch_index[taxel]]


def mirrored(taxel, rows=False, columns=False, turned=False):
    patch = patch_of(taxel)
    row, column = int(SKIN.rows[taxel]), int(SKIN.columns[taxel])
    row = patch.rows - 1 - row if rows else row
    column = patch.columns - 1 - column if columns else column
    if turned:
        row, column = (
            column * (patch.rows - 1) / (patch.columns - 1),
            row * (patch.columns - 1) / (patch.rows - 1),
        )
    return cell(patch.id, row, column)


def test_every_patch_has_three_spots_of_its_own():
    spots = choose_press_targets(SKIN)
    assert len({spot.taxel for spot in spots}) == 3 * len(SKIN.patches)
    assert all(patch_of(spot.taxel).id == spot.patch for spot in spots)


def test_a_skin_that_is_as_its_file_says_has_nothing_wrong():
    assert check_wiring(SKIN, answered(lambda taxel: taxel)) == []


def test_a_finger_beside_the_spot_is_right():
    def beside(taxel):
        patch = patch_of(taxel).id
        return cell(patch, SKIN.rows[taxel] + 1, SKIN.columns[taxel] - 1)

    assert check_wiring(SKIN, answered(beside)) == []


@pytest.mark.parametrize(
    ("turn", "text"),
    [
        ({"rows": True}, "has rows reversed;"),
        ({"columns": True}, "has columns reversed;"),
        ({"rows": True, "columns": True}, "has rows reversed and columns reversed;"),
        ({"turned": True}, "has rows and columns exchanged;"),
    ],
)
def test_a_patch_wired_the_other_way_round_says_which(turn, text):
    found = check_wiring(SKIN, answered(lambda taxel: mirrored(taxel, **turn)))
    assert len(found) == len(SKIN.patches)
    for patch, line in zip(SKIN.patches, found, strict=True):
        assert f"'{patch.id}' {text}" in line


def test_patches_whose_plugs_were_exchanged_name_each_other():
    one, other = SKIN.find_taxels("upper_arm_front"), SKIN.find_taxels("upper_arm_back")
    exchange = dict(zip(one.tolist(), other.tolist(), strict=True))
    exchange |= {b: a for a, b in exchange.items()}
    found = check_wiring(SKIN, answered(lambda taxel: exchange.get(taxel, taxel)))
    assert len(found) == 2
    assert "'upper_arm_front' was pressed, 'upper_arm_back' responded" in found[0]
    assert "'upper_arm_back' was pressed, 'upper_arm_front' responded" in found[1]


def test_a_patch_that_feels_nothing_is_named():
    def deaf(taxel):
        return None if patch_of(taxel).id == "wrist_3" else taxel

    [found] = check_wiring(SKIN, answered(deaf))
    assert "'wrist_3' did not respond at 3 of 3 targets" in found
