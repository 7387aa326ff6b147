"""Play variants by the copy of eskin that is imported; `lab.vary.play` starts it."""

import json
import logging
import sys
import time
from pathlib import Path

from lab.vary.numbers import Sources
from lab.vary.rewrite import Slots, change_numbers, keep_no_code


def main() -> None:
    """Play the variants of a task on the standard input."""
    task = json.load(sys.stdin)
    keep_no_code()
    # Eskin is imported after this: it would load code that is kept.
    from lab.vary.make import SETTINGS
    from lab.vary.play import Variant, write_line
    from lab.vary.player import play
    from lab.vary.worlds import read_worlds

    logging.basicConfig(level=logging.ERROR)
    folder = Path(task["folder"])
    found = Path(task["found"])
    slots = Slots.build(Sources(Path(task["sources"])))
    settings = json.loads((folder / SETTINGS).read_text("utf-8"))
    worlds = list(read_worlds(folder, settings["seed"]))
    for each in task["variants"]:
        if time.time() > task["ends_at"]:
            return
        variant = Variant(**each)
        figures = {}
        error = ""
        if not task["edited"]:
            change_numbers(slots, variant.changed)
        try:
            figures = {world.name: vars(play(world)) for world in worlds}
        except Exception as problem:  # noqa: BLE001
            error = f"{type(problem).__name__}: {problem}"
        write_line(found, variant, task["digest"], figures, error)


if __name__ == "__main__":
    main()
