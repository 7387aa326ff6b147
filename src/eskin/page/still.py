"""This module renders a skin at one instant as a page that needs no server."""

import numpy as np
from jaxtyping import Float

from eskin.page.appearance import describe_scene
from eskin.page.process import make_token
from eskin.page.scene import Scene
from eskin.page.server import open_server
from eskin.page.viewer import build_still
from eskin.skin import MountedSkin
from eskin.skin.colours import ColourScale


def render_still(
    mounted: MountedSkin,
    q: Float[np.ndarray, "joint"],
    values: Float[np.ndarray, "taxel"],
) -> str:
    """Return a robot in its skin as HTML, with taxels coloured by their values.

    Args:
        mounted: skin on its robot.
        q: joint positions [rad].
        values: value of each taxel, not negative; NaN where it has none.
    """
    setup = describe_scene(mounted, (), q)
    has_value = np.isfinite(values)
    greatest = float(np.max(values, initial=0.0, where=has_value)) or 1.0
    server = open_server(0, make_token())
    try:
        scene = Scene(server, setup, ColourScale(greatest))
        scene.face_skin()
        shown = np.nan_to_num(values).astype(np.float16)
        scene.update(build_still(mounted, 0.0, q, shown, has_value))
        return server.scene.as_html()
    finally:
        server.stop()
