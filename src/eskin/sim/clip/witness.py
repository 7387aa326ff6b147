"""The truth of a scene, as a witness who sees everything writes it down."""

import numpy as np
from jaxtyping import Float

from eskin.sim.clip.outcome import TrueSeries
from eskin.sim.clip.scene import Part
from eskin.sim.clip.timing import contact_steps
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.chart import Chart
from eskin.skin import MountedSkin
from eskin.transforms import apply


def series_of(
    number: int,
    touch: TrueTouch,
    parts: list[Part],
    charts: tuple[Chart, ...],
    mounted: MountedSkin,
    q: Float[np.ndarray, "time joint"],
    lead: int,
    every: int,
    step: float,
) -> TrueSeries:
    """Force, area and centre of a touch at every reading.

    Args:
        number: of the touch in its clip.
        touch: what was done.
        parts: what its presses do in the scene.
        charts: of the skin.
        mounted: the skin on its robot.
        q: joint positions of the scene [rad].
        lead: steps of the scene before the clip.
        every: steps between two readings.
        step: length of a step [s].
    """
    steps = len(q)
    force, area = np.zeros(steps), np.zeros(steps)
    moment = np.zeros((steps, 3))
    loads: dict[str, float] = {}
    T_world_link = mounted.kinematics.poses(q)
    for part in parts:
        chart, felt = charts[part.press.chart], part.felt
        force[part.span] += felt.force
        area[part.span] += felt.area
        p_link = chart.surface.wrap(felt.centroid).positions
        poses = T_world_link[part.span, mounted.robot.link_index(chart.link)]
        p_world = apply(poses, p_link)
        moment[part.span] += felt.force[:, None] * p_world
        loads[chart.link] = loads.get(chart.link, 0.0) + float(felt.force.sum())
    first, end = contact_steps(touch)
    # Means over the steps of a reading: a bump may last one step alone.
    force, area, moment = (
        series[lead : lead + (steps - lead) // every * every]
        .reshape(-1, every, *series.shape[1:])
        .mean(axis=1)
        for series in (force, area, moment)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        centroid = np.nan_to_num(moment / force[:, None])
    return TrueSeries(
        number=number,
        gesture=touch.gesture,
        kind=touch.kind,
        subject=touch.subject,
        link=max(loads, key=lambda link: loads[link], default=""),
        force=force,
        area=area,
        centroid=centroid,
        onset=(first - lead) * step,
        end=(end - lead) * step,
    )
