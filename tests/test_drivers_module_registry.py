"""Tests of which module has an address, and of the events that report it."""

import pytest

from eskin.drivers import EventLog
from helpers.modules import TAXELS, AssemblerRun, Module
from helpers.touch import SECOND, START

FIRST = Module(serial=1)
OTHER = Module(serial=2)
MISSHAPEN = Module(serial=1, shape=(9, 9))
TOO_SMALL = Module(taxels=TAXELS - 1)


def send_hellos(hellos, before=()):
    """Return a run to which modules send hellos from ports at some times [s]."""
    arrivals = [
        (START + round(seconds * SECOND), port, module.hello(START))
        for seconds, module, port in hellos
    ]
    return AssemblerRun().play([*before, *arrivals], hellos[-1][0] + 0.1)


@pytest.mark.parametrize(
    ("hellos", "kinds", "port", "serial"),
    [
        ([(4, FIRST, "b")], ["moved"], "b", 1),
        ([(4, OTHER, "a")], ["replaced"], "a", 2),
        ([(4, OTHER, "a"), (6, FIRST, "a")], ["replaced", "replaced"], "a", 1),
        ([(3, MISSHAPEN, "a"), (4, TOO_SMALL, "a")], ["misfit"], None, 1),
        ([(3, MISSHAPEN, "a"), (4, FIRST, "a")], ["misfit", "returned"], "a", 1),
        # Two modules that both send, until one of them is silent for three seconds.
        ([(2, OTHER, "a"), (2.5, FIRST, "a"), (4, OTHER, "a")], ["conflict"], None, 1),
        ([(2, FIRST, "b"), (2.5, FIRST, "a"), (4, FIRST, "b")], ["conflict"], None, 1),
        (
            [(2, OTHER, "a"), (3, FIRST, "a"), (4, FIRST, "a"), (5.1, FIRST, "a")],
            ["conflict", "returned"],
            "a",
            1,
        ),
        (
            [(2, OTHER, "a"), (2.5, FIRST, "a"), (4, OTHER, "a"), (5.6, OTHER, "a")],
            ["conflict", "replaced"],
            "a",
            2,
        ),
        ([(2, OTHER, "a"), (3, OTHER, "a"), (5, OTHER, "a")], ["replaced"], "a", 2),
    ],
)
def test_hellos_decide_which_module_has_an_address(hellos, kinds, port, serial):
    run = send_hellos(hellos, before=Module(serial=1).stream(0, 2))
    slot = run.assembler.registry.slots[0]
    assert run.kinds("silent") == ["appeared", *kinds]
    assert (slot.port, slot.module.serial_number) == (port, serial)


@pytest.mark.parametrize(
    ("ports", "held"),
    [
        (("udp://a:1", "udp://b:1"), True),
        (("/dev/a", "/dev/b"), False),
        (("/dev/a", "udp://b:1"), True),
    ],
)
def test_serial_number_at_another_network_address_is_held_like_another(ports, held):
    before = Module(serial=1).stream(0, 2, ports[0])
    after = Module(serial=1).stream(4, 15, ports[1])
    run = AssemblerRun().play(before + after, 15)
    # It was used until 2.0, and all that is held for 10.5 s is tared again.
    assert run.received(0, 4.5, 12.4) == (0.0 if held else pytest.approx(1.0, abs=0.02))
    assert run.received(0, 12.7, 14.5) == pytest.approx(1.0, abs=0.02)


def test_silence_and_return_are_reported_once_each():
    module = Module()
    run = AssemblerRun().play(module.stream(0, 2) + module.stream(4, 5), 5)
    assert run.kinds() == ["appeared", "silent", "returned"]


@pytest.mark.parametrize("module", [MISSHAPEN, TOO_SMALL])
def test_module_of_another_shape_is_reported_once_and_refused(module):
    run = send_hellos([(second, module, "a") for second in range(5)])
    assert run.kinds() == ["misfit"]
    assert run.assembler.registry.slots[0].port is None
    assert run.counts["foreign"] == 5


def test_unknown_addresses_are_reported_once_each_and_not_for_ever():
    run = send_hellos([(second, Module(address=77), "a") for second in range(3)])
    (event,) = run.events
    assert event.kind == "misfit" and "77" in event.text and "0, 1, 2" in event.text
    run = send_hellos([(0, Module(address=n), "a") for n in range(1000, 1100)])
    assert len(run.events) == 64


def test_claims_of_many_modules_are_bounded():
    run = send_hellos([(n / 1000, Module(serial=n), "a") for n in range(300)])
    slot = run.assembler.registry.slots[0]
    assert len(slot.claims) <= 8 and slot.port is None


def test_repeated_event_is_reported_once_a_minute_with_its_count():
    log = EventLog()
    for second in range(125):
        log.count("lost", "scan", "did not arrive", 3, detail=f"; the last: {second} s")
        log.flush_counts(START + second * SECOND)
    assert [event.text for event in log.take()] == [
        "3 scans did not arrive; the last: 0 s",
        "180 scans did not arrive; the last: 60 s",
        "180 scans did not arrive; the last: 120 s",
    ]
    log.flush_counts(START + 125 * SECOND, at_end=True)
    log.flush_counts(START + 126 * SECOND, at_end=True)
    assert [event.text for event in log.take()] == [
        "12 scans did not arrive; the last: 124 s"
    ]


def test_one_event_is_reported_in_the_singular():
    log = EventLog()
    log.count("lost", "scan", "did not arrive")
    log.flush_counts(START)
    assert [event.text for event in log.take()] == ["1 scan did not arrive"]


def test_events_that_nobody_takes_are_bounded():
    log = EventLog()
    for n in range(3000):
        log.log_event(START + n, "moved", "it moved")
        log.count("damaged", "packet", f"at port {n}")
    assert len(log.take()) == 1000 and len(log.repeated) == 256
