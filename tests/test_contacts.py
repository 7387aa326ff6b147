import numpy as np
import pytest

from eskin.errors import ReadingError
from eskin.skin import MountedSkin
from eskin.touch import ContactConfig
from helpers.touch import (
    build_grid_skin,
    hinged_skin,
    mounted_grid,
    moved,
    permuted,
    pipeline_of,
    pressed,
    reading_at,
)


def contacts_of(mounted, reading):
    """The contacts of a first reading."""
    return pipeline_of(mounted).push_reading(reading).contacts


def test_no_pressure_makes_no_contact():
    mounted = mounted_grid()
    assert contacts_of(mounted, reading_at(0.0, np.zeros(36))) == ()


def test_force_area_peak_and_centre_follow_from_the_taxels():
    mounted = mounted_grid()
    pressure = pressed(mounted.skin, (0.02, 0.02), kpa=10.0, radius=0.001)
    pressure += pressed(mounted.skin, (0.03, 0.02), kpa=30.0, radius=0.001)
    (contact,) = contacts_of(mounted, reading_at(0.0, pressure))
    assert contact.force == pytest.approx(40e3 * 1e-4)
    assert contact.area == pytest.approx(2e-4)
    assert contact.peak == pytest.approx(30.0)
    np.testing.assert_allclose(contact.p_world, [0.0275, 0.02, 0.0], atol=1e-9)
    np.testing.assert_allclose(contact.n_world, [0.0, 0.0, 1.0])
    assert (contact.link, contact.patch) == ("table", "p0")


def test_two_presses_apart_are_two_contacts_and_a_bridge_joins_them():
    mounted = mounted_grid(rows=6, columns=12)
    apart = pressed(mounted.skin, (0.02, 0.02)) + pressed(mounted.skin, (0.08, 0.02))
    pipeline = pipeline_of(mounted)
    assert len(pipeline.push_reading(reading_at(0.0, apart)).contacts) == 2
    bridge = np.maximum(apart, np.where(mounted.skin.rows == 2, 10.0, 0.0))
    assert len(pipeline.push_reading(reading_at(0.1, bridge)).contacts) == 1


def test_a_press_on_a_seam_is_one_contact():
    mounted = mounted_grid(patches=2, gap=0.016)
    (contact,) = contacts_of(
        mounted, reading_at(0.0, pressed(mounted.skin, (0.058, 0.02), radius=0.015))
    )
    assert set(mounted.skin.patch_index[contact.taxels]) == {0, 1}


def test_taxels_connect_across_links_by_the_live_pose():
    mounted = hinged_skin()
    pressure = np.zeros(mounted.skin.count)
    pressure[mounted.skin.columns == 5] = 20.0
    near, far = np.array([0.0]), np.array([1.5])
    pipeline = pipeline_of(mounted)
    assert len(pipeline.push_reading(reading_at(0.0, pressure, q=near)).contacts) == 1
    assert len(pipeline.push_reading(reading_at(0.1, pressure, q=far)).contacts) == 2


def test_a_taxel_between_the_thresholds_stays_as_it_was():
    mounted = mounted_grid()
    config = ContactConfig(on=3.0, off=2.0)
    pipeline = pipeline_of(mounted, config)
    sizes = []
    for step, kpa in enumerate([2.5, 3.5, 2.5, 1.5, 2.5]):
        pressure = pressed(mounted.skin, (0.02, 0.02), kpa=kpa)
        sizes.append(
            len(pipeline.push_reading(reading_at(step / 10, pressure)).contacts)
        )
    assert sizes == [0, 1, 1, 0, 0]


def test_what_a_sensor_keeps_after_a_firm_touch_is_no_contact():
    mounted = mounted_grid()
    pipeline = pipeline_of(mounted)
    found = []
    for step, kpa in enumerate([60.0, 5.0, 5.0, 40.0]):
        pressure = pressed(mounted.skin, (0.02, 0.02), kpa=kpa)
        found.append(
            len(pipeline.push_reading(reading_at(step / 10, pressure)).contacts)
        )
    assert found == [1, 0, 0, 1]


def test_nan_and_invalid_never_become_a_contact():
    mounted = mounted_grid()
    pressure = np.full(36, 50.0, np.float32)
    pressure[:6] = np.nan
    reading = reading_at(0.0, pressure, valid=np.zeros(36, bool))
    assert contacts_of(mounted, reading) == ()
    valid = np.isfinite(pressure)
    (contact,) = contacts_of(mounted, reading_at(0.0, pressure, valid=valid))
    assert np.isfinite(contact.force)
    assert not np.isnan(pressure[contact.taxels]).any()


def test_a_contact_survives_one_lost_packet_with_its_hysteresis():
    mounted = mounted_grid()
    pipeline = pipeline_of(mounted, ContactConfig(on=3.0, off=2.0))
    firm = pressed(mounted.skin, (0.02, 0.02), kpa=4.0)
    weak = pressed(mounted.skin, (0.02, 0.02), kpa=2.5)
    assert len(pipeline.push_reading(reading_at(0.00, firm)).contacts) == 1
    lost = reading_at(0.02, weak, valid=np.zeros(36, bool))
    assert len(pipeline.push_reading(lost).contacts) == 0
    assert len(pipeline.push_reading(reading_at(0.04, weak)).contacts) == 1


@pytest.mark.parametrize("step", [0.01, 0.1, 0.3])
def test_a_taxel_released_needs_the_upper_threshold_again_at_any_rate(step):
    mounted = mounted_grid()
    pipeline, sizes = pipeline_of(mounted, ContactConfig(on=3.0, off=2.0)), []
    for n, kpa in enumerate([5.0, 0.0, 2.5, 2.5, 3.5, 1.5, 2.5]):
        pressure = pressed(mounted.skin, (0.02, 0.02), kpa=kpa)
        sizes.append(
            len(pipeline.push_reading(reading_at(step * n, pressure)).contacts)
        )
    assert sizes == [1, 0, 0, 0, 1, 0, 0]


def described(contacts, order=None):
    return [
        (
            sorted(c.taxels.tolist()) if order is None else sorted(order[c.taxels]),
            c.force,
            c.area,
            c.peak,
            c.patch,
        )
        for c in contacts
    ]


def random_presses(skin):
    rng = np.random.default_rng(5)
    return np.where(rng.random(skin.count) < 0.3, 20 * rng.random(skin.count), 0.0)


def test_contacts_do_not_depend_on_the_order_of_the_taxels():
    skin = build_grid_skin(rows=9, columns=9, patches=2)
    order = np.random.default_rng(4).permutation(skin.count)
    robot = mounted_grid().robot
    pressure = random_presses(skin)
    one = contacts_of(MountedSkin(skin, robot), reading_at(0.0, pressure))
    other = contacts_of(
        MountedSkin(permuted(skin, order), robot), reading_at(0.0, pressure[order])
    )
    assert len(one) > 3
    assert described(one) == described(other, order)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.p_world, b.p_world)


def test_contacts_move_with_a_rigid_motion_of_the_robot():
    mounted = hinged_skin()
    T = moved(np.array([0.3, -0.7, 0.9]), np.array([1.0, 2.0, -3.0]))
    other = hinged_skin(T)
    pressure, q = random_presses(mounted.skin), np.array([0.4])
    one = contacts_of(mounted, reading_at(0.0, pressure, q=q))
    two = contacts_of(other, reading_at(0.0, pressure, q=q))
    assert described(one) == described(two)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(T[:3, :3] @ a.p_world + T[:3, 3], b.p_world)
        np.testing.assert_allclose(T[:3, :3] @ a.n_world, b.n_world)
        np.testing.assert_allclose(a.p_link, b.p_link, atol=1e-12)


def test_forces_of_all_contacts_add_up_to_that_of_the_active_taxels():
    skin = build_grid_skin(rows=9, columns=9)
    pressure = random_presses(skin).astype(np.float32)
    contacts = contacts_of(mounted_grid(rows=9, columns=9), reading_at(0.0, pressure))
    whole = 1e3 * (pressure * skin.areas)[pressure >= ContactConfig().on].sum()
    assert sum(c.force for c in contacts) == pytest.approx(whole, rel=1e-6)


def test_a_reading_of_another_length_or_robot_is_refused_in_one_line():
    pipeline = pipeline_of(mounted_grid())
    with pytest.raises(ReadingError, match="reading has 5 taxels, skin 'grid' has 36"):
        pipeline.push_reading(reading_at(0.0, np.zeros(5)))
    with pytest.raises(ReadingError, match="q has 2 joints, robot 'bench' has 0"):
        pipeline.push_reading(reading_at(0.0, np.full(36, 9.0), q=np.zeros(2)))
