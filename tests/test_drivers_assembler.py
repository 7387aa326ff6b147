"""Tests of `Assembler`: packets of single patches become scans of the whole skin."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.drivers import Data, Status
from helpers.modules import (
    MS,
    PATCHES,
    TAXELS,
    AssemblerRun,
    Module,
    make_counts,
    stream_all,
)
from helpers.touch import SECOND, START, build_grid_skin

pytestmark = pytest.mark.slow

SETTLED = 0.2
"""When the clocks of patches that send from the start are known [s]."""


def assemble(arrivals, until, slack=0.003, **options):
    """Return a run whose laws hold, and when what it received was taken."""
    run = AssemblerRun(**options).play(arrivals, until)
    return run, run.check(slack)


def is_data(arrival):
    return isinstance(arrival[2], Data)


def delay(arrivals, rng, spread):
    """Return the same later, by random times [s] of which neighbours change order."""
    return [
        (when + round(rng.uniform(0, spread) * SECOND), *rest)
        for when, *rest in arrivals
    ]


def test_every_scan_of_every_patch_is_received_once():
    run, times = assemble(stream_all(0, 4), 4.2)
    assert min(len(known) for known in times.values()) >= 193
    assert run.counts["used"] == sum(len(known) for known in times.values())
    assert run.counts["late"] <= 1
    assert all(run.received(n, SETTLED, 3.9) == 1 for n in range(PATCHES))
    assert run.kinds() == ["appeared"] * PATCHES
    stamps = [scan.stamp for scan in run.scans]
    np.testing.assert_array_equal(stamps, START + np.arange(len(stamps)) * 20 * MS)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4, -0.01, -0.005, 0.01])
def test_drift_and_jitter_do_not_put_two_scans_in_one_period(drift):
    rng = np.random.default_rng(0)
    module = Module(drift=drift)
    arrivals = [
        (arrived + round(rng.normal(0, 1) * MS), port, packet)
        for arrived, port, packet in module.stream(0, 10, phase=0.3)
    ]
    run = AssemblerRun()
    for second in range(10):
        clock = run.assembler.streams[0].clock
        # Only with echoes may a clock be worse than a crystal.
        if abs(drift) > 1e-3:
            now = START + second * SECOND
            clock.push_echo(module.device_time(now), now - 2 * MS, now + 2 * MS)
        part = [a for a in arrivals if (a[0] - START) // SECOND == second]
        run.play(part, second + 1.0)
    run.play([], 10.2).check(0.03)
    assert run.received(0, SETTLED, 9.9) > 0.98
    assert clock.drift == pytest.approx(-drift, rel=0.3, abs=2e-4)


def test_clock_worse_than_a_crystal_is_late_without_echoes():
    run, _ = assemble(Module(drift=-0.01).stream(0, 10), 10.2, slack=0.03)
    assert run.received(0, 6, 9.9) == 0
    assert run.kinds() == ["appeared", "late"]


def test_patch_that_is_late_is_said_and_used_again_in_time():
    arrivals = Module(0).stream(0, 12)
    late = [
        (when + 3 * SECOND // 10 * (4 < (when - START) / SECOND < 8), *rest)
        for when, *rest in arrivals
    ]
    run, _ = assemble(late, 12.2)
    assert run.received(0, 4.02, 8) == 0
    assert run.received(0, SETTLED, 4) == run.received(0, 8.4, 11.9) == 1
    assert run.kinds("lost") == ["appeared", "late", "in_time"]
    said = run.find_events("late")[0]
    assert said.patch == "p0" and "300 ms" in said.text
    assert said.stamp - START < 5.3 * SECOND


@pytest.mark.parametrize("first", [-3, 3])
def test_patch_on_the_edge_of_two_periods_keeps_its_phase(first):
    rng = np.random.default_rng(0)
    module = Module(0)
    arrivals = []
    for n in range(200):
        jitter = first if n < 10 else rng.uniform(-3, 3)
        # Every packet is equally late, so its stamp is that of its arrival.
        arrived = START + (n + 1) * 20 * MS + round(jitter * MS)
        taken = arrived - 2 * MS
        packets = [module.hello(taken)] * (n % 50 == 0) + module.data(taken)
        arrivals += [(arrived, "a", packet) for packet in packets]
    run, _ = assemble(arrivals, 4.2)
    assert run.received(0, 0.5, 3.9) > 0.99
    assert run.counts["superseded"] <= 2


def test_complete_period_is_given_out_at_once():
    run = AssemblerRun()
    ages = []
    for arrived, port, packet in sorted(stream_all(0, 2), key=lambda item: item[0]):
        run.wait(arrived)
        run.push_packet(packet, arrived, port)
        before = len(run.scans)
        run.poll(arrived)
        ages += [arrived - scan.stamp for scan in run.scans[before:]]
    assert max(ages[30:]) <= 20 * MS


@pytest.mark.parametrize(
    ("rate", "grace", "deadline"), [(50, None, 40), (1000, None, 21), (50, 0.001, 21)]
)
def test_incomplete_period_waits_until_its_deadline(rate, grace, deadline):
    run = AssemblerRun()
    run.assembler.start(START, float(rate), grace)
    assert run.assembler.next_deadline() == START + deadline * MS


def test_empty_scans_come_at_the_rate_without_any_patch():
    run, _ = assemble([], 5.0)
    assert len(run.scans) == 249
    assert not any(scan.received.any() for scan in run.scans)


def test_absent_patch_is_not_received():
    arrivals = [item for item in stream_all(0, 2) if item[2].address != 1]
    run, _ = assemble(arrivals, 2.1)
    assert (run.received(1), run.received(0, SETTLED, 1.9)) == (0, 1)


def test_data_before_the_first_hello_is_not_used():
    hello = START + SECOND, "a", Module(0).hello(START + SECOND)
    _, times = assemble([*filter(is_data, Module(0).stream(0, 2)), hello], 2.1)
    assert min(times[0]) > START + SECOND and len(times[0]) > 40


def test_only_complete_scans_of_several_packets_are_used():
    rng = np.random.default_rng(1)
    arrivals = delay(Module(0).stream(0, 6, parts=3), rng, 0.004)
    kept = [
        item for item in arrivals if rng.random() > 0.05 or item[0] < START + SECOND
    ]
    run, times = assemble(kept, 6.2, slack=0.01)
    assert len(times[0]) > 190 and run.counts["incomplete"] > 30
    assert run.counts["used"] == 3 * len(times[0])


def test_outcomes_add_up_when_packets_are_lost_doubled_and_delayed():
    rng = np.random.default_rng(2)
    arrivals = []
    for when, *rest in delay(stream_all(0, 6, parts=2), rng, 0.015):
        if rng.random() > 0.1:
            arrivals.append((when, *rest))
        if rng.random() < 0.1:
            arrivals.append((when + round(rng.exponential(0.05) * SECOND), *rest))
        if rng.random() < 0.02:
            arrivals.append((when + round(rng.uniform(0.4, 5) * SECOND), *rest))
    run, times = assemble(arrivals, 14, slack=0.025)
    assert min(len(known) for known in times.values()) > 200
    assert run.counts["used"] == 2 * sum(len(known) for known in times.values())
    for outcome in ("used", "duplicate", "late", "incomplete", "hello"):
        assert run.counts[outcome] > 0


def test_one_of_two_scans_of_a_period_is_used():
    run, times = assemble(Module(0, rate=100).stream(0, 5), 5.2, rate=50)
    assert len(times[0]) >= 240
    assert run.counts["superseded"] > 200 and run.counts["late"] == 0
    assert run.received(0, SETTLED, 4.9) == 1


def test_newer_of_two_scans_in_the_wrong_order_is_used():
    first = Module(0, rate=100).stream(0, 3)
    data = list(filter(is_data, first))
    arrivals = [item for item in first if not is_data(item)]
    for one, two in zip(data[::2], data[1::2], strict=True):
        arrivals += [(two[0], *two[1:]), (two[0] + MS, *one[1:])]
    late = Module(1, serial=2).stream(0, 3)
    arrivals += [(when + 15 * MS, *item) for when, *item in late]
    run, times = assemble(arrivals, 3.2, slack=0.02)
    assert run.counts["superseded"] >= 130
    assert all((np.array(times[0][5:]) - START) // (10 * MS) % 2 == 1)


def test_patch_of_half_the_rate_is_in_half_of_the_scans():
    run, _ = assemble(Module(0, rate=25).stream(0, 5), 5.2, rate=50)
    assert run.received(0, 0.5, 4.9) == pytest.approx(0.5, abs=0.02)
    assert run.kinds("appeared") == []


def test_patch_below_its_nominal_rate_is_reported():
    arrivals = []
    for n, item in enumerate(Module(0).stream(0, 12)):
        slow = START + 3 * SECOND < item[0] < START + 7 * SECOND
        if not slow or n % 2 or not is_data(item):
            arrivals.append(item)
    run, _ = assemble(arrivals, 12.2)
    assert run.kinds("lost") == ["appeared", "slow", "on_rate"]


def test_data_of_another_clock_under_the_address_is_not_used():
    other = Module(address=1, serial=11, boot=START - 777 * SECOND, scan=5000)
    wrong = [
        (arrived, port, replace(packet, counts=packet.counts ^ 1))
        for arrived, port, packet in filter(is_data, other.stream(1, 5))
    ]
    run, _ = assemble(stream_all(0, 6) + wrong, 6.2)
    assert len(wrong) <= run.counts["late"] <= len(wrong) + 4
    assert run.received(1, SETTLED, 5.9) == 1


def test_taxels_outside_the_patch_are_damage():
    extra = [
        (START + SECOND, "a", Data(0, 1, 0, first, np.zeros(count, np.uint16)))
        for first, count in ((TAXELS - 1, 2), (0, 0))
    ]
    run, _ = assemble(stream_all(0, 2) + extra, 2.2)
    assert run.counts["damaged"] == 2
    assert len(run.find_events("damaged")) == 1


@pytest.mark.parametrize("first_hello", [True, False])
def test_replacement_module_is_held_until_it_is_tared(first_hello):
    first = Module(0, serial=1).stream(0, 3)
    second = Module(0, serial=2, boot=START + 3 * SECOND).stream(3.05, 16)
    run, _ = assemble(first + second[not first_hello :], 16.2)
    assert (run.received(0, 3.05, 13.0), run.received(0, 14, 15.9)) == (0, 1)
    assert len(run.find_events("replaced")) == 1


@pytest.mark.parametrize("jump", [-3_000_000, 10_000, 3_000_000, 2**31])
def test_jump_or_wrap_of_the_device_clock_never_makes_old_data_new(jump):
    module = Module(0, clock_start=2**32 - 2_000_000, scan=2**16 - 100)
    arrivals = module.stream(0, 6)
    module.clock_start += jump
    run, _ = assemble(arrivals + module.stream(6, 12), 12.2)
    assert run.received(0, SETTLED, 5.9) == run.received(0, 7, 11.9) == 1


def test_packets_delayed_for_seconds_are_no_reboot():
    arrivals = Module(0).stream(0, 8)
    late = [(when + 4 * SECOND, *rest) for when, *rest in arrivals[100:200]]
    run, _ = assemble(arrivals[:100] + arrivals[200:] + late, 8.2)
    assert run.received(0, 4.2, 7.9) == 1
    assert run.counts["late"] >= 95 and "rebooted" not in run.kinds()


@pytest.mark.parametrize(("begin", "end"), [(0, 2), (0, 4), (3.7, 4)])
def test_burst_after_a_stall_does_not_shift_the_times_of_scans(begin, end):
    late = START + end * SECOND
    arrivals = [
        (late if begin < (when - START) / SECOND < end else when, *rest)
        for when, *rest in Module(0).stream(0, 10)
    ]
    run = AssemblerRun()
    run.assembler.start(START, 50.0, 0.5)
    run.play(arrivals, 10.6).check()
    assert run.received(0, end + SETTLED, 9.9) == 1
    assert begin == 0 or run.received(0, begin, end) == 1


def burst_stream(module, **options):
    """Return what arrives in time for a second, then in bursts of five scans."""
    return module.stream(0, 1, **options) + [
        (when + (START - when) % (100 * MS), *rest)
        for when, *rest in module.stream(1, 6, **options)
    ]


def test_burst_of_five_fresh_scans_is_used_in_order():
    arrivals = [
        arrival
        for n in range(PATCHES)
        for module in [Module(n, serial=10 + n)]
        for arrival in burst_stream(module, phase=0.3 * n)
    ]
    run, times = assemble(arrivals, 6.2)
    assert all(run.received(n, SETTLED, 5.9) == 1 for n in range(PATCHES))
    assert run.counts["late"] <= 1


def test_patch_that_bursts_alone_delays_no_other():
    arrivals = burst_stream(Module(0)) + Module(1, serial=2).stream(0, 6, phase=0.4)
    run = AssemblerRun()
    ages = []
    for arrival in sorted(arrivals, key=lambda item: item[0]):
        before = len(run.scans)
        run.play([arrival], (arrival[0] - START) / SECOND)
        ages += [arrival[0] - scan.stamp for scan in run.scans[before:]]
    run.check()
    assert max(ages) <= 60 * MS
    assert run.received(1, SETTLED, 5.8) == 1
    # What came while its period was open is used, the rest is late.
    assert 0.3 < run.received(0, SETTLED, 5.8) < 0.5
    assert run.counts["late"] > 100


@pytest.mark.parametrize("hours", [0.05, 0.5, 1.2, 3.0])
def test_patch_is_received_after_any_silence(hours):
    module = Module(0)
    begin = 3600 * hours
    run = AssemblerRun().play(module.stream(0, 2), 2)
    # Scan numbers go on, by more than half of their span.
    module.scan += 40_000
    run.poll(START + round(begin * SECOND))
    run.play(module.stream(begin, begin + 2), begin + 2.2).check()
    assert run.received(0, begin + 0.5, begin + 1.9) == 1
    assert ("rebooted" in run.kinds()) == (hours > 0.1)


def test_process_that_slept_long_goes_on_with_the_present():
    run, _ = assemble(stream_all(0, 3), 3.0)
    given = len(run.scans)
    run.poll(START + 63 * SECOND)
    run.check()
    assert len(run.scans) - given <= 26
    assert run.assembler.counters()["skipped"] > 2900
    assert run.scans[-1].stamp > START + 62 * SECOND


def test_process_that_slept_shortly_loses_nothing():
    arrivals = sorted(stream_all(0, 4), key=lambda item: item[0])
    asleep = START + 2 * SECOND
    awake = START + 2400 * MS
    run = AssemblerRun().play([a for a in arrivals if a[0] <= asleep], 2.0)
    for arrived, port, packet in arrivals:
        if asleep < arrived <= awake:
            run.push_packet(packet, awake, port)
    run.play([a for a in arrivals if a[0] > awake], 4.2).check()
    assert all(run.received(n, SETTLED, 3.9) == 1 for n in range(PATCHES))
    assert run.assembler.counters()["skipped"] == 0


def test_skews_between_patches_are_measured():
    arrivals = Module(0).stream(0, 5) + Module(1, serial=2).stream(0, 5, phase=0.4)
    skews = assemble(arrivals, 5.2)[0].assembler.skews()
    assert skews["p1"] - skews["p0"] == pytest.approx(0.008, abs=0.0005)
    assert "p2" not in skews


def test_status_of_a_patch_reports_the_scans_that_it_skipped():
    statuses = [
        (START + (n + 1) * SECOND // 2, "a", Status(0, 0, 0, skipped, 0, 0))
        for n, skipped in enumerate([5, 5, 9, 0, 2])
    ]
    absent = START + SECOND, "a", Status(7, 0, 0, 0, 0, 0)
    run, _ = assemble([*Module(0).stream(0, 64), *statuses, absent], 64.2)
    assert (run.counts["status"], run.counts["foreign"]) == (5, 1)
    # What it skipped before its first status is not of this stream.
    lost = run.find_events("lost")
    assert [event.text.split()[0] for event in lost] == ["4", "2"]
    assert {event.patch for event in lost} == {"p0"}


def test_taxels_of_patches_may_lie_mixed_in_the_skin():
    skin = build_grid_skin(2, 3, PATCHES)
    mixed = replace(skin, patch_index=np.tile(np.arange(PATCHES), TAXELS))
    run = AssemblerRun(mixed).play(stream_all(0, 1), 1.0)
    scan = next(scan for scan in reversed(run.scans) if scan.received.all())
    for n in range(PATCHES):
        counts = scan.counts[mixed.patch_index == n]
        tick = int(counts[0] + (counts[1] << 16))
        np.testing.assert_array_equal(counts, make_counts(START + tick * MS // 10, n))


def test_a_thousand_scans_a_second_are_all_used():
    run, _ = assemble(stream_all(0, 0.5, rate=1000), 0.6, rate=1000)
    assert all(run.received(n, SETTLED, 0.45) == 1 for n in range(PATCHES))


@pytest.mark.parametrize(
    ("port", "used"), [("key:0000000000000001", False), ("a", True)]
)
def test_module_with_a_key_needs_echoes(port, used):
    run = AssemblerRun().play(Module().stream(0.0, 3.0, port=port), until=3.0)
    assert any(scan.received.any() for scan in run.scans) == used
    assert any(event.kind == "late" for event in run.events) != used
