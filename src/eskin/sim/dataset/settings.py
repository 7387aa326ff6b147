"""Generation settings define what a folder of clips contains."""

import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path

from eskin.errors import GenerationError
from eskin.files import atomic_path, read_file
from eskin.recording import list_recordings
from eskin.sim.constants import CONSTANTS_FILE, Constants, load_constants
from eskin.sim.dataset.devices import fit_to_device, name_device
from eskin.sim.dataset.index import INDEX_NAME
from eskin.sim.dataset.plan import (
    ClipPlan,
    SessionPlan,
    find_side,
    plan_clips,
    plan_pair_clips,
    plan_pair_sessions,
    plan_sessions,
)
from eskin.sim.dataset.sets import (
    DEVICES,
    PAIRS,
    RECORDED_SETS,
    SIDE_SKINS,
    ClipSet,
    load_set,
    resize_set,
)
from eskin.sim.people.recorded import RecordedPeople
from eskin.sim.scene.environment import load_environment
from eskin.sim.scene.targets import CLOSE
from eskin.sim.sensor.flaws import FAMILIES, Family
from eskin.skin import (
    SKIN_PRESETS,
    load_robot_for_skin,
    mount_skin,
    skin_to_bytes,
)

SETTINGS_NAME = "generation.json"
MAX_SETTINGS_BYTES = 16 << 20
"""Largest size of the settings of a folder [bytes]."""
VERSION = 1
MAX_DIFFICULTY = 10.0
"""Difficulty above which distributions are meaningless."""


@dataclass(frozen=True)
class GenerationSettings:
    """Generation settings choose a set, and with it every clip that is generated."""

    set_name: str = "train"
    """One of `eskin.sim.dataset.sets.SETS`, or `PAIRS`."""
    skin: str = "ur5"
    """Name of a preset skin, or folder of a skin."""
    seed: int = 0
    """Seed of everything that is drawn."""
    clips: int | None = None
    """Number of clips or streams, or of clips of each kind of pair; None keeps that of
    the published set."""
    subjects: int | None = None
    """Number of people; None chooses it by the number of clips."""
    difficulty: float | None = None
    """Difficulty; None is the published one."""
    families: tuple[Family, ...] | None = None
    """Families that each session's build is drawn from; None keeps the builds of the
    published set."""
    recorded: RecordedPeople | None = None
    """People whose recorded touches a set is made of; None for other sets."""
    robot: str | None = None
    """Robot that wears the skin: its name, or the path of its URDF; None for the skin's
    own."""

    def __post_init__(self) -> None:
        """Refuse settings that no set can be generated with."""
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; allowed are 0 and above")
        if not 0 <= self.level <= MAX_DIFFICULTY:
            raise ValueError(
                f"difficulty is {self.difficulty}; allowed are 0 (easiest) to "
                f"{MAX_DIFFICULTY:g}"
            )
        check_recorded(self)
        if self.families is not None:
            check_families(self.families, self.set_name)
        if self.set_name == DEVICES and (self.skin != "ur5" or self.robot):
            raise ValueError(
                f"set '{DEVICES}' requested on a skin; allowed are its own devices, on "
                "no robot; leave --skin and --robot-urdf out"
            )
        fits = self.skin in SKIN_PRESETS and has_joints(self.skin)
        if self.has_pairs and not fits:
            raise ValueError(
                f"set '{PAIRS}' requested on skin '{self.skin}', whose robot has no "
                "known joints to fold; allowed are skins of arms that come with eskin"
            )
        if not self.sessions:
            raise ValueError(f"set '{self.set_name}' has no clips; ask for some")

    @property
    def constants(self) -> Constants:
        """Return the constants of the simulation."""
        return load_constants()

    @property
    def level(self) -> float:
        """Return the difficulty, the published one by default."""
        published = self.constants.value("sets.difficulty")
        return published if self.difficulty is None else self.difficulty

    @cached_property
    def clip_set(self) -> ClipSet:
        """Return the set, resized as requested.

        Robots without joints are too wide to grab, so their sets have no grabs; nor
        have those of a skin that lies around no limb.
        """
        published = load_set(self.set_name, self.constants)
        if not can_grab(self.skin, self.robot):
            classes = tuple(name for name in published.classes if name != "grab")
            published = replace(published, classes=classes)
        if self.families is not None:
            published = replace(published, families=self.families)
        if self.recorded is None:
            return resize_set(published, self.clips, self.subjects, self.constants)
        names = self.recorded.names
        if self.set_name == DEVICES:
            published = replace(published, classes=self.recorded.classes)
        published = replace(published, names=names)
        return resize_set(published, self.clips, len(names), self.constants)

    @cached_property
    def sessions(self) -> tuple[SessionPlan, ...]:
        """Return the plans of its files."""
        found = plan_sessions(self.clip_set, self.seed, self.constants)
        return plan_pair_sessions(found, self.seed) if self.has_pairs else found

    def plan_clips(self, session_plan: SessionPlan) -> tuple[ClipPlan, ...]:
        """Plan the lead-in of a file and its clips."""
        plan = plan_pair_clips if self.has_pairs else plan_clips
        plans = plan(session_plan, self.clip_set, self.seed, self.level, self.constants)
        if self.set_name == DEVICES:
            name = name_device(session_plan)
            return tuple(fit_to_device(each, name) for each in plans)
        if self.recorded is None:
            return plans
        # Nobody simulated touches beside a recorded person.
        return tuple(replace(each, company=None, concurrent=0.0) for each in plans)

    @property
    def has_pairs(self) -> bool:
        """Tell whether its clips are pairs with the same counts."""
        return self.set_name == PAIRS

    def find_skin(self, session_plan: SessionPlan) -> str:
        """Return the skin of a file; sides of pairs and devices may have their own."""
        if self.set_name == DEVICES:
            return name_device(session_plan)
        if not self.has_pairs:
            return self.skin
        return SIDE_SKINS.get(find_side(session_plan), self.skin)

    def to_json(self) -> dict[str, object]:
        """Return the settings as stored, with a digest of the constants."""
        facts: dict[str, object] = {"version": VERSION, **asdict(self)}
        facts["clips"] = self.clip_set.clips
        facts["subjects"] = self.clip_set.subjects
        facts["difficulty"] = self.level
        facts["families"] = list(self.clip_set.families)
        if not self.clip_set.families:
            del facts["families"]
        if self.robot is None:
            del facts["robot"]
        if self.skin not in SKIN_PRESETS or self.robot is not None:
            mounted = mount_skin(self.skin, self.robot)
            facts["skin_digest"] = sha256(skin_to_bytes(mounted.skin)).hexdigest()
            if self.robot is None:
                facts["robot_digest"] = sha256(mounted.robot.urdf).hexdigest()
        del facts["recorded"]
        if self.recorded is not None:
            facts["recorded"] = self.recorded.digest
            facts["people"] = list(self.recorded.people)
        facts["constants"] = sha256(CONSTANTS_FILE.read_bytes()).hexdigest()
        return facts


def check_recorded(settings: GenerationSettings) -> None:
    """Refuse recorded touches of another set, and the set without them."""
    name = settings.set_name
    if settings.recorded is None:
        if name in RECORDED_SETS:
            raise ValueError(
                f"set '{name}' requested without recorded touches; allowed is a folder "
                "of the SocialTouch set; give it with --recorded"
            )
    elif name not in (*RECORDED_SETS, DEVICES):
        raise ValueError(
            f"recorded touches given for set '{name}'; allowed are sets "
            f"{', '.join(RECORDED_SETS)} and {DEVICES}; change --set or leave "
            "--recorded out"
        )
    elif settings.subjects is not None:
        raise ValueError(
            f"{settings.subjects} people requested for set '{name}', which has "
            "those that were recorded; choose some with --people"
        )


def check_families(families: tuple[Family, ...], set_name: str) -> None:
    """Refuse families that are none, unknown or named twice, and families of pairs."""
    known = [family for family in FAMILIES if family in families]
    if not families or len(known) != len(families):
        raise ValueError(
            f"families are {', '.join(families) or 'none'}; allowed are one or more of "
            f"{', '.join(FAMILIES)}, each once"
        )
    if set_name in (PAIRS, DEVICES):
        raise ValueError(
            f"families requested of set '{set_name}', which has builds of its own; "
            "allowed are all other sets; leave --families out"
        )


def has_joints(skin: str) -> bool:
    """Tell whether a skin is on a robot with joints; true if its robot is unknown."""
    robot = load_robot_for_skin(skin)
    return robot is None or len(robot.joint_names) > 0


def can_grab(skin: str, robot: str | None) -> bool:
    """Tell whether a hand can close round a part of a skin on its robot."""
    if robot is None and skin in SKIN_PRESETS:
        return has_joints(skin)
    return max(load_environment(skin, robot).targets.allows) >= CLOSE


def claim_folder(folder: Path, settings: GenerationSettings) -> None:
    """Store the settings of a set in a folder, or check that they are there.

    Raises:
        GenerationError: the folder holds another set or other recordings, or cannot be
            written.
    """
    path = folder / SETTINGS_NAME
    wanted = settings.to_json()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if path.exists():
            check_same_settings(path, wanted)
        elif (folder / INDEX_NAME).exists() or list_recordings(folder):
            raise GenerationError(
                f"{folder} holds recordings but no {SETTINGS_NAME}, so they are not "
                "from a generation; give a new folder"
            )
        else:
            with atomic_path(path, durable=True) as part:
                part.write_text(json.dumps(wanted, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise GenerationError(
            f"cannot write to {folder}: {error.strerror}; give a folder that can be "
            "written to"
        ) from error


def check_same_settings(path: Path, wanted: dict[str, object]) -> None:
    """Raise an error if a folder was generated with other settings."""
    try:
        found = json.loads(read_file(path, MAX_SETTINGS_BYTES))
        differing = [name for name in wanted if found.get(name) != wanted[name]]
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise GenerationError(
            f"{path} cannot be read ({error}); give a new folder"
        ) from error
    if differing:
        name = differing[0]
        raise GenerationError(
            f"{path.parent} was generated with {name} {found.get(name)}, not "
            f"{wanted[name]}; give a new folder, or the same settings to go on"
        )
