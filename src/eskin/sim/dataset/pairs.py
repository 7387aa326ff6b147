"""This module simulates pairs of clips with equal counts and different labels.

The clips of a pair differ only in the positions of the taxels: by bending of the skin,
or by temporary merging of patches, as in Fig. 3 of Jiang et al. 2025.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.constants import MM
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.dataset.clip import (
    SimulatedClip,
    collect_joint_values,
    collect_touch_values,
    get_build,
    get_session,
    simulate_clip,
)
from eskin.sim.dataset.plan import ClipPlan, plan_single_pair
from eskin.sim.dataset.sets import NONE_KINDS, PAIR_SIDES, SIDE_SKINS, PairKind
from eskin.sim.dataset.staging import (
    count_clip_steps,
    draw_start,
    get_person,
    perform_planned,
)
from eskin.sim.people.person import (
    HAND_PADS,
    HEADS,
    HEEL,
    Person,
    mirror_pads,
    select_pads,
)
from eskin.sim.scene.environment import SimEnvironment, load_environment
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
    find_reading_edges,
    shift_touch,
)
from eskin.sim.scene.validity import are_poses_valid, compute_joint_limits
from eskin.skin import MountedSkin, mount_skin


@dataclass(frozen=True, eq=False)
class PairScenes:
    """Pair scenes are two scenes with the same pressure on every taxel."""

    first: TouchScene
    """Scene with the gesture."""
    second: TouchScene
    """Scene whose touches are none."""
    mounted: MountedSkin
    """Skin of the second scene on its robot."""
    charts: tuple[Chart, ...]
    """Charts of that skin, with the same coordinates as in the first scene."""


def draw_onset(
    touch: TrueTouch, plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> int:
    """Draw the step of the scene at which a touch's clock starts.

    The whole touch is in the clip, unless it is longer than that.
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
    """Draw a pose in which two sites meet, a pose with them far apart, and the sites.

    `groups` are the pose groups of the second pose.

    Raises:
        ValueError: no such poses were found.
    """
    value = env.constants.value
    max_gap = value("pairs.near") * MM
    min_separation = value("pairs.far") * MM
    poses = find_meeting_poses(env)
    low, high = compute_joint_limits(env)
    for _ in range(int(value("pairs.tries")) if len(poses) else 0):
        folded = poses[rng.integers(len(poses))].copy()
        folded[0] = rng.uniform(low[0], high[0])
        apart = draw_pose(env, groups, rng)
        found = [
            sites
            for sites in find_fold_sites(env, folded, person)
            if compute_site_gap(env, folded, *sites) <= max_gap
            and compute_site_gap(env, apart, *sites) >= min_separation
        ]
        if found:
            return folded, apart, found[rng.integers(len(found))]
    raise ValueError(
        f"no poses found that bring patches of robot '{env.mounted.robot.name}' "
        f"within {max_gap} m of each other and {min_separation} m apart; take a skin "
        "on a longer arm"
    )


@lru_cache(maxsize=2)
def find_meeting_poses(env: SimEnvironment) -> Float[np.ndarray, "pose joint"]:
    """Find poses in which separable patches meet, with the elbow bent to its limit.

    They are always the same. Poses of the pool are rarely bent as far.
    """
    value = env.constants.value
    elbow = env.joint_index(ELBOW)
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
    """Tell which pairs of charts have their centres far apart in some pose."""
    samples = sample_patches(env)
    charts = np.arange(len(env.charts))
    widest = np.zeros(len(samples.pairs))
    for q in np.concatenate(list(build_pose_pool(env).any.values())):
        centres = transform_points(env, charts, samples.spheres[:, :3], env.poses(q))
        first = centres[samples.pairs[:, 0]]
        second = centres[samples.pairs[:, 1]]
        widest = np.maximum(widest, np.linalg.norm(first - second, axis=1))
    return widest >= env.constants.value("pairs.far") * MM


@lru_cache(maxsize=1)
def build_flat_skin() -> tuple[MountedSkin, tuple[Chart, ...]]:
    """Build the flat patch and its chart."""
    mounted = mount_skin("flat")
    return mounted, build_charts(mounted)


def draw_bending_scenes(
    plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> PairScenes:
    """Draw a grab of a patch round a tube, and the same presses on the flat patch."""
    _, steps = count_clip_steps(plan, env)
    q = np.zeros((steps, 0))
    grabs = ()
    if plan.kind != "idle":
        person = get_person(plan.person, env)
        site = draw_bending_site(env, rng)
        grab = perform_planned("grab", None, person, site, plan, env, rng)
        grabs = (shift_touch(grab, draw_onset(grab, plan, env, rng)),)
    presses = tuple(
        replace(grab, gesture="none", kind=NONE_KINDS["grab"]) for grab in grabs
    )
    return PairScenes(TouchScene(q, grabs), TouchScene(q, presses), *build_flat_skin())


def draw_bending_site(env: SimEnvironment, rng: np.random.Generator) -> ContactSite:
    """Draw a site near the centre of the patch, with the hand round the tube."""
    chart = env.charts[0]
    off = env.constants.value("pairs.off") * MM
    s, t = rng.uniform(-off, off, 2)
    low, high = chart.unrolled[:, 1].min() - t, chart.unrolled[:, 1].max() - t
    angle = rng.choice([-1.0, 1.0]) * np.pi / 2
    return ContactSite(0, (s, t), chart.radius, (float(low), float(high)), float(angle))


def draw_merging_scenes(
    plan: ClipPlan, env: SimEnvironment, rng: np.random.Generator
) -> PairScenes:
    """Draw a gesture on two patches that meet, and a touch on each of them far apart.

    Raises:
        ValueError: no poses or touch were found.
    """
    person = get_person(plan.person, env)
    groups = frozenset(plan.groups)
    _, steps = count_clip_steps(plan, env)
    for _ in range(int(env.constants.value("pairs.tries"))):
        folded, apart, sites = draw_meeting_poses(env, groups, person, rng)
        touches = ()
        if plan.kind != "idle":
            touch = draw_shared_touch(plan, env, person, sites, rng)
            if touch is None:
                continue
            touches = (shift_touch(touch, draw_onset(touch, plan, env, rng)),)
        singles = tuple(
            replace(each, gesture="none", kind=NONE_KINDS[each.gesture], presses=(one,))
            for each in touches
            for one in each.presses
        )
        return PairScenes(
            TouchScene(np.tile(folded, (steps, 1)), touches),
            TouchScene(np.tile(apart, (steps, 1)), singles),
            env.mounted,
            env.charts,
        )
    raise ValueError("no touch found that is felt on two patches; lower pairs.felt")


def draw_shared_touch(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """Draw one gesture with a part on each of two patches.

    It is None if a part is too weak, as on a narrow patch or by a light hand.
    """
    assert plan.pair is not None
    draw = draw_shared_pat if plan.pair.gesture == "double_pat" else draw_hook
    min_pressure = env.constants.value("pairs.felt")
    for _ in range(int(env.constants.value("pairs.touches"))):
        touch = draw(plan, env, person, sites, rng)
        fields = (
            compute_pressure_field(press, env.charts[press.chart], env.constants)
            for press in (touch.bodies if touch else ())
        )
        if touch and all(f.pressure.max(initial=0.0) >= min_pressure for f in fields):
            return touch
    return None


def draw_shared_pat(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch | None:
    """Draw a double pat whose second pat is on the other patch.

    It is None if the time between the pats is out of range, or the hand stays.
    """
    low, high = env.constants.array("pairs.interval")
    touch = perform_planned("double_pat", None, person, sites[0], plan, env, rng)
    if touch.drawn["stays"] or not low <= float(touch.drawn["interval"]) <= high:
        return None
    return replace(touch, presses=split_pats(touch.bodies[0], *sites))


def split_pats(
    press: Press, first: ContactSite, second: ContactSite
) -> tuple[Press, Press]:
    """Split the press of two pats, and move the second pat to another site."""
    pressed = np.flatnonzero(press.force > 0)
    cut = int(pressed[np.argmax(np.diff(pressed))]) + 1
    later = slice_press(press, slice(cut, None))
    moved = replace(
        later,
        chart=second.chart,
        first=press.first + cut,
        centre=later.centre - np.array(first.centre) + np.array(second.centre),
        angle=later.angle - first.angle + second.angle,
    )
    return slice_press(press, slice(0, cut)), moved


def slice_press(press: Press, steps: slice) -> Press:
    """Return some steps of a press, with its first step unchanged."""
    return replace(
        press,
        force=press.force[steps],
        centre=press.centre[steps],
        angle=press.angle[steps],
    )


def draw_hook(
    plan: ClipPlan,
    env: SimEnvironment,
    person: Person,
    sites: Sites,
    rng: np.random.Generator,
) -> TrueTouch:
    """Draw a hand hooked between two patches: fingers on one, its back on the other.

    The forces on the two patches are equal.
    """
    touch = perform_planned("grab", "full_hand", person, sites[0], plan, env, rng)
    (press,) = touch.bodies
    stiff = replace(touch, presses=(replace(press, tissue=person.tissue),))
    fingers, back = press_both_sites(stiff, *sites, 1 / 2).bodies
    fingers = replace(fingers, pads=select_pads(press.pads, HAND_PADS[:12]))
    back = replace(back, pads=select_pads(mirror_pads(press.pads), HEADS + HEEL))
    return replace(touch, kind="hook", presses=(fingers, back))


SCENE_DRAWS = {"bending": draw_bending_scenes, "merging": draw_merging_scenes}


@dataclass(frozen=True, eq=False)
class ClipPair:
    """A clip pair is two clips with the same counts, of which one shows a gesture."""

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
    """Simulate a single pair, with person and sensor drawn from the same seed.

    Args:
        kind: `bending` or `merging`.
        seed: seed of everything that is drawn.
        difficulty: difficulty of touches; the published one by default.
        env: environment of the first clip; by default the patch round a tube for
            `bending`, the UR5 for `merging`.

    Raises:
        ValueError: there is no such kind, or no patches can meet.
    """
    if kind not in PAIR_SIDES:
        raise ValueError(f"no pairs of '{kind}'; allowed are {', '.join(PAIR_SIDES)}")
    chosen = cast(PairKind, kind)
    env = env or load_environment(SIDE_SKINS.get(PAIR_SIDES[chosen][0], "ur5"))
    published = env.constants.value("sets.difficulty")
    level = published if difficulty is None else difficulty
    return simulate_pair(plan_single_pair(chosen, seed, level, env.constants), env)


def simulate_pair(plan: ClipPlan, env: SimEnvironment) -> ClipPair:
    """Simulate both clips of the pair that a plan belongs to.

    Fig. 3 of Jiang et al. 2025 shows a pair of either kind.

    The plan is of either clip, the environment that of the first one.
    """
    assert plan.pair is not None
    rng = plan.rng()
    kind = plan.pair.kind
    scenes = SCENE_DRAWS[kind](plan, env, rng)
    lead, _ = count_clip_steps(plan, env)
    build = get_build(plan.build, env)
    session = get_session(plan.session, build)
    clip = simulate_clip(scenes.first, lead, build, session, env, rng)
    first = describe_clip(clip, scenes.first, plan, env, lead)
    clip = build_second_clip(clip, scenes, env, lead)
    second = describe_clip(clip, scenes.second, plan, env, lead)
    mounted = env.mounted, scenes.mounted
    return ClipPair(kind, first, second, (plan.pair.gesture, "none"), mounted)


def build_second_clip(
    first: SimulatedClip, scenes: PairScenes, env: SimEnvironment, lead: int
) -> SimulatedClip:
    """Build a clip of the same counts with the ground truth of the second scene."""
    scene = scenes.second
    readings = len(first.counts)
    edges = find_reading_edges(lead, readings, (scene.steps - lead) / readings)
    truths = compute_true_series(
        scene,
        compute_touch_presses(scene, env),
        scenes.charts,
        scenes.mounted,
        lead,
        edges,
        env.constants.value("time.step"),
    )
    return replace(first, q=scene.q[edges[:-1]], truths=truths)


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
    joints = collect_joint_values(env, start)
    drawn = {"pair": float(plan.pair.number)} | joints
    return replace(
        clip,
        pose_group=compute_pose_group(env, start) if joints else 0,
        drawn=drawn | collect_touch_values(scene.touches),
    )
