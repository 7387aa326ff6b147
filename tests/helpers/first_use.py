"""Run a command of eskin, and print what it compiles or loads too late.

A program: `python -m helpers.first_use WORD...`. It prints one line of JSON, a list of
the compiled functions that were first called after a device had been opened, or a
person had been asked for something, each with its types. A demonstration is touched in
all ways meanwhile.
"""

import json
import re
import sys
from contextlib import redirect_stdout
from io import TextIOBase
from threading import Thread
from time import sleep

from numba.core.dispatcher import Dispatcher

import eskin.app
from eskin.cli.main import run
from eskin.page import TouchOrder

REQUEST = re.compile(r"hands off|press |Ctrl-C ends it")
"""What a command prints when it asks for something, or lets people touch."""
TOUCH_SECONDS = 0.5
"""Duration of each touch of a demonstration, and of the pause after it [s]."""


def list_compiled():
    """List the functions that Python has called so far, with the types of each call."""
    modules = [module for name, module in sys.modules.items() if "eskin" in name]
    found = [value for module in modules for value in vars(module).values()]
    return {
        f"{one.__module__}.{one.__name__}{types}"
        for one in found
        if isinstance(one, Dispatcher)
        for types in one.signatures
    }


class Listener(TextIOBase):
    """Takes what a command prints, and notes what is compiled at its first request."""

    def __init__(self):
        self.compiled = None

    def note(self):
        if self.compiled is None:
            self.compiled = list_compiled()

    def write(self, text):
        if self.compiled is None and REQUEST.search(text):
            self.note()
            Thread(target=touch_all, daemon=True).start()
        return len(text)


def note_at_devices(listener):
    """Let the listener note what is compiled when the first device is opened."""
    open_source = eskin.app.open_source

    def note_and_open(*uris, **options):
        if eskin.app.find_driver(uris).is_device:
            listener.note()
        return open_source(*uris, **options)

    eskin.app.open_source = note_and_open


def touch_all():
    """Touch the skin of a running demonstration in all ways, where there is one."""
    for handler in handlers:
        skin = handler.skin.mounted.skin
        for patch in skin.patches[:3]:
            taxels = skin.find_taxels(patch.id)
            place = tuple(skin.positions[taxels[len(taxels) // 2]].tolist())
            for kind in ("poke", "grab", "double_pat", "begin", "move", "end"):
                handler.handle_touch(TouchOrder(kind, patch.link, place, 6.0, 0.3, 1))
                sleep(TOUCH_SECONDS)


handlers = []


def remember_handlers():
    """Let each handler of a page's orders be found by `touch_all`."""
    from eskin.sim.demo.browser import PageOrderHandler

    begin = PageOrderHandler.__init__

    def remember(self, *parts):
        begin(self, *parts)
        handlers.append(self)

    PageOrderHandler.__init__ = remember


def main(words):
    """Run a command, and print what is compiled too late; return its exit code."""
    if words[0] == "demo":
        remember_handlers()
    listener = Listener()
    note_at_devices(listener)
    with redirect_stdout(listener):
        code = run(words)
    if listener.compiled is None:
        raise ValueError("nobody was asked for anything")
    json.dump(sorted(list_compiled() - listener.compiled), sys.stdout)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
