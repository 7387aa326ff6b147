"""Simulated sets by name, made where they are not there yet."""

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
    """The folder of a set, generated where it is not there yet.

    Args:
        sets: folder of all sets.
        name: of the set.
        skin: that is touched.
        clips: how many; as many as the set has where None.
        people: how many; as many as suit the clips where None.
        seed: decides everything that is drawn.
        workers: how many processes generate.
    """
    words = [name]
    words += [skin] if skin != "ur5" else []
    words += [str(clips)] if clips is not None else []
    words += [f"people{people}"] if people is not None else []
    words += [f"seed{seed}"] if seed else []
    folder = sets / "-".join(words)
    generate(folder, GenerationSettings(name, skin, seed, clips, people), workers)
    return folder
