"""What pushes on a link."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

__all__ = ["Wrench"]


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force and a torque on a link, in its own frame."""

    link: str
    """Which one."""
    force_link: Float[np.ndarray, "3"]
    """[N]"""
    torque_link: Float[np.ndarray, "3"]
    """About the origin of the link [Nm]."""
