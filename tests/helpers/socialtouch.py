"""These helpers write small files in the format of the SocialTouch set."""

import gzip

import numpy as np

TAXELS = 456
HEADER = ",".join(
    ["participantID", "gesture", "repetition", "frameID", "time"]
    + [f"pixel{number}" for number in range(TAXELS)]
)


def pressed(readings=(2, 3), length=6, rows=slice(8, 10), columns=slice(10, 12)):
    """Return counts of a repetition that is touched in some of its readings."""
    counts = np.zeros((length, 19, 24), int)
    counts[slice(*readings), rows, columns] = 200
    return counts.reshape(length, TAXELS)


def text_of(repetitions, person=0, gesture=6, period=83):
    """Return a file's text; repetitions are counts (reading taxel)."""
    lines = [HEADER]
    for number, counts in enumerate(repetitions):
        for frame, values in enumerate(counts):
            head = (person, gesture, number, frame, frame * period)
            lines.append(",".join(map(str, (*head, *values))))
    return "\n".join(lines) + "\n"


def write_socialtouch(
    folder, name="touch_p0_g6-20_4_17h_5m_23s.csv.gz", text=None, **facts
):
    """Write a file; gzipped where its name ends with .gz."""
    data = (text_of([pressed()], **facts) if text is None else text).encode()
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path
