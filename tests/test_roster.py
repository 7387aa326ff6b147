from dataclasses import replace

import pytest

from eskin.drivers import EventLog
from eskin.drivers.module_registry import HOLD_TIME, ModuleRegistry
from eskin.errors import SkinError
from helpers.modules import SKIN, TAXELS, Module
from helpers.touch import SECOND, START

FIRST, OTHER = Module(serial=1), Module(serial=2)


class Desk:
    """A roster, and the time."""

    def __init__(self):
        self.log = EventLog()
        self.registry = ModuleRegistry(SKIN, self.log)
        self.slot = self.registry.slots[0]

    def greet(self, module, seconds, port="a"):
        now = START + round(seconds * SECOND)
        return self.registry.handle_hello(module.hello(now), now, port)

    def poll(self, seconds):
        return self.registry.poll(START + round(seconds * SECOND))

    def use(self, begin, end, step=0.02):
        """Data of the holder is heard and used."""
        while begin < end:
            now = START + round(begin * SECOND)
            self.slot.note_data(now)
            self.slot.note_used(now)
            self.registry.poll(now)
            begin += step

    def kinds(self):
        return [event.kind for event in self.log.take()]


def test_a_module_that_fits_is_believed_at_its_port():
    desk = Desk()
    assert desk.greet(FIRST, 0.0) is desk.slot
    assert desk.slot.port == "a" and desk.kinds() == ["appeared"]


@pytest.mark.parametrize("wrong", [{"shape": (3, 2)}, {"taxels": TAXELS - 1}])
def test_a_misfit_is_said_and_never_believed(wrong):
    desk = Desk()
    for second in range(5):
        desk.greet(Module(**wrong), second)
    assert desk.slot.port is None and desk.kinds() == ["misfit"]


def test_a_module_whose_next_hello_does_not_fit_counts_no_more_until_one_does():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.greet(Module(shape=(9, 9)), 1.0)
    assert desk.slot.port is None
    desk.greet(Module(shape=(9, 9)), 2.0)
    desk.greet(FIRST, 3.0)
    assert desk.slot.port == "a"
    assert desk.kinds() == ["appeared", "misfit", "returned"]


def test_an_unknown_address_is_said_once():
    desk = Desk()
    for second in range(5):
        assert desk.greet(Module(address=77), second) is None
    (event,) = desk.log.take()
    assert event.kind == "misfit" and "77" in event.text and "0, 1, 2" in event.text


def test_a_flood_of_unknown_addresses_is_said_only_so_often():
    desk = Desk()
    for address in range(1000, 2000):
        desk.greet(Module(address=address), 0.0)
    assert len(desk.log.take()) == 64


def test_a_patch_that_is_silent_and_returns_is_said_once_each():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 1.0)
    for tenth in range(10, 30):
        desk.poll(tenth / 10)
    desk.use(3.0, 4.0)
    assert desk.kinds() == ["appeared", "silent", "returned"]


def test_a_replaced_module_is_held_back_until_it_is_tared_anew():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    assert desk.greet(OTHER, 4.0) is desk.slot
    assert desk.slot.hold_until == desk.slot.used_at + HOLD_TIME
    assert desk.kinds() == ["appeared", "replaced"]


def test_the_module_that_was_there_before_goes_on_at_once_when_it_is_put_back():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    desk.greet(OTHER, 4.0)
    desk.greet(FIRST, 6.0)
    assert desk.slot.hold_until == 0


def test_a_module_that_was_never_used_leaves_nothing_to_tare():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.greet(OTHER, 2.0)
    assert desk.slot.hold_until == 0


def test_a_module_plugged_in_elsewhere_is_believed_there():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    assert desk.greet(FIRST, 4.0, port="b") is None
    assert desk.slot.port == "b" and desk.slot.hold_until == 0
    assert desk.kinds() == ["appeared", "moved"]


def test_of_two_modules_with_one_address_neither_is_believed():
    desk = Desk()
    for second in range(10):
        desk.greet(FIRST, second)
        if second < 2:
            desk.use(second, second + 1)
        else:
            desk.greet(OTHER, second + 0.3)
            assert desk.slot.port is None
    assert desk.kinds() == ["appeared", "conflict"]


def test_after_a_conflict_the_one_that_is_left_is_believed_when_it_was_long_alone():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    for second in (2, 3, 4):
        desk.greet(OTHER, second)
        desk.greet(FIRST, second + 0.5)
    for second in (5, 6, 7):
        desk.greet(OTHER, second)
        desk.poll(second + 0.1)
    assert desk.slot.port is None
    assert desk.poll(7.6) == [desk.slot]
    assert desk.slot.port == "a" and desk.slot.module.serial_number == 2
    assert desk.slot.hold_until == desk.slot.used_at + HOLD_TIME
    assert desk.kinds() == ["appeared", "conflict", "replaced"]


def test_the_first_goes_on_without_a_tare_when_the_second_is_unplugged():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    desk.greet(OTHER, 2.0)
    for second in (3, 4, 5):
        desk.greet(FIRST, second)
    assert desk.poll(5.1) == []
    assert desk.slot.port == "a" and desk.slot.hold_until == 0
    assert desk.kinds() == ["appeared", "conflict", "returned"]


def test_a_hello_that_ends_a_conflict_tells_that_another_module_is_there():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 1.0)
    for second in (1, 2, 3):
        desk.greet(OTHER, second)
    assert desk.greet(OTHER, 4.3) is desk.slot
    assert desk.slot.port == "a" and desk.slot.module.serial_number == 2


def test_one_module_heard_at_two_ports_at_once_is_a_conflict():
    desk = Desk()
    desk.greet(FIRST, 0.0)
    desk.use(0.0, 2.0)
    desk.greet(FIRST, 2.0, port="b")
    for tenth in range(20, 60):
        now = START + tenth * SECOND // 10
        desk.slot.note_rejected_data(now, "a")
        desk.slot.note_rejected_data(now, "b")
        desk.poll(tenth / 10)
        assert desk.slot.port is None
    assert desk.kinds() == ["appeared", "conflict"]


def test_hellos_of_ever_new_modules_cost_bounded_memory():
    desk = Desk()
    for serial in range(1000):
        desk.greet(Module(serial=serial), serial / 1000)
    assert len(desk.slot.claims) <= 8 and desk.slot.port is None


def test_two_patches_at_one_address_are_no_skin():
    patches = (SKIN.patches[0], replace(SKIN.patches[1], address=0), SKIN.patches[2])
    with pytest.raises(SkinError, match="one address a patch"):
        ModuleRegistry(replace(SKIN, patches=patches), EventLog())


def test_trouble_that_goes_on_is_said_every_ten_seconds_with_its_count():
    log = EventLog()
    for second in range(25):
        log.count("lost", "scans did not arrive", 3)
        log.flush_counts(START + second * SECOND)
    texts = [event.text for event in log.take()]
    expected = ["3", "30", "30"]
    assert texts == [f"{count} scans did not arrive" for count in expected]


def test_events_that_nobody_takes_cost_bounded_memory():
    log = EventLog()
    for n in range(5000):
        log.add(START + n, "moved", "it moved")
        log.count("damaged", f"packets at port {n}")
    assert len(log.take()) == 1000 and len(log.repeated) == 256
