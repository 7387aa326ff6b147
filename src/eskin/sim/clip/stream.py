"""A stream: one touch after the other, with pauses, sometimes two at once.

What follows what is the kind of the stream: all that people do, `ACCIDENTS` alone, or
nothing at all, `QUIET`.
"""

from eskin.recording import NONE
from eskin.sim.clip.plan import ACCIDENTS, QUIET
from eskin.sim.clip.second import ALONE, are_apart
from eskin.sim.clip.stage import Stage, act_out, company_of, draw_kind, person_of, put
from eskin.sim.clip.timing import contact_steps
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.people.person import Person
from eskin.sim.site.touching import self_contact_sites


def draw_stream(stage: Stage) -> tuple[TrueTouch, ...]:
    """All touches of a stream, by their onset."""
    if stage.plan.kind == QUIET:
        return ()
    constants, rng = stage.world.constants, stage.rng
    step = constants.value("time.step")
    person = person_of(stage.plan.person, stage.world)
    found: list[TrueTouch] = []
    at = stage.lead + pause_of(stage)
    while True:
        touch = next_touch(stage, person, at)
        _, end = contact_steps(touch)
        if end >= len(stage.q) - round(constants.value("stream.quiet") / step):
            return tuple(found)
        found.append(touch)
        if rng.random() < constants.value("stream.together"):
            other = next_touch(stage, company_of(stage), at + offset_of(stage, at, end))
            if fits(stage, touch, other, at):
                found.append(other)
                end = max(end, contact_steps(other)[1])
        at = end + pause_of(stage)


def next_touch(stage: Stage, person: Person, at: int) -> TrueTouch:
    """A touch whose contact begins at a step."""
    at = min(at, len(stage.q) - 1)
    if stage.plan.kind == ACCIDENTS:
        gesture, kind = NONE, draw_accident(stage, at)
    else:
        gesture, kind = draw_gesture(stage, person)
    touch = act_out(stage, person, gesture, kind, at)
    return put(stage, touch, at - contact_steps(touch)[0])


def draw_gesture(stage: Stage, person: Person) -> tuple[str, str]:
    """Something that people do, and the way they do it."""
    gesture = stage.world.constants.choose("stream.gestures", stage.rng)
    kind = draw_kind(stage, person, gesture)
    while kind in ALONE:
        kind = draw_kind(stage, person, gesture)
    return gesture, kind


def draw_accident(stage: Stage, at: int) -> str:
    """A contact that nobody means; of links, where they all but touch at a step."""
    world = stage.world
    touching = bool(self_contact_sites(world, stage.q[at]))
    kind = world.constants.choose("stream.accidents", stage.rng)
    while kind == "self_contact" and not touching:
        kind = world.constants.choose("stream.accidents", stage.rng)
    return kind


def pause_of(stage: Stage) -> int:
    """Steps without contact until the next touch."""
    seconds = stage.world.constants.draw("stream.pause", stage.rng)
    return round(seconds / stage.world.constants.value("time.step"))


def offset_of(stage: Stage, start: int, end: int) -> int:
    """How much later than the first a second touch begins: while the first lasts."""
    return int(stage.rng.integers(0, max(1, end - start)))


def fits(stage: Stage, first: TrueTouch, other: TrueTouch, at: int) -> bool:
    """Whether a second touch is apart from the first and over before the stream is."""
    quiet = stage.world.constants.value("stream.quiet")
    last = len(stage.q) - round(quiet / stage.world.constants.value("time.step"))
    over = contact_steps(other)[1] < last
    return over and are_apart(stage.world, stage.q[at], first, other)
