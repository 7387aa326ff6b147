"""Generate simulated sets by name, unless they exist."""

from pathlib import Path

from eskin.sim.dataset import GenerationSettings, generate


def made_set(
    sets: Path,
    name: str,
    *,
    skin: str = "ur5",
    clips: int | None = None,
    people: int | None = None,
    seed: int = 0,
    workers: int = 1,
) -> Path:
    """Return the folder of a set, and generate it if it is missing.

    Args:
        sets: folder of all sets.
        name: name of the set.
        skin: name of the skin.
        clips: number of clips; the set's number if None.
        people: number of people; chosen by the number of clips if None.
        seed: random seed.
        workers: number of processes.
    """
    words = [name]
    words += [skin] if skin != "ur5" else []
    words += [str(clips)] if clips is not None else []
    words += [f"people{people}"] if people is not None else []
    words += [f"seed{seed}"] if seed else []
    folder = sets / "-".join(words)
    generate(folder, GenerationSettings(name, skin, seed, clips, people), workers)
    return folder
