"""This module defines how careful commands are."""

from dataclasses import dataclass, field

from eskin.command.evidence import EvidenceConfig
from eskin.command.skin_monitor import SkinMonitorConfig


@dataclass(frozen=True)
class PolicyConfig:
    """A policy configuration says how careful commands are."""

    monitor: SkinMonitorConfig = field(default_factory=SkinMonitorConfig)
    """Limits beyond which the arm is held because of its skin."""

    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    """How much of a touch must be sound for more than a stop."""

    min_duration: float = 0.3
    """Least time from the first to the latest contact of a touch that makes the arm do
    more than before [s]; what bumps into a skin and rebounds is briefer than most
    double pats. Chosen by `python -m lab.command_thresholds`."""

    min_pause: float = 1.0
    """Least duration of a pause [s]."""

    min_release: float = 0.1
    """How long a touch must have ended before it makes the arm do more, and nobody may
    have touched the skin before it sets the arm in motion [s]."""

    max_delay: float = 2.0
    """How long after a detection its touch may go on before it makes the arm do more,
    and a doubtful one may become confident [s]."""

    slow_speed: float = 0.3
    """Share of full speed of the action `slow`, and on a skin that is out in part."""

    jog_step: float = 0.05
    """Length of a jog whose rule gives none [m]."""

    check_period: float | None = 0.02
    """How often a thread checks whether the skin is stale, though no reading comes [s];
    None starts no thread, and `check_skin` is called by others."""
