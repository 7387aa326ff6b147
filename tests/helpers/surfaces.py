"""Distances along the surfaces that skins lie on."""

import numpy as np
from jaxtyping import Float

from eskin.skin.surfaces import Dome, Surface, Tube


def surface_distances(
    surface: Surface,
    sources: Float[np.ndarray, "source 3"],
    targets: Float[np.ndarray, "target 3"],
) -> Float[np.ndarray, "source target"]:
    """Return the lengths of the shortest paths on a surface between its points [m].

    They are straight lines on a plane, the shorter helix on a tube, and great circles
    on a dome.
    """
    if isinstance(surface, Dome):
        a, b = (
            local / np.linalg.norm(local, axis=1, keepdims=True)
            for local in (
                surface.to_surface_frame(sources),
                surface.to_surface_frame(targets),
            )
        )
        chord = np.linalg.norm(a[:, None] - b[None], axis=-1)
        return 2 * surface.radius * np.arcsin(np.minimum(chord / 2, 1.0))
    steps = np.abs(surface.unroll(sources)[:, None] - surface.unroll(targets)[None])
    if isinstance(surface, Tube):
        around = 2 * np.pi * surface.radius
        steps[..., 0] = np.minimum(steps[..., 0], around - steps[..., 0])
    return np.linalg.norm(steps, axis=-1)
