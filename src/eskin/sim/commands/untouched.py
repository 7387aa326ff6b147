"""This module says what a simulation of people on a robot leaves out."""

from eskin.sim.scene import find_untouched_links, load_environment
from eskin.skin import SKIN_PRESETS


def print_untouched(skin: str, robot: str | None) -> None:
    """Print what a simulation leaves out on a skin that does not come with eskin.

    These are links that no simulated person touches, and meshes that are not at hand.
    """
    if skin in SKIN_PRESETS:
        return
    env = load_environment(skin, robot)
    if lacking := env.mounted.robot.describe_lacking_meshes("simulated"):
        print(lacking, flush=True)
    links = find_untouched_links(env)
    if links:
        print(
            f"not touched: {', '.join(links)}; no room for a finger, or out of reach",
            flush=True,
        )
