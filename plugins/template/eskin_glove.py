"""A template of a driver: once installed, `eskin run --source glove:NAME` reads it."""

import numpy as np

from eskin.app import open_samples
from eskin.drivers import PatchSample, SampleDevice
from eskin.registry import Driver


class Glove(SampleDevice):
    """Sends 50 samples a second of the first patch; replace what the comments name."""

    def __init__(self, clock, skin):
        """Prepare the device, not yet its line."""
        self.clock = clock
        self.seen = 0
        self.taxels = skin.find_taxels(skin.patches[0].id)

    def connect(self):
        """Open the line."""  # Raise OSError where the device is missing.
        self.due = self.clock.now()

    def receive(self, timeout):
        """Return the samples that have come."""  # Raise OSError where it is gone.
        self.clock.sleep(min(timeout, max(self.due - self.clock.now(), 0) / 1e9))
        if (now := self.clock.now()) < self.due:
            return []
        self.due = now + 20_000_000
        counts = np.full(len(self.taxels), 100, np.int32)  # Read them from the line.
        self.seen += counts.nbytes
        return [PatchSample(0, now, counts)]

    def disconnect(self):
        """Close the line; it may be closed already."""

    def counters(self):
        """Return how much has come."""
        return {"bytes": self.seen}


def open_glove(uris, config, clock):
    """Open a glove by its URI."""
    return open_samples(uris, config, clock, lambda skin: Glove(clock, skin))


GLOVE = Driver(open_glove, "glove:NAME", touches="cable")
