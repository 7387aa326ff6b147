"""Clip sets define people, sensors, poses, gestures and sizes of data sets."""

from dataclasses import dataclass, replace
from typing import Literal

from eskin.sets.socialtouch import GROUPS
from eskin.sim.constants import Constants
from eskin.sim.people.recorded import RECORDED_CLASSES
from eskin.sim.sensor.build import BuildKind
from eskin.sim.sensor.flaws import FAMILIES

ACCIDENTS = "accidents"
QUIET = "quiet"
"""Kinds of streams: with accidental contacts only, and without any contact."""

PairKind = Literal["bending", "merging"]
Side = Literal["bent", "flat", "folded", "apart"]

PAIR_SIDES: dict[PairKind, tuple[Side, Side]] = {
    "bending": ("bent", "flat"),
    "merging": ("folded", "apart"),
}
"""Sides of each kind of pair: the first shows the gesture, the second shows `none`."""

SIDES: tuple[Side, ...] = ("bent", "flat", "folded", "apart")
"""All sides; each has a folder of its own."""

SIDE_SKINS: dict[str, str] = {"bent": "bent", "flat": "flat"}
"""Preset skins of the sides that have their own."""

SOURCE_SKINS = {"flat": "bent"}
"""Preset skin on which the counts of another are simulated."""

NONE_KINDS = {"grab": "press", "double_pat": "single_pat"}
"""Kind of `none` on the second side that has the counts of each gesture."""


def find_pair_kind(side: Side) -> PairKind:
    """Return the kind of pair that a side belongs to."""
    return "bending" if side in PAIR_SIDES["bending"] else "merging"


PAPER_GESTURES = ("poke", "double_pat", "grab", "stroke")
"""Gestures of Jiang et al. 2025 (Fig. 2)."""

CLASSES = (*PAPER_GESTURES, "none")
"""Gestures of the paper, and `none`."""


@dataclass(frozen=True)
class SetPart:
    """A set part is a number of clips of a set in one folder."""

    folder: str
    """Folder below the folder of the set; empty where the set has one part."""
    clips: int
    """Number of clips."""


@dataclass(frozen=True, kw_only=True)
class ClipSet:
    """A clip set defines the clips, or streams, of a data set."""

    name: str
    """Name of the set."""
    people: str
    """Role that its people are drawn for; sets with the same role share people."""
    subjects: int
    """Number of people."""
    names: tuple[str, ...] = ()
    """Names of the people; empty where they are numbered."""
    builds: str
    """Role that its builds are drawn for; sets with the same role share builds."""
    build_count: int
    """Number of builds."""
    build_kind: Literal["fresh", "shifted"]
    """Distribution that the builds are drawn from."""
    families: tuple[BuildKind, ...] = ()
    """Families of sensors, or other kinds, in turn, of which each session has a build
    of its own; empty where builds are of `build_kind` and sessions share them."""
    groups: tuple[int, ...]
    """Pose groups."""
    poses: int | None = None
    """Number of poses; None draws a new one for each clip."""
    stopped: float
    """Share of clips in which the robot stands still."""
    places: int | None = None
    """Number of places of the skin where each gesture is made; None draws a new one for
    each clip."""
    folded: float | None = None
    """Share of poses in which patches of two links face each other; None takes the
    usual share."""
    classes: tuple[str, ...]
    """Gestures, equally often; empty for streams, which have touches of many kinds."""
    parts: tuple[SetPart, ...]
    """Parts of the set."""
    stream: str | None = None
    """Kind of its streams; None for clips and for streams with gestures."""
    kinds: str | None = None
    """Constant with the weights of the kinds of its clips of `none`; None for the usual
    ones."""

    @property
    def clips(self) -> int:
        """Return the number of clips, or streams."""
        return sum(part.clips for part in self.parts)


PAPER_SETS = ("paper", "paper-5", "paper-places", "paper-person", "paper-folded")
"""Names of the sets as large as the paper's."""

SETS = (
    "train",
    "val",
    "test-s",
    "test-p",
    "test-x",
    "test-m",
    *PAPER_SETS,
    "streams",
    "streams-fresh",
    ACCIDENTS,
    QUIET,
)
"""Names of all sets that recognisers are trained and tested on."""

TRAIN_MOVING = "train-moving"
"""Name of the set of families in whose clips the robot always moves."""

FAMILY_SETS = {
    "train-families": "train",
    TRAIN_MOVING: "train",
    "val-families": "val",
    "streams-families": "streams",
    "accidents-families": ACCIDENTS,
    "quiet-families": QUIET,
    **{f"test-{family}": "test-p" for family in FAMILIES},
}
"""Sets of builds of families, each with the set that it is otherwise like. The tests of
all families have the same people."""

FINAL_SETS = {
    "final-fresh": "test-s",
    "final-poses": "test-p",
    "final-shifted": "test-x",
    "final-moving": "test-m",
    "final-streams-fresh": "streams-fresh",
    "final-streams": "streams",
    "final-streams-families": "streams-families",
    "final-accidents": ACCIDENTS,
    "final-quiet": "quiet-families",
    **{f"final-{family}": f"test-{family}" for family in FAMILIES},
}
"""Sets that weights are measured on once, when nothing is chosen any more, each with
the set that it is otherwise like. They have more people and builds, of their own."""

FINAL = "final"
"""Role that people and builds of the final sets are drawn for."""

PAIRS = "pairs"
"""Name of the set of pairs of clips with the same counts but not the same label."""


RECORDED = "recorded"
RECORDED_GROUPS = "recorded-groups"
"""Names of the sets of recorded people who touch a simulated skin."""

RECORDED_SETS = {RECORDED: RECORDED_CLASSES, RECORDED_GROUPS: tuple(GROUPS)}
"""Classes of these sets: some of the paper's, or the groups of SocialTouch."""

DEVICES = "devices"
"""Name of the set of small devices, drawn at random, that simulated or recorded people
touch."""

NON_GESTURES = "non-gestures"
"""Name of the set of many kinds of `none`, and of nothing else."""

ALL_SETS = (
    *SETS,
    *FAMILY_SETS,
    *FINAL_SETS,
    PAIRS,
    *RECORDED_SETS,
    DEVICES,
    NON_GESTURES,
)
"""Names of all sets."""


def load_set(name: str, constants: Constants) -> ClipSet:
    """Build the published set of a name.

    Raises:
        ValueError: there is no set of that name.
    """
    if name == PAIRS:
        return build_pair_set(constants)
    for names, build in SET_BUILDERS:
        if name in names:
            return build(name, constants)
    if name not in SETS:
        raise ValueError(f"no set '{name}'; allowed are {', '.join(ALL_SETS)}")
    size = name if name in ("train", "val") else "test"
    kind = "shifted" if name in ("test-x", "test-m") else "fresh"
    groups = "known" if name in ("train", "val", "test-s") else "new"
    return ClipSet(
        name=name,
        people=name,
        subjects=int(constants.value(f"sets.people.{size}")),
        builds=kind,
        build_count=int(constants.value(f"sets.builds.{kind}")),
        build_kind=kind,
        groups=get_pose_groups(constants, groups),
        stopped=0.0 if name == "test-m" else constants.value("sets.still"),
        classes=CLASSES,
        parts=(SetPart("", int(constants.value(f"sets.clips.{size}"))),),
    )


def get_pose_groups(constants: Constants, *which: str) -> tuple[int, ...]:
    """Return the pose groups that are `known` from training, `new`, or both."""
    lists = (constants.array(f"sets.groups.{name}") for name in which)
    return tuple(int(group) for groups in lists for group in groups)


def build_paper_set(name: str, constants: Constants) -> ClipSet:
    """Build a set as small as the one of Jiang et al. 2025 (section IV-D).

    The sets share people, poses and build. `paper-5` has the class `none` as well. Of
    `paper-places` each gesture is made at few places of the skin, as where a data set
    is collected quickly; `paper-person` is that by one person. In all poses of
    `paper-folded` patches of two links face each other.
    """
    train, test = constants.array("sets.clips.paper")
    people = 1 if name == "paper-person" else int(constants.value("sets.people.paper"))
    few_places = name in ("paper-places", "paper-person")
    return replace(
        load_set("train", constants),
        name=name,
        people="paper",
        subjects=people,
        builds="paper",
        build_count=1,
        groups=get_pose_groups(constants, "known", "new"),
        poses=int(constants.value("sets.poses.paper")),
        stopped=1.0,
        places=int(constants.value("sets.places.paper")) if few_places else None,
        folded=1.0 if name == "paper-folded" else None,
        classes=CLASSES if name == "paper-5" else PAPER_GESTURES,
        parts=(SetPart("train", int(train)), SetPart("test", int(test))),
    )


def build_stream_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of streams on builds of the tests; `streams-fresh` on training's."""
    kind = "fresh" if name == "streams-fresh" else "shifted"
    return replace(
        load_set("train" if kind == "fresh" else "test-x", constants),
        name=name,
        people="streams",
        subjects=int(constants.value("sets.people.streams")),
        groups=get_pose_groups(constants, "known", "new"),
        classes=(),
        parts=(SetPart("", int(constants.value("sets.clips.streams"))),),
    )


def build_gestureless_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of streams without gestures, by other people, on test builds."""
    return replace(
        build_stream_set("streams", constants),
        name=name,
        people=name,
        stopped=constants.value("sets.still_gestureless"),
        parts=(SetPart("", int(constants.value(f"sets.clips.{name}"))),),
        stream=name,
    )


def build_family_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of builds of all families, or of the one that its name ends with."""
    of_test = tuple(family for family in FAMILIES if name == f"test-{family}")
    role = "test-families" if of_test else name
    like = load_set(FAMILY_SETS[name], constants)
    return replace(
        like,
        name=name,
        stopped=0.0 if name == TRAIN_MOVING else like.stopped,
        people=role,
        builds=role,
        families=of_test or FAMILIES,
    )


def build_final_set(name: str, constants: Constants) -> ClipSet:
    """Build a final set; all of them have the same people."""
    like = load_set(FINAL_SETS[name], constants)
    return replace(
        like,
        name=name,
        people=FINAL,
        subjects=int(constants.value("sets.people.final")),
        builds=f"{FINAL}-{like.build_kind}",
        build_count=int(constants.value("sets.builds.final")),
    )


def build_recorded_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of recorded people, half of whose sessions are on families."""
    return replace(
        load_set("train", constants),
        name=name,
        people=RECORDED,
        subjects=1,
        builds=RECORDED,
        families=tuple(kind for family in FAMILIES for kind in (family, "fresh")),
        classes=RECORDED_SETS[name],
        parts=(SetPart("", int(constants.value("sets.clips.recorded"))),),
    )


def build_device_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of devices, of which each session has one of its own."""
    return replace(
        load_set("train", constants),
        name=name,
        people=DEVICES,
        builds=DEVICES,
        families=("fresh",),
        stopped=1.0,
        parts=(SetPart("", int(constants.value("sets.clips.recorded"))),),
    )


def build_non_gesture_set(name: str, constants: Constants) -> ClipSet:
    """Build a set of clips that are all `none`, half of whose sessions are on families.

    The robot moves in more of them than usual, since a cable or a body that stands is
    only passed by a robot that moves.
    """
    return replace(
        load_set("train", constants),
        name=name,
        people=name,
        builds=name,
        families=tuple(kind for family in FAMILIES for kind in (family, "fresh")),
        stopped=constants.value("sets.still_gestureless"),
        classes=("none",),
        kinds="none.trained",
        parts=(SetPart("", int(constants.value("sets.clips.recorded"))),),
    )


def build_pair_set(constants: Constants) -> ClipSet:
    """Build the set of pairs, with as many clips on each side."""
    pairs = int(constants.value("pairs.pairs"))
    return replace(
        load_set("test-s", constants),
        name=PAIRS,
        people=PAIRS,
        stopped=1.0,
        classes=(*NONE_KINDS, "none"),
        parts=tuple(SetPart(side, pairs) for side in SIDES),
    )


SET_BUILDERS = (
    (FINAL_SETS, build_final_set),
    (RECORDED_SETS, build_recorded_set),
    ((DEVICES,), build_device_set),
    ((NON_GESTURES,), build_non_gesture_set),
    (FAMILY_SETS, build_family_set),
    (PAPER_SETS, build_paper_set),
    (("streams", "streams-fresh"), build_stream_set),
    ((ACCIDENTS, QUIET), build_gestureless_set),
)
"""Functions that build sets other than the plainest ones, by the names of these."""


def resize_set(
    clip_set: ClipSet, clips: int | None, subjects: int | None, constants: Constants
) -> ClipSet:
    """Return a set with another number of clips or people.

    A small set has fewer people, so that each of them still shows every gesture.
    `clips` counts the clips, or streams, of all parts, or of each kind of pair; None
    keeps it. `subjects` is None to choose it by the number of clips.

    Raises:
        ValueError: a number is not positive, or some people would have no clip.
    """
    total = clip_set.clips if clips is None else clips
    if clip_set.name == PAIRS and clips is not None:
        if clips < 2 or clips % 2:
            raise ValueError(
                f"{clips} clips requested of each kind of pair; allowed are 2, 4 and "
                "so on"
            )
        total = len(PAIR_SIDES) * clips
    if total < len(clip_set.parts):
        raise ValueError(
            f"{total} clips requested for set '{clip_set.name}'; allowed are at least "
            f"{len(clip_set.parts)}; ask for more with --clips"
        )
    min_clips = int(constants.value("sets.least")) if clip_set.classes else 1
    people = subjects
    if people is None:
        people = min(clip_set.subjects, max(1, total // min_clips))
    if not 1 <= people <= total:
        raise ValueError(
            f"{people} people requested for set '{clip_set.name}' of {total} clips; "
            f"allowed are 1 to {total}; change --subjects or --clips"
        )
    _, *rest = clip_set.parts
    shares = [max(1, total * part.clips // clip_set.clips) for part in rest]
    counts = [total - sum(shares), *shares]
    parts = zip(clip_set.parts, counts, strict=True)
    resized = tuple(SetPart(part.folder, count) for part, count in parts)
    return replace(clip_set, subjects=people, parts=resized)
