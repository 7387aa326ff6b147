"""A controller of Universal Robots, reached from a process that imports little else."""

from eskin.ur.client import PERIOD, UrLink
from eskin.ur.link import Link, UrOrder, UrStatus

__all__ = ["PERIOD", "Link", "UrLink", "UrOrder", "UrStatus"]
