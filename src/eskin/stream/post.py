"""One listener with its queue and its thread."""

from collections.abc import Callable
from threading import Thread
from typing import final

from eskin.stream.inbox import Inbox
from eskin.stream.listener import Listener
from eskin.stream.moment import Heard

Fail = Callable[[str, BaseException], None]


@final
class Post:
    """Where a listener listens."""

    def __init__(self, listener: Listener, fail: Fail) -> None:
        """Set up queue and thread; nothing runs yet.

        Args:
            listener: who listens.
            fail: is given its title and what it raises.
        """
        self.listener = listener
        self.title = f"listener '{listener.name}'"
        self.fail = fail
        self.inbox = Inbox(listener.size, listener.drop)
        self.thread = Thread(target=self.run, name=f"eskin {self.title}", daemon=True)

    def put(self, item: Heard) -> None:
        """Give the listener something, if it hears such."""
        if isinstance(item, self.listener.hears):
            self.inbox.put(item)

    def run(self) -> None:
        """Listen until no more will come."""
        try:
            while (item := self.inbox.take()) is not None:
                self.listener.hear(item)
        except BaseException as error:
            self.fail(self.title, error)
