"""Electrical events in what was counted, once in a clip or now and then in a stream."""

from dataclasses import replace

from eskin.sim.clip.outcome import Clip
from eskin.sim.clip.play import build_of
from eskin.sim.clip.stage import Stage
from eskin.sim.sensor.electrical import ELECTRICAL, disturb

HOUR = 3600.0
"""[s]"""


def disturbed(clip: Clip, stage: Stage) -> Clip:
    """The same clip with an electrical event in it."""
    return with_event(clip, stage, "electrical", None)


def disturbed_by_the_hour(clip: Clip, stage: Stage) -> Clip:
    """The same stream with electrical events at any time, so many an hour."""
    constants, rng = stage.world.constants, stage.rng
    rate = constants.value("stream.electrical") / HOUR
    for number in range(rng.poisson(rate * stage.plan.seconds)):
        onset = int(rng.integers(len(clip.counts)))
        clip = with_event(clip, stage, f"electrical{number}", onset)
    return clip


def with_event(clip: Clip, stage: Stage, name: str, onset: int | None) -> Clip:
    """The same clip with one more event.

    Args:
        clip: what was counted.
        stage: where.
        name: under which it is written down.
        onset: reading at which it begins; None draws it.
    """
    event = ELECTRICAL[stage.rng.integers(len(ELECTRICAL))]
    build = build_of(stage.plan.build, stage.world)
    counts, received, drawn = disturb(
        *(event, clip.counts, clip.received, stage.world.mounted.skin, build),
        *(stage.rng, stage.world.constants, onset),
    )
    more = {f"{name}.{key}": value for key, value in drawn.items()}
    return replace(clip, counts=counts, received=received, drawn=clip.drawn | more)
