"""What people and things do to the robot: one program for each gesture."""

from eskin.sim.people.programs.perform import GESTURES, perform

__all__ = ["GESTURES", "perform"]
