"""The ur5 skin has the size and density that are published, and fits its arm."""

import numpy as np
import pytest

from eskin.robot import load_robot
from eskin.skin import (
    SKIN_PRESETS,
    build_grid_skin,
    check_skin,
    fit_surface,
    load_robot_for_skin,
    load_skin,
)

SKIN = load_skin("ur5")
ROBOT = load_robot("ur5")


def density(patch_id):
    taxels = SKIN.find_taxels(patch_id)
    return len(taxels) / (1e4 * SKIN.areas[taxels].sum())


def test_2112_taxels_lie_in_nine_patches_at_1_5_to_1_6_a_square_centimetre():
    assert SKIN.count == 2112
    assert len(SKIN.patches) == len(set(SKIN.patch_index)) == 9
    assert 1.5 <= SKIN.count / (1e4 * SKIN.areas.sum()) <= 1.6


def test_every_patch_toward_the_tool_is_at_least_as_dense():
    densities = [density(patch.id) for patch in SKIN.patches]
    assert np.all(np.diff(densities) >= -1e-9)
    assert len(np.unique(np.round(densities, 1))) >= 3
    links = [ROBOT.link_index(patch.link) for patch in SKIN.patches]
    assert links == sorted(links)


def test_patches_are_irregular():
    full = [
        len(SKIN.find_taxels(patch.id)) == patch.rows * patch.columns
        for patch in SKIN.patches
    ]
    assert not any(full), "every patch lacks corners"
    taxels = SKIN.find_taxels("forearm_front")
    surface = fit_surface(SKIN.positions[taxels], SKIN.normals[taxels])
    s, _ = surface.unroll(SKIN.positions[taxels]).T
    row = SKIN.rows[taxels]
    assert np.ptp(s[row == 0]) > 1.1 * np.ptp(s[row == 26]), "a trapezoid"


@pytest.mark.parametrize(
    ("one", "other", "radius"),
    [
        ("upper_arm_front", "upper_arm_back", 0.0505),
        ("forearm_front", "forearm_back", 0.0375),
        ("wrist_3", "wrist_3", 0.0375),
    ],
)
def test_strips_of_3_to_8_mm_stay_free_between_the_edges_of_shells(one, other, radius):
    for row in (5, 15) if one != other else (2,):
        widths = []
        for patch_id in {one, other}:
            taxels = SKIN.find_taxels(patch_id)
            surface = fit_surface(SKIN.positions[taxels], SKIN.normals[taxels])
            s, t = surface.unroll(SKIN.positions[taxels]).T
            here = np.sort(s[SKIN.rows[taxels] == row])
            widths.append(np.ptp(here) + np.diff(here).mean())
        gap = (2 * np.pi * radius - sum(widths)) / len(widths)
        assert 0.003 <= gap <= 0.008


@pytest.mark.parametrize("name", SKIN_PRESETS)
def test_the_check_finds_nothing_wrong_with_a_preset(name):
    assert check_skin(load_skin(name), load_robot_for_skin(name)) == []


def test_the_public_sets_skins_are_flat_grids_of_nominal_pitch():
    sleeve, shearsense = load_skin("sleeve"), load_skin("shearsense")
    assert sleeve.count == 513 and not sleeve.calibrated and not sleeve.has_shear
    assert shearsense.count == 36 and shearsense.has_shear
    steps = sleeve.positions[1:27] - sleeve.positions[:26]
    assert np.allclose(steps, [0.01, 0, 0])
    assert np.allclose(sleeve.positions.mean(axis=0), 0)
    assert np.allclose(sleeve.areas, 1e-4)
    assert (
        load_robot_for_skin("sleeve").name == "table"
        and load_robot_for_skin("other") is None
    )


def test_a_grid_of_no_taxels_is_refused():
    with pytest.raises(ValueError, match="a grid of 0 x 4 taxels"):
        build_grid_skin(0, 4)


def test_a_patch_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(ValueError, match="no patch 'knee'; its patches: upper_arm_fr"):
        SKIN.find_taxels("knee")
