"""These tests check the matrices with crosstalk, and the counts on them."""

from dataclasses import replace

import numpy as np
import pytest

from lab.crosstalk import (
    NOISE,
    PARTS,
    PITCH,
    Condition,
    Matrix,
    compare,
    draw_matrix_press,
    find_interval,
    find_worst_patch,
    main,
    mount,
    play,
)

pytestmark = pytest.mark.slow

SMALL = Condition(0.0, size=8)
PRESSED = 27


def read(condition, pressure=None, seed=3):
    """Return a matrix and one reading of it, with one taxel pressed."""
    mounted = mount(condition)
    matrix = Matrix(condition, mounted, np.random.default_rng(seed))
    pressures = np.zeros(mounted.skin.count)
    if pressure is not None:
        pressures[PRESSED] = pressure
    return matrix, matrix.read(pressures).astype(np.float64)


def test_crosstalk_adds_half_to_each_other_taxel_of_row_and_of_column():
    _, before = read(SMALL, 60.0)
    matrix, after = read(replace(SMALL, crosstalk=0.1), 60.0)
    skin = mount(SMALL).skin
    free = 1.0 - matrix.rest / 1023
    own = (before[PRESSED] - matrix.rest[PRESSED]) / free[PRESSED]
    same_row = skin.rows == skin.rows[PRESSED]
    same_column = skin.columns == skin.columns[PRESSED]
    expected = 0.05 * own * free * (same_row ^ same_column)
    np.testing.assert_allclose(after - before, expected, atol=1.0)


def test_dead_lines_read_zero_and_add_nothing():
    condition = Condition(0.1, 2, size=8)
    matrix, counts = read(condition, None)
    skin = mount(condition).skin
    assert matrix.dead.sum() == 15 and not counts[matrix.dead].any()
    rest = matrix.calibration.rest
    assert rest is not None and not rest[matrix.dead].any()
    pressures = np.where(matrix.dead, 100.0, 0.0)
    noise = 5.0 * NOISE * 1023 + 0.5
    sound = ~matrix.dead
    pressed = matrix.read(pressures)[sound] - matrix.rest[sound]
    assert np.abs(pressed).max() < noise
    assert len(np.unique(skin.columns[matrix.dead])) == 8


def test_presses_have_their_force_wherever_they_are():
    condition = Condition(0.0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        length, press = draw_matrix_press(condition, mount(condition), rng)
        newtons = [press(at).sum() * 1000 * PITCH**2 for at in (0.0, length)]
        assert newtons[0] == pytest.approx(newtons[1])
        assert 3.0 <= newtons[0] <= 35.0


def test_counts_depend_on_the_seed_alone():
    one, same = (play(SMALL, 3.0, 5)["digest"] for _ in range(2))
    assert one == same != play(SMALL, 3.0, 6)["digest"]


def test_touches_without_crosstalk_are_felt_and_nothing_is_left_out():
    found = play(Condition(0.0, 1), 8.0, 0)
    assert found["felt"] == found["touches"] != 0
    assert found["blind"] == 0 and found["most left out"] == 0.0
    assert found["dead left out"] == found["dead"] == 16


def test_worst_patch_is_the_one_with_the_largest_share_left_out():
    valid = np.array([True, True, False, False, True, True])
    assert find_worst_patch(valid, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(1 / 3)
    assert find_worst_patch(valid, np.array([0, 0, 1, 1, 0, 0])) == 1.0


def test_interval_holds_its_share_and_ends_at_nothing_and_all():
    assert find_interval(0, 9)[0] == 0.0 and find_interval(9, 9)[1] == 1.0
    low, high = find_interval(98, 100)
    assert low < 0.98 < high


def test_results_of_other_counts_are_not_compared():
    one = play(SMALL, 3.0, 0)
    assert "100.0%" in compare({"a": {"x": [one]}, "b": {"x": [one]}})
    with pytest.raises(ValueError, match="other counts"):
        compare({"a": {"x": [one]}, "b": {"x": [one | {"digest": ""}]}})


def test_parts_vary_one_thing_at_a_time():
    for part in ("size", "rate", "bits", "curve"):
        for condition in PARTS[part].values():
            default = vars(Condition(0.05, 1))
            changed = {k for k, v in vars(condition).items() if v != default[k]}
            assert changed == {part}


def test_unknown_part_is_refused(tmp_path):
    with pytest.raises(SystemExit, match="--only has 'colour'; allowed are matrix"):
        main(["play", str(tmp_path / "out.json"), "--only", "colour"])
