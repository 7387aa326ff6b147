"""Clip sets define who touches, with which sensors, in which poses, and how often."""

from dataclasses import dataclass, replace
from typing import Literal

from eskin.sim.constants import Constants
from eskin.sim.dataset.plan import ACCIDENTS, NONE_KINDS, PAIR_SIDES, QUIET, SIDES

PAPER_GESTURES = ("poke", "double_pat", "grab", "stroke")
"""Gestures of the paper."""

CLASSES = (*PAPER_GESTURES, "none")
"""Gestures of the paper, and `none`."""


@dataclass(frozen=True)
class SetPart:
    """A set part holds clips of a set that lie in a folder of their own."""

    folder: str
    """Folder below that of the set; empty where the set has one part."""
    clips: int
    """Number of clips."""


@dataclass(frozen=True)
class ClipSet:
    """A clip set defines the clips, or streams, of a data set."""

    name: str
    """Name of the set."""
    people: str
    """Role that its people are drawn for; sets of the same role share them."""
    subjects: int
    """Number of people."""
    builds: str
    """Role that its sensor builds are drawn for."""
    build_count: int
    """Number of builds."""
    build_kind: Literal["fresh", "shifted"]
    """Laws that the builds are drawn from."""
    groups: tuple[int, ...]
    """Pose groups."""
    poses: int | None
    """Number of poses; None draws one for every clip."""
    still: float
    """Share of clips in which the robot stands still."""
    classes: tuple[str, ...]
    """Gestures, equally often; empty in streams, which do one after the other."""
    parts: tuple[SetPart, ...]
    """Parts of the set."""
    stream: str | None = None
    """Kind of its streams; None for clips, and where people do all that they do."""

    @property
    def clips(self) -> int:
        """Return the number of clips, or streams."""
        return sum(part.clips for part in self.parts)


SETS = (
    "train",
    "val",
    "test-s",
    "test-p",
    "test-x",
    "test-m",
    "paper",
    "paper-5",
    "streams",
    "streams-fresh",
    ACCIDENTS,
    QUIET,
)
"""Names of all sets that recognisers are trained and tested on."""

PAIRS = "pairs"
"""Name of the set of pairs of clips with the same counts but not the same label."""


def load_set(name: str, constants: Constants) -> ClipSet:
    """Load a set as it is published.

    Raises:
        ValueError: there is none of that name.
    """
    if name == PAIRS:
        return build_pair_set(constants)
    if name not in SETS:
        allowed = ", ".join((*SETS, PAIRS))
        raise ValueError(f"no set '{name}'; allowed are {allowed}")
    if name.startswith("paper"):
        return build_paper_set(name, constants)
    if name.startswith("streams"):
        return build_stream_set(name, constants)
    if name in (ACCIDENTS, QUIET):
        return build_gestureless_set(name, constants)
    plain = {"train": "train", "val": "val"}.get(name, "test")
    shifted = name in ("test-x", "test-m")
    kind = "shifted" if shifted else "fresh"
    known = name in ("train", "val", "test-s")
    return ClipSet(
        name=name,
        people=name,
        subjects=int(constants.value(f"sets.people.{plain}")),
        builds=kind,
        build_count=int(constants.value(f"sets.builds.{kind}")),
        build_kind=kind,
        groups=get_pose_groups(constants, "known" if known else "new"),
        poses=None,
        still=0.0 if name == "test-m" else constants.value("sets.still"),
        classes=CLASSES,
        parts=(SetPart("", int(constants.value(f"sets.clips.{plain}"))),),
    )


def get_pose_groups(constants: Constants, *which: str) -> tuple[int, ...]:
    """Return pose groups, known or new."""
    lists = (constants.array(f"sets.groups.{name}") for name in which)
    return tuple(int(group) for groups in lists for group in groups)


def build_paper_set(name: str, constants: Constants) -> ClipSet:
    """Build a set as small as the paper's.

    Both variants share people, poses and build.
    """
    train, test = constants.array("sets.clips.paper")
    return ClipSet(
        name=name,
        people="paper",
        subjects=int(constants.value("sets.people.paper")),
        builds="paper",
        build_count=1,
        build_kind="fresh",
        groups=get_pose_groups(constants, "known", "new"),
        poses=int(constants.value("sets.poses.paper")),
        still=1.0,
        classes=PAPER_GESTURES if name == "paper" else CLASSES,
        parts=(SetPart("train", int(train)), SetPart("test", int(test))),
    )


def build_stream_set(name: str, constants: Constants) -> ClipSet:
    """Build streams on the builds of the tests or, `streams-fresh`, of training."""
    kind = "fresh" if name == "streams-fresh" else "shifted"
    return ClipSet(
        name=name,
        people="streams",
        subjects=int(constants.value("sets.people.streams")),
        builds=kind,
        build_count=int(constants.value(f"sets.builds.{kind}")),
        build_kind=kind,
        groups=get_pose_groups(constants, "known", "new"),
        poses=None,
        still=constants.value("sets.still"),
        classes=(),
        parts=(SetPart("", int(constants.value("sets.clips.streams"))),),
    )


def build_gestureless_set(name: str, constants: Constants) -> ClipSet:
    """Build streams without any gesture, by other people, on builds of the tests."""
    return replace(
        build_stream_set("streams", constants),
        name=name,
        people=name,
        still=constants.value("sets.still_gestureless"),
        parts=(SetPart("", int(constants.value(f"sets.clips.{name}"))),),
        stream=name,
    )


def build_pair_set(constants: Constants) -> ClipSet:
    """Build pairs of each kind, as many on either side."""
    pairs = int(constants.value("pairs.pairs"))
    return ClipSet(
        name=PAIRS,
        people=PAIRS,
        subjects=int(constants.value("sets.people.test")),
        builds="fresh",
        build_count=int(constants.value("sets.builds.fresh")),
        build_kind="fresh",
        groups=get_pose_groups(constants, "known", "new"),
        poses=None,
        still=1.0,
        classes=(*NONE_KINDS, "none"),
        parts=tuple(SetPart(side, pairs) for side in SIDES),
    )


def resize_set(
    clip_set: ClipSet, clips: int | None, subjects: int | None, constants: Constants
) -> ClipSet:
    """Return the set smaller or larger.

    With few clips there are fewer people too, so that each still does everything.

    Args:
        clip_set: set as it is published.
        clips: number of clips, or streams, over all parts; None keeps it.
        subjects: number of people; None takes as many as suit the clips.
        constants: constants, which say how many clips of a person are enough.

    Raises:
        ValueError: a number is not positive, or some people would have no clip.
    """
    total = clip_set.clips if clips is None else clips
    if clip_set.name == PAIRS and clips is not None:
        total = count_pair_clips(clips)
    if total < len(clip_set.parts):
        raise ValueError(
            f"{total} clips asked of set '{clip_set.name}'; allowed are at least "
            f"{len(clip_set.parts)}; ask for more with --clips"
        )
    least = int(constants.value("sets.least")) if clip_set.classes else 1
    people = min(clip_set.subjects, max(1, total // least))
    people = people if subjects is None else subjects
    if not 1 <= people <= total:
        raise ValueError(
            f"{people} people asked of set '{clip_set.name}' of {total} clips; allowed "
            f"are 1 to {total}; change --subjects or --clips"
        )
    return replace(clip_set, subjects=people, parts=resize_parts(clip_set, total))


def count_pair_clips(clips: int) -> int:
    """Return the clips of all kinds of pairs together, from those of each.

    Raises:
        ValueError: the number is not even.
    """
    if clips < 2 or clips % 2:
        raise ValueError(
            f"{clips} clips asked of each kind of pair; allowed are 2, 4 and so on; "
            "change --clips"
        )
    return len(PAIR_SIDES) * clips


def resize_parts(clip_set: ClipSet, total: int) -> tuple[SetPart, ...]:
    """Return the parts of a set of so many clips, in the same proportion."""
    first, *rest = clip_set.parts
    shares = [max(1, total * part.clips // clip_set.clips) for part in rest]
    clips = [total - sum(shares), *shares]
    return tuple(
        SetPart(part.folder, count)
        for part, count in zip((first, *rest), clips, strict=True)
    )
