"""Merging: patches of two links that meet, and the same counts where they are apart."""

from dataclasses import replace

import numpy as np

from eskin.sim.clip.plan import ClipPlan
from eskin.sim.clip.scene import Scene
from eskin.sim.clip.stage import person_of
from eskin.sim.clip.timing import moved
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.contact import feel
from eskin.sim.contact.press import Press
from eskin.sim.pairs.meeting import Pose, Sites, draw_meeting
from eskin.sim.pairs.sides import INSTEAD
from eskin.sim.pairs.twins import Twins, onset_of, steps_of, still
from eskin.sim.people.hand import HEADS, HEEL, PARTS, mirrored, part_of
from eskin.sim.people.person import Person
from eskin.sim.people.programs import perform
from eskin.sim.robot.world import World
from eskin.sim.site.fold import fold
from eskin.sim.site.site import Site


def draw_merging(plan: ClipPlan, world: World, rng: np.random.Generator) -> Twins:
    """One gesture on two patches that meet, and two touches of them far apart.

    Raises:
        ValueError: no poses or no touch were found.
    """
    person = person_of(plan.person, world)
    _, steps = steps_of(plan, world)
    folded, apart, touches = draw_touched(plan, world, person, rng)
    return Twins(
        Scene(still(folded, steps), touches),
        Scene(still(apart, steps), tuple(split(touches))),
        world.mounted,
        world.charts,
    )


def draw_touched(
    plan: ClipPlan, world: World, person: Person, rng: np.random.Generator
) -> tuple[Pose, Pose, tuple[TrueTouch, ...]]:
    """Both poses and the gesture, which is felt on either patch."""
    for _ in range(int(world.constants.value("pairs.tries"))):
        groups = frozenset(plan.groups)
        folded, apart, sites = draw_meeting(world, groups, person, rng)
        if plan.kind == "idle":
            return folded, apart, ()
        touch = draw_touch(plan, world, person, sites, rng)
        if touch is not None:
            touch = moved(touch, onset_of(touch, plan, world, rng))
            return folded, apart, (touch,)
    raise ValueError("no touch came out that is felt on two patches; lower pairs.felt")


def split(touches: tuple[TrueTouch, ...]) -> list[TrueTouch]:
    """Each press of a gesture as a touch of its own, which is none."""
    return [
        replace(touch, gesture="none", kind=INSTEAD[touch.gesture], presses=(press,))
        for touch in touches
        for press in touch.presses
    ]


def draw_touch(
    plan: ClipPlan,
    world: World,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """One gesture that is done on two patches, a part of it felt on each.

    None where it hardly comes out so, as on a narrow patch or by a light hand.
    """
    assert plan.pair is not None
    draw = pat_both if plan.pair.gesture == "double_pat" else hook
    least = world.constants.value("pairs.felt")
    for _ in range(int(world.constants.value("pairs.touches"))):
        touch = draw(plan, world, person, sites, rng)
        if touch is not None and min(peaks_of(touch, world)) >= least:
            return touch
    return None


def peaks_of(touch: TrueTouch, world: World) -> list[float]:
    """Largest pressure of each press of a touch [kPa]."""
    return [
        float(feel(p, world.charts[p.chart], world.constants).pressure.max(initial=0.0))
        for p in touch.presses
    ]


def pat_both(
    plan: ClipPlan,
    world: World,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """A double pat whose second pat is on the other patch, by the palm again.

    None where the pats as drawn are too soon or too late after each other for it.
    """
    low, high = world.constants.array("pairs.interval")
    touch = perform(
        *("double_pat", None, person, sites[0], world.constants, rng),
        *(plan.difficulty, plan.regime),
    )
    if touch.drawn["stays"] or not low <= float(touch.drawn["interval"]) <= high:
        return None
    return replace(touch, presses=parted(touch.presses[0], *sites))


def parted(press: Press, first: Site, second: Site) -> tuple[Press, Press]:
    """The first pat where it was and the second at another site."""
    pressed = np.flatnonzero(press.force > 0)
    last = pressed[np.argmax(np.diff(pressed))]
    cut = int(last) + 1
    earlier, later = part(press, slice(0, cut)), part(press, slice(cut, None))
    onward = replace(
        later,
        chart=second.chart,
        first=press.first + cut,
        centre=later.centre - np.array(first.centre) + np.array(second.centre),
        angle=later.angle - first.angle + second.angle,
    )
    return earlier, onward


def part(press: Press, steps: slice) -> Press:
    """Some steps of a press."""
    series = press.force[steps], press.centre[steps], press.angle[steps]
    force, centre, angle = series
    return replace(press, force=force, centre=centre, angle=angle)


def hook(
    plan: ClipPlan,
    world: World,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch:
    """A hand hooked between two patches: fingers on one, its back on the other.

    They press against each other, so either bears the same.
    """
    touch = perform(
        *("grab", "full_hand", person, sites[0], world.constants, rng),
        *(plan.difficulty, plan.regime),
    )
    (press,) = touch.presses
    stiff = replace(touch, presses=(replace(press, flesh=person.flesh),))
    fingers, back = fold(stiff, *sites, 1 / 2).presses
    hand, behind = press.stamps, mirrored(press.stamps)
    fingers = replace(fingers, stamps=part_of(hand, PARTS[:12]))
    back = replace(back, stamps=part_of(behind, HEADS + HEEL))
    return replace(touch, kind="hook", presses=(fingers, back))
