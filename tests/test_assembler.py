from dataclasses import replace
from math import inf

import numpy as np
import pytest

from eskin.drivers import Data, Status
from eskin.drivers.module_registry import HOLD_TIME
from eskin.drivers.timeline import PeriodGrid
from helpers.modules import MS, PATCHES, SKIN, TAXELS, Module, World, check, tagged
from helpers.touch import SECOND, START, build_grid_skin

SETTLED = 0.2


def modules(**more):
    return [
        Module(address, serial=10 + address, boot=START - address * SECOND, **more)
        for address in range(PATCHES)
    ]


def streams(begin, end, **more):
    """All patches, of phases of their own."""
    return [
        arrival
        for n, module in enumerate(modules())
        for arrival in module.stream(begin, end, phase=0.3 * n, **more)
    ]


def scattered(arrivals, rng, spread=0.004):
    """The same with jitter, by which neighbours may change order."""
    return [
        (arrived + round(rng.uniform(0, spread) * SECOND), port, packet)
        for arrived, port, packet in arrivals
    ]


def test_every_scan_of_every_patch_is_received_once():
    world = World().play(streams(0, 4), 4.2)
    times = check(world)
    assert min(len(known) for known in times.values()) >= 193
    assert world.counts["used"] == sum(len(known) for known in times.values())
    assert world.counts["late"] <= 1
    assert all(all(world.received(n, SETTLED, 3.9)) for n in range(PATCHES))
    assert world.kinds() == ["appeared"] * PATCHES


def test_stamps_are_the_periods_times():
    world = World(rate=50).play(streams(0, 3), 3.2)
    stamps = np.array([scan.stamp for scan in world.scans])
    np.testing.assert_array_equal(stamps, START + np.arange(len(stamps)) * 20 * MS)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_jitter_does_not_flicker_between_periods(drift):
    rng = np.random.default_rng(0)
    arrivals = []
    for n, module in enumerate(modules(drift=drift)):
        arrivals += module.stream(0, 10, phase=0.5 * n)
    true = [
        (arrived + round(rng.normal(0, 1) * MS), p, k) for arrived, p, k in arrivals
    ]
    world = World().play(true, 10.2)
    check(world, slack=0.006)
    received = [world.received(n, SETTLED, 9.9) for n in range(PATCHES)]
    assert min(sum(patch) / len(patch) for patch in received) > 0.995


def test_a_patch_on_the_edge_of_two_periods_does_not_flicker():
    rng = np.random.default_rng(0)
    module, arrivals = Module(0), []
    for n in range(500):
        true = START + (n + 1) * 20 * MS + round(rng.uniform(-3, 3) * MS)
        packets = [module.hello(true)] * (n % 50 == 0) + module.data(true)
        arrivals += [(true + 2 * MS, "a", packet) for packet in packets]
    world = World().play(arrivals, 10.2)
    check(world)
    assert np.mean(world.received(0, 0.5, 9.9)) > 0.99
    assert world.counts["superseded"] <= 2


def test_a_period_is_given_out_as_soon_as_every_patch_has_delivered():
    world = World()
    given = []
    for arrived, port, packet in sorted(streams(0, 2), key=lambda item: item[0]):
        world.wait(arrived)
        world.assembler.push(packet, arrived, port)
        before = len(world.scans)
        world.poll(arrived)
        given += [arrived - scan.stamp for scan in world.scans[before:]]
    assert max(given[30:]) <= 20 * MS


def test_a_period_does_not_wait_for_a_patch_longer_than_its_deadline():
    assert PeriodGrid(START, 50.0).deadline(0) == START + 40 * MS
    assert PeriodGrid(START, 1000.0).deadline(0) == START + 21 * MS
    assert PeriodGrid(START, 50.0, grace=0.001).deadline(0) == START + 21 * MS


def test_without_any_patch_readings_come_at_the_rate_with_nothing_received():
    world = World().play([], 5.0)
    assert len(world.scans) == 249
    assert not any(scan.received.any() for scan in world.scans)
    assert world.assembler.ages(world.now) == {"p0": inf, "p1": inf, "p2": inf}


def test_a_patch_that_was_never_heard_is_not_received():
    arrivals = [item for item in streams(0, 2) if item[2].address != 1]
    world = World().play(arrivals, 2.1)
    check(world)
    assert not any(world.received(1)) and all(world.received(0, SETTLED, 1.9))
    ages = world.assembler.ages(world.now)
    assert ages["p1"] == inf and 0.1 < ages["p0"] < 0.15


def test_data_before_the_first_hello_is_not_used():
    hello = Module(0).hello(START + SECOND)
    data = [item for item in Module(0).stream(0, 2) if isinstance(item[2], Data)]
    world = World().play([*data, (START + SECOND, "a", hello)], 2.1)
    times = check(world)
    assert min(times[0]) > START + SECOND and len(times[0]) > 40


def test_scans_of_several_packets_count_only_when_complete():
    rng = np.random.default_rng(1)
    arrivals = scattered(Module(0).stream(0, 6, parts=3), rng)
    kept = [
        item for item in arrivals if rng.random() > 0.05 or item[0] < START + SECOND
    ]
    world = World().play(kept, 6.2)
    times = check(world, slack=0.01)
    assert len(times[0]) > 190 and world.counts["incomplete"] > 30
    assert world.counts["used"] == 3 * len(times[0])


def test_whatever_befalls_packets_counters_add_up_and_nothing_old_is_new():
    rng = np.random.default_rng(2)
    arrivals = []
    for item in scattered(streams(0, 12, parts=2), rng, 0.015):
        if rng.random() > 0.1:
            arrivals.append(item)
        if rng.random() < 0.1:
            arrivals.append(
                (item[0] + round(rng.exponential(0.05) * SECOND), *item[1:])
            )
        if rng.random() < 0.02:
            arrivals.append((item[0] + round(rng.uniform(0.4, 8) * SECOND), *item[1:]))
    world = World().play(arrivals, 24)
    times = check(world, slack=0.025)
    assert min(len(known) for known in times.values()) > 400
    for fate in ("used", "duplicate", "late", "incomplete", "hello"):
        assert world.counts[fate] > 0


def test_lost_scans_are_counted_by_their_numbers():
    rng = np.random.default_rng(3)
    arrivals = Module(0, scan=2**16 - 100).stream(0, 10)
    begin, end = START + SECOND, START + 9 * SECOND
    lost = [item for item in arrivals if begin < item[0] < end and rng.random() < 0.1]
    lost = [item for item in lost if isinstance(item[2], Data)]
    world = World().play([item for item in arrivals if item not in lost], 10.2)
    assert world.assembler.counters()["lost"] == len(lost)
    assert len(world.said("lost")) in (1, 2)


def test_two_scans_of_one_period_are_not_both_used():
    world = World(rate=50).play(Module(0, rate=100).stream(0, 5), 5.2)
    times = check(world)
    assert len(times[0]) >= 240
    assert world.counts["superseded"] > 200 and world.counts["late"] == 0
    assert all(world.received(0, SETTLED, 4.9))


def test_of_two_scans_that_come_in_the_wrong_order_the_newer_is_used():
    first, *rest = [Module(0, rate=100).stream(0, 3), Module(1, serial=2).stream(0, 3)]
    data = [item for item in first if isinstance(item[2], Data)]
    hellos = [item for item in first if not isinstance(item[2], Data)]
    swapped = []
    for one, two in zip(data[::2], data[1::2], strict=True):
        swapped += [(two[0], *two[1:]), (two[0] + MS, *one[1:])]
    late = [(when + 15 * MS, *item) for when, *item in rest[0]]
    world = World().play([*hellos, *swapped, *late], 3.2)
    times = check(world, slack=0.02)
    assert world.counts["superseded"] >= 130
    assert all((np.array(times[0][5:]) - START) // (10 * MS) % 2 == 1)


def test_packets_that_come_twice_are_used_once():
    arrivals = streams(0, 4)
    twice = [(when + MS, *item) for when, *item in arrivals]
    world = World().play(arrivals + twice, 4.2)
    check(world)
    used = world.counts["used"]
    assert used > 570 and abs(world.counts["duplicate"] - used) <= 3


def test_a_slow_patch_is_received_when_it_delivers():
    world = World(rate=50).play(Module(0, rate=25).stream(0, 5), 5.2)
    check(world)
    share = np.mean(world.received(0, 0.5, 4.9))
    assert share == pytest.approx(0.5, abs=0.02)
    assert world.kinds("appeared") == []


def test_a_patch_below_its_promised_rate_is_slow_until_it_is_not():
    arrivals = []
    for n, item in enumerate(Module(0).stream(0, 12)):
        between = START + 3 * SECOND < item[0] < START + 7 * SECOND
        if not between or n % 2 or not isinstance(item[2], Data):
            arrivals.append(item)
    world = World().play(arrivals, 12.2)
    assert world.kinds("lost") == ["appeared", "slow", "on_rate"]


def test_a_packet_of_an_unknown_address_is_foreign():
    stray = Module(address=9).stream(0, 2)
    world = World().play(streams(0, 2) + stray, 2.2)
    check(world)
    assert world.counts["foreign"] == len(stray)
    assert world.kinds().count("misfit") == 1


def test_a_packet_of_the_wrong_patch_never_replaces_the_right_one():
    liar = Module(address=1, serial=10, boot=START - 777 * SECOND, scan=5000)
    stray = [item for item in liar.stream(1, 5) if isinstance(item[2], Data)]
    wrong = [
        (arrived, port, replace(p, counts=p.counts ^ 1)) for arrived, port, p in stray
    ]
    world = World().play(streams(0, 6) + wrong, 6.2)
    check(world)
    assert len(wrong) <= world.counts["late"] <= len(wrong) + 4
    assert all(world.received(1, SETTLED, 5.9))


def test_taxels_that_a_patch_has_not_are_damage():
    bad = Data(0, 1, 0, TAXELS - 1, np.zeros(2, np.uint16))
    none = Data(0, 1, 0, 0, np.zeros(0, np.uint16))
    extra = [(START + SECOND, "a", bad), (START + SECOND, "a", none)]
    world = World().play(streams(0, 2) + extra, 2.2)
    check(world)
    assert world.counts["damaged"] == 2 and len(world.said("damaged")) == 1


def test_data_of_two_modules_with_one_address_is_not_used():
    other = Module(0, serial=99, boot=START - 500 * SECOND).stream(2, 6)
    world = World().play(streams(0, 12) + other, 12.2)
    check(world)
    assert not any(world.received(0, 2.1, 7.9))
    assert all(world.received(0, 9.5, 11.9)) and all(world.received(1, SETTLED, 11.9))
    assert world.kinds().count("conflict") == 1


def test_data_of_two_ports_with_one_address_is_not_used():
    other = Module(0, serial=99, boot=START - 500 * SECOND).stream(2, 6, port="b")
    world = World().play(streams(0, 12) + other, 12.2)
    check(world)
    assert not any(world.received(0, 2.1, 8.9))
    assert all(world.received(0, 9.5, 11.9))
    assert world.kinds().count("conflict") == 1


def test_a_patch_unplugged_and_replugged_fifty_times_goes_on_each_time():
    module, arrivals = Module(0), []
    for n in range(50):
        begin = 1.5 * n
        module.reboot(START + round((begin - 0.3) * SECOND))
        arrivals += module.stream(begin, begin + 0.5)
    world = World().play(arrivals, 75)
    times = check(world)
    assert len(times[0]) >= 50 * 17
    for n in range(50):
        assert all(world.received(0, 1.5 * n + 0.2, 1.5 * n + 0.45))
        assert not any(world.received(0, 1.5 * n + 0.6, 1.5 * n + 1.4))
    assert world.said("silent")[-1].stamp > START + 74 * SECOND
    assert len(world.said("returned")) == 49
    assert "replaced" not in world.kinds()


def test_a_replaced_module_is_not_received_until_the_calibrator_tares_anew():
    first = Module(0, serial=1).stream(0, 3)
    second = Module(0, serial=2, boot=START + 4 * SECOND).stream(4, 20)
    world = World().play(first + second, 20.2)
    check(world)
    stamps = [s.stamp for s in world.scans if s.received[0]]
    gap = np.diff(stamps).max() / SECOND
    assert 10.0 < gap < HOLD_TIME / SECOND + 0.1
    assert world.kinds().count("replaced") == 1
    assert all(world.received(0, 14, 19.9))


def test_a_replaced_module_whose_first_hello_is_lost_is_not_taken_for_the_old_one():
    first = Module(0, serial=1).stream(0, 3)
    second = Module(0, serial=2, boot=START + 3 * SECOND).stream(3.05, 20)
    world = World().play(first + second[1:], 20.2)
    check(world)
    assert not any(world.received(0, 3.05, 13.0)) and all(world.received(0, 14, 19.9))


def test_a_reboot_in_mid_stream_is_said_and_costs_a_moment():
    module = Module(0)
    arrivals = module.stream(0, 5)
    module.reboot(START + 5 * SECOND)
    arrivals += module.stream(5, 10)
    world = World().play(arrivals, 10.2)
    check(world)
    assert all(world.received(0, SETTLED, 4.9)) and all(world.received(0, 5.2, 9.9))
    assert world.kinds("lost") == ["appeared", "rebooted"]


def test_a_device_clock_that_wraps_changes_nothing():
    module = Module(0, start=2**32 - 2_000_000)
    world = World().play(module.stream(0, 5), 5.2)
    check(world)
    assert all(world.received(0, SETTLED, 4.9)) and world.kinds() == ["appeared"]


@pytest.mark.parametrize("jump", [-3_000_000_000, 3_000_000_000, 10_000_000])
def test_a_device_clock_that_jumps_never_makes_old_data_new(jump):
    module = Module(0, start=2**31)
    arrivals = module.stream(0, 5)
    module.start += jump // 1000
    arrivals += module.stream(5, 10)
    world = World().play(arrivals, 10.2)
    check(world)
    assert all(world.received(0, 6, 9.9))


def test_while_every_patch_stalls_readings_go_on_and_what_comes_then_is_late():
    late = START + 8 * SECOND
    arrivals = [
        (late if START + 3 * SECOND < when < late else when, port, packet)
        for when, port, packet in streams(0, 10)
    ]
    world = World().play(arrivals, 10.2)
    check(world)
    for n in range(PATCHES):
        silent = world.received(n, 3.1, 7.9)
        assert len(silent) >= 239 and not any(silent)
        assert all(world.received(n, 8.1, 9.9))
    assert world.counts["late"] >= 3 * 240
    assert len(world.said("returned")) == PATCHES
    assert world.kinds().count("rebooted") == 0


def test_when_the_whole_process_slept_it_goes_on_with_the_present():
    world = World().play(streams(0, 3), 3.0)
    given = len(world.scans)
    world.poll(START + 63 * SECOND)
    assert len(world.scans) - given <= 26
    assert world.assembler.counters()["skipped"] > 2900
    assert world.scans[-1].stamp > START + 62 * SECOND
    check(world)


def test_a_short_sleep_of_the_process_loses_nothing_that_the_system_kept():
    arrivals = sorted(streams(0, 6), key=lambda item: item[0])
    asleep = START + 3 * SECOND, START + 3 * SECOND + 400 * MS
    world = World().play([a for a in arrivals if a[0] < asleep[0]], 3.0)
    for arrived, port, packet in arrivals:
        if asleep[0] <= arrived < asleep[1]:
            world.assembler.push(packet, asleep[1], port)
            world.pushed += 1
    world.play([a for a in arrivals if a[0] >= asleep[1]], 6.2)
    check(world)
    assert all(all(world.received(n, SETTLED, 5.9)) for n in range(PATCHES))
    assert world.assembler.counters()["skipped"] == 0


def test_the_skew_between_patches_is_known():
    arrivals = Module(0).stream(0, 5) + Module(1, serial=2).stream(0, 5, phase=0.4)
    world = World().play(arrivals, 5.2)
    skews = world.assembler.skews()
    assert skews["p1"] - skews["p0"] == pytest.approx(0.008, abs=0.0005)
    assert "p2" not in skews


def test_status_counts_as_status_only_of_a_patch_that_is_there():
    status = [Status(address, 0, 0, 0, 0, 0) for address in (0, 7)]
    extra = [(START + SECOND, "a", packet) for packet in status]
    world = World().play(Module(0).stream(0, 2) + extra, 2.2)
    assert world.counts["status"] == 1 and world.counts["foreign"] == 1


def test_scans_that_a_patch_says_it_skipped_are_told_as_lost():
    skipped = [5, 5, 9, 0, 2]
    statuses = [
        (START + (n + 1) * SECOND // 2, "a", Status(0, 0, 0, count, 0, 0))
        for n, count in enumerate(skipped)
    ]
    world = World().play(Module(0).stream(0, 14) + statuses, 14.2)
    lost = [event for event in world.events if event.kind == "lost"]
    # What it skipped before it was heard is not of this stream.
    assert [event.text.split()[0] for event in lost] == ["4", "2"]
    assert all("left out by the patch itself" in event.text for event in lost)
    assert lost[0].patch == "p0"


def test_taxels_of_patches_that_lie_mixed_in_the_skin_go_where_they_belong():
    skin = build_grid_skin(2, 3, PATCHES)
    mixed = replace(skin, patch_index=np.tile(np.arange(PATCHES), TAXELS))
    world = World(skin=mixed).play(streams(0, 2), 2.0)
    scan = next(scan for scan in reversed(world.scans) if scan.received.all())
    for n in range(PATCHES):
        counts = scan.counts[mixed.patch_index == n]
        tick = int(counts[0] + (counts[1] << 16))
        np.testing.assert_array_equal(counts, tagged(START + tick * MS // 10, n))


def test_a_thousand_scans_a_second_are_all_used():
    arrivals = [
        item
        for n in range(PATCHES)
        for item in Module(n, serial=n, rate=1000).stream(0, 1, phase=0.2 * n)
    ]
    world = World(rate=1000).play(arrivals, 1.2)
    check(world)
    assert all(all(world.received(n, SETTLED, 0.9)) for n in range(PATCHES))
    assert SKIN.count == PATCHES * TAXELS
