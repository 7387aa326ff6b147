"""Measure how touches end on sensors that release slowly, and on sensors that creep.

    python -m lab.release make FOLDER                # streams by a seed, once
    python -m lab.release play FOLDER OUT.json       # by the eskin that is imported
    python -m lab.release play FOLDER OUT.json --only slow fresh --presses
    python -m lab.release compare OLD.json NEW.json  # paired by streams

Simulated people touch the skin of a UR5 in streams; `lab.release.streams.DRAWS` lists
the draws of builds and touches. Numbers are chosen on seed 7300; seed 7400 is for the
final figures, and is made and played once. Intervals are those of 95 % of resampled
streams (percentile bootstrap).

- A detection matches a true gesture as in `eskin.learn.events`.
- A true touch is cut where touches of the front end follow each other within its
  unbroken contact, parted where they do so at a gap of it, as between two pats, and
  joined where the touch that covers half of it covers half of an earlier one.
- A touch takes part in a true touch with which it is in contact for 0.1 s, or for half
  of it. Its end is late by the time from the last true contact of those to its own.
- A touch is opened beside or after true ones where it is the strongest one of none; a
  false gesture is of no true touch where a detection of such a touch matches nothing.
"""
