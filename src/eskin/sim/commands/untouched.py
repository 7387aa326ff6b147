"""This module says which links of a skin no simulated person touches."""

from eskin.sim.scene import find_untouched_links, load_environment
from eskin.skin import SKIN_PRESETS


def print_untouched(skin: str, robot: str | None) -> None:
    """Print which links of a skin that does not come with eskin nobody touches."""
    if skin in SKIN_PRESETS or robot is None:
        return
    links = find_untouched_links(load_environment(skin, robot))
    if links:
        print(
            f"not touched: {', '.join(links)}; no room for a finger, or out of reach",
            flush=True,
        )
