"""This module makes pairs of clips whose counts are equal while their labels differ.

Only where the taxels are tells the two clips apart: bending and temporary merging, as
in Fig. 7 of arXiv 2506.18256.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.constants import MM
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.dataset.clip import SimulatedClip, get_build, get_session, simulate_clip
from eskin.sim.dataset.plan import (
    NONE_KINDS,
    PAIR_SIDES,
    SIDE_SKINS,
    ClipPlan,
    PairKind,
    parse_pair_kind,
)
from eskin.sim.dataset.session_plan import plan_single_pair
from eskin.sim.dataset.staging import count_clip_steps, draw_start, get_person
from eskin.sim.people.hand import HAND_PADS, HEADS, HEEL, mirror_pads, select_pads
from eskin.sim.people.perform import perform
from eskin.sim.people.person import Person
from eskin.sim.scene.environment import (
    SimEnvironment,
    load_environment,
    mount_preset,
)
from eskin.sim.scene.folds import (
    compute_facing_gaps,
    compute_site_gap,
    find_fold_sites,
    press_both_sites,
    sample_patches,
    transform_points,
)
from eskin.sim.scene.poses import build_pose_pool, compute_pose_group, draw_pose
from eskin.sim.scene.scene import (
    TouchScene,
    compute_touch_presses,
    compute_true_series,
    find_contact_steps,
    shift_touch,
)
from eskin.sim.scene.validity import are_poses_valid, compute_joint_limits
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class PairScenes:
    """Pair scenes are two scenes that press the same taxels alike."""

    first: TouchScene
    """Scene with the gesture."""
    second: TouchScene
    """Scene whose touches are none."""
    mounted: MountedSkin
    """Skin of the second scene on its robot."""
    charts: tuple[Chart, ...]
    """Charts of that skin, unrolled as those of the first scene are."""


def draw_onset(
    touch: TrueTouch, plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> int:
    """Draw the step of the scene at which a touch's clock starts.

    All of the touch is in the clip; one that is longer is cut as in other clips.
    """
    lead, steps = count_clip_steps(plan, env)
    first, end = find_contact_steps(touch)
    free = steps - lead - (end - first)
    if free <= 0:
        return lead + draw_start(touch, steps - lead, env.constants, rng)
    return lead - first + int(rng.integers(0, free + 1))


ELBOW = "elbow_joint"

Sites = tuple[ContactSite, ContactSite]
Pose = Float[np.ndarray, "joint"]


def draw_meeting_poses(
    env: SimEnvironment,
    groups: frozenset[int],
    person: Person,
    rng: np.random.Generator,
) -> tuple[Pose, Pose, Sites]:
    """Draw a pose in which two sites meet, one with them far apart, and the sites.

    Args:
        env: robot in its skin.
        groups: pose groups of the second pose.
        person: person who touches.
        rng: random generator.

    Raises:
        ValueError: no such poses were found.
    """
    value = env.constants.value
    near, far = value("pairs.near") * MM, value("pairs.far") * MM
    poses = find_meeting_poses(env)
    tries = int(value("pairs.tries")) if len(poses) else 0
    for _ in range(tries):
        folded = poses[rng.integers(len(poses))].copy()
        folded[0] = rng.uniform(*(each[0] for each in compute_joint_limits(env)))
        apart = draw_pose(env, groups, rng)
        found = [
            sites
            for sites in find_fold_sites(env, folded, person)
            if compute_site_gap(env, folded, *sites) <= near
            and compute_site_gap(env, apart, *sites) >= far
        ]
        if found:
            return folded, apart, found[rng.integers(len(found))]
    raise ValueError(
        f"no poses found that bring patches of robot '{env.mounted.robot.name}' "
        f"within {near} m of each other and {far} m apart; take a skin on a longer arm"
    )


@lru_cache(maxsize=2)
def find_meeting_poses(env: SimEnvironment) -> Float[np.ndarray, "pose joint"]:
    """Find poses with the elbow bent as far as it goes, in which such patches meet.

    They are always the same. Other poses are hardly ever bent so far.
    """
    value, elbow = env.constants.value, env.joint_index(ELBOW)
    rng = np.random.default_rng(int(value("robot.pool_seed")))
    low, high = compute_joint_limits(env)
    count = int(value("pairs.pool"))
    q = rng.uniform(low, high, (count, len(low)))
    bent = np.deg2rad(env.constants.array("pairs.elbow"))
    q[:, elbow] = rng.uniform(bent[0], bent[1], count) * rng.choice([-1, 1], count)
    q = q[are_poses_valid(env, q)]
    gaps, _ = compute_facing_gaps(env, env.poses(q))
    gaps = gaps[:, find_separable_pairs(env)]
    return q[gaps.min(axis=1, initial=np.inf) <= value("pairs.near") * MM]


def find_separable_pairs(env: SimEnvironment) -> Bool[np.ndarray, "pair"]:
    """Tell which pairs of charts are far apart in some pose, middle from middle."""
    faces = sample_patches(env)
    charts = np.arange(len(env.charts))
    widest = np.zeros(len(faces.pairs))
    for q in np.concatenate(list(build_pose_pool(env).any.values())):
        middles = transform_points(env, charts, faces.balls[:, :3], env.poses(q))
        one, other = middles[faces.pairs[:, 0]], middles[faces.pairs[:, 1]]
        widest = np.maximum(widest, np.linalg.norm(one - other, axis=1))
    return widest >= env.constants.value("pairs.far") * MM


@lru_cache(maxsize=1)
def build_flat_side() -> tuple[MountedSkin, tuple[Chart, ...]]:
    """Build the patch laid flat, and its one chart."""
    mounted = mount_preset("flat")
    return mounted, build_charts(mounted)


def draw_bending(
    plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> PairScenes:
    """Draw a grab of the patch round the tube, and the same on it as it lies flat."""
    _, steps = count_clip_steps(plan, env)
    q = np.zeros((steps, 0))
    grabs = () if plan.kind == "idle" else (draw_bending_grab(plan, env, rng),)
    presses = tuple(
        replace(touch, gesture="none", kind=NONE_KINDS["grab"]) for touch in grabs
    )
    return PairScenes(TouchScene(q, grabs), TouchScene(q, presses), *build_flat_side())


def draw_bending_grab(
    plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> TrueTouch:
    """Draw a grab somewhere on the patch."""
    touch = perform(
        "grab",
        None,
        get_person(plan.person, env),
        draw_bending_site(env, rng),
        env.constants,
        rng,
        plan.difficulty,
        plan.regime,
    )
    return shift_touch(touch, draw_onset(touch, plan, env, rng))


def draw_bending_site(env: SimEnvironment, rng: np.random.Generator) -> ContactSite:
    """Draw a site near the patch's middle, the hand round the tube either way."""
    chart = env.charts[0]
    off = env.constants.value("pairs.off") * MM
    s, t = rng.uniform(-off, off, 2)
    low, high = chart.unrolled[:, 1].min() - t, chart.unrolled[:, 1].max() - t
    angle = rng.choice([-1.0, 1.0]) * np.pi / 2
    return ContactSite(0, (s, t), chart.radius, (float(low), float(high)), float(angle))


def draw_merging(
    plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> PairScenes:
    """Draw one gesture on two patches that meet, and two touches of them far apart.

    Raises:
        ValueError: no poses or no touch were found.
    """
    person = get_person(plan.person, env)
    _, steps = count_clip_steps(plan, env)
    folded, apart, touches = draw_merging_touch(plan, env, person, rng)
    return PairScenes(
        TouchScene(np.tile(folded, (steps, 1)), touches),
        TouchScene(np.tile(apart, (steps, 1)), tuple(split_presses(touches))),
        env.mounted,
        env.charts,
    )


def draw_merging_touch(
    plan: ClipPlan, env: SimEnvironment, person: Person, rng: np.random.Generator
) -> tuple[Pose, Pose, tuple[TrueTouch, ...]]:
    """Draw both poses and the gesture, which presses both patches."""
    for _ in range(int(env.constants.value("pairs.tries"))):
        groups = frozenset(plan.groups)
        folded, apart, sites = draw_meeting_poses(env, groups, person, rng)
        if plan.kind == "idle":
            return folded, apart, ()
        touch = draw_shared_touch(plan, env, person, sites, rng)
        if touch is not None:
            touch = shift_touch(touch, draw_onset(touch, plan, env, rng))
            return folded, apart, (touch,)
    raise ValueError("no touch came out that is felt on two patches; lower pairs.felt")


def split_presses(touches: tuple[TrueTouch, ...]) -> list[TrueTouch]:
    """Split a gesture into one touch for each press, which is none."""
    return [
        replace(touch, gesture="none", kind=NONE_KINDS[touch.gesture], presses=(press,))
        for touch in touches
        for press in touch.presses
    ]


def draw_shared_touch(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """Draw one gesture on two patches, a part of it on each.

    It is None where a part is too weak, as on a narrow patch or by a light hand.
    """
    assert plan.pair is not None
    draw = draw_shared_pat if plan.pair.gesture == "double_pat" else draw_hook
    least = env.constants.value("pairs.felt")
    for _ in range(int(env.constants.value("pairs.touches"))):
        touch = draw(plan, env, person, sites, rng)
        if touch is not None and min(compute_peak_pressures(touch, env)) >= least:
            return touch
    return None


def compute_peak_pressures(touch: TrueTouch, env: SimEnvironment) -> list[float]:
    """Return the largest pressure of each press of a touch [kPa]."""
    return [
        float(
            compute_pressure_field(p, env.charts[p.chart], env.constants).pressure.max(
                initial=0.0
            )
        )
        for p in touch.presses
    ]


def draw_shared_pat(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """Draw a double pat whose second pat is on the other patch, by the palm again.

    It is None where the pats as drawn are too close or too far in time.
    """
    low, high = env.constants.array("pairs.interval")
    touch = perform(
        "double_pat",
        None,
        person,
        sites[0],
        env.constants,
        rng,
        plan.difficulty,
        plan.regime,
    )
    if touch.drawn["stays"] or not low <= float(touch.drawn["interval"]) <= high:
        return None
    return replace(touch, presses=split_pats(touch.presses[0], *sites))


def split_pats(
    press: Press, first: ContactSite, second: ContactSite
) -> tuple[Press, Press]:
    """Leave the first pat where it was and move the second to another site."""
    pressed = np.flatnonzero(press.force > 0)
    last = pressed[np.argmax(np.diff(pressed))]
    cut = int(last) + 1
    earlier, later = (
        slice_press(press, slice(0, cut)),
        slice_press(press, slice(cut, None)),
    )
    onward = replace(
        later,
        chart=second.chart,
        first=press.first + cut,
        centre=later.centre - np.array(first.centre) + np.array(second.centre),
        angle=later.angle - first.angle + second.angle,
    )
    return earlier, onward


def slice_press(press: Press, steps: slice) -> Press:
    """Return some steps of a press."""
    series = press.force[steps], press.centre[steps], press.angle[steps]
    force, centre, angle = series
    return replace(press, force=force, centre=centre, angle=angle)


def draw_hook(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch:
    """Draw a hand hooked between two patches: fingers on one, its back on the other.

    They press against each other, so either bears the same.
    """
    touch = perform(
        "grab",
        "full_hand",
        person,
        sites[0],
        env.constants,
        rng,
        plan.difficulty,
        plan.regime,
    )
    (press,) = touch.presses
    stiff = replace(touch, presses=(replace(press, tissue=person.tissue),))
    fingers, back = press_both_sites(stiff, *sites, 1 / 2).presses
    hand, behind = press.pads, mirror_pads(press.pads)
    fingers = replace(fingers, pads=select_pads(hand, HAND_PADS[:12]))
    back = replace(back, pads=select_pads(behind, HEADS + HEEL))
    return replace(touch, kind="hook", presses=(fingers, back))


PAIR_DRAWS = {"bending": draw_bending, "merging": draw_merging}


@dataclass(frozen=True, eq=False)
class ClipPair:
    """A clip pair is two clips of the same counts; only one shows a gesture."""

    kind: PairKind
    """Difference between them: the shape of the skin, or the pose of the robot."""
    first: SimulatedClip
    """Clip with the gesture."""
    second: SimulatedClip
    """Clip whose touches are none."""
    labels: tuple[str, str]
    """Labels of the two clips."""
    mounted: tuple[MountedSkin, MountedSkin]
    """Skins of the two clips on their robots."""


def make_pair(
    kind: str,
    seed: int,
    difficulty: float | None = None,
    env: SimEnvironment | None = None,
) -> ClipPair:
    """Make a pair alone, its person and sensor drawn from the same seed.

    Args:
        kind: `bending` or `merging`.
        seed: seed of all that is drawn.
        difficulty: difficulty of touches; the published one unless given.
        env: environment of the first clip; the patch round a tube or the UR5 unless
            given.

    Raises:
        ValueError: there is no such kind, or patches never meet in the environment.
    """
    chosen = parse_pair_kind(kind)
    env = env or load_environment(SIDE_SKINS.get(PAIR_SIDES[chosen][0], "ur5"))
    published = env.constants.value("sets.difficulty")
    level = published if difficulty is None else difficulty
    return simulate_pair(plan_single_pair(chosen, seed, level, env.constants), env)


def simulate_pair(plan: ClipPlan, env: SimEnvironment) -> ClipPair:
    """Simulate both clips of the pair that a plan belongs to.

    Args:
        plan: plan of either clip.
        env: environment of the first clip.
    """
    assert plan.pair is not None
    rng, kind = plan.rng(), plan.pair.kind
    twins = PAIR_DRAWS[kind](plan, env, rng)
    lead, _ = count_clip_steps(plan, env)
    build = get_build(plan.build, env)
    session = get_session(plan.session, build)
    played = simulate_clip(twins.first, lead, build, session, env, rng)
    first = describe_clip(played, twins.first, plan, env, lead)
    second = describe_clip(
        build_second_clip(played, twins, env, lead), twins.second, plan, env, lead
    )
    mounted = env.mounted, twins.mounted
    return ClipPair(kind, first, second, (plan.pair.gesture, "none"), mounted)


def make_pair_clip(plan: ClipPlan, env: SimEnvironment) -> SimulatedClip:
    """Make the clip of a plan that is of a pair."""
    pair = simulate_pair(plan, env)
    assert plan.pair is not None
    return pair.second if plan.pair.is_second else pair.first


def build_second_clip(
    first: SimulatedClip, twins: PairScenes, env: SimEnvironment, lead: int
) -> SimulatedClip:
    """Build a clip of the same counts with the truth of the second scene."""
    scene = twins.second
    touch_presses = compute_touch_presses(scene, env)
    truths = compute_true_series(
        scene, touch_presses, twins.charts, twins.mounted, lead, env
    )
    readings = len(first.counts)
    every = (len(scene.q) - lead) // readings
    return replace(first, q=scene.q[lead::every][:readings], truths=truths)


def describe_clip(
    clip: SimulatedClip,
    scene: TouchScene,
    plan: ClipPlan,
    env: SimEnvironment,
    lead: int,
) -> SimulatedClip:
    """Return a clip with its pose group and all that was drawn for it."""
    assert plan.pair is not None
    start = scene.q[lead]
    joints = env.mounted.robot.joint_names
    names = [f"q.{joint}" for joint in joints]
    drawn: dict[str, float | str] = {"pair": float(plan.pair.number)}
    drawn |= dict(zip(names, start.tolist(), strict=True))
    for number, touch in enumerate(scene.touches):
        drawn[f"touch{number}.kind"] = touch.kind
        drawn |= {f"touch{number}.{name}": each for name, each in touch.drawn.items()}
    group = compute_pose_group(env, start) if joints else 0
    return replace(clip, pose_group=group, drawn=drawn)
