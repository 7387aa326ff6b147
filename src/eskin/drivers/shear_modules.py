"""This module reads shear modules that a server sends as JSON over a WebSocket.

The messages come from the server of XELA Robotics' modules:

    {"message": 786, "time": 1619157045.61, "sensors": 1,
     "1": {"sensor": "1", "taxels": 16, "data": "7F3C,7B6C,8C3D,..."}}

`message` counts up, `time` is the server's [s since the epoch], and `data` holds the
counts along x, y and z of each taxel in turn, as a text of hexadecimal numbers or a
list of numbers. A message whose number is a text without digits, such as the first one,
is a greeting.
"""

import json
import zlib
from collections import Counter
from typing import Any, final

import numpy as np
from jaxtyping import Int
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidURI
from websockets.sync.client import ClientConnection, connect

from eskin.drivers.clock import Clock
from eskin.drivers.clock_sync import DeviceClock
from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN
from eskin.drivers.sampled_source import PatchSample, SampleDevice
from eskin.errors import DeviceError
from eskin.skin import Skin

CONNECT_SECONDS = 1.0
"""Longest time to wait for the server [s]."""
MAX_MESSAGE_BYTES = 1 << 20
"""Longest message."""
MAX_DIGITS = 4
"""Largest number of hexadecimal digits of a count; those of a text that have more are
decimal."""
MAX_SHOWN = 48
"""Number of characters of a message that is not read which are shown."""
SHEAR_REST = 1 << 15
"""Count of an axis without shear, which becomes 0."""
US_PER_S = 1_000_000


@final
class ShearModules(SampleDevice):
    """Reads the modules of one server; module n is the skin's patch of address n."""

    def __init__(self, clock: Clock, uri: str, skin: Skin) -> None:
        """Name the server.

        Args:
            clock: clock that stamps arrivals.
            uri: address of the server, `ws://HOST:PORT`.
            skin: skin whose patches the modules are.
        """
        self.clock = clock
        self.uri = uri
        self.patches = {patch.address: n for n, patch in enumerate(skin.patches)}
        self.taxels = [len(skin.find_taxels(patch.id)) for patch in skin.patches]
        self.socket: ClientConnection | None = None
        self.counts: Counter[str] = Counter()
        self.refused = 0
        self.why = ""
        self.begin()

    def begin(self) -> None:
        """Start over, as with another run of the server."""
        self.server_clock = DeviceClock()
        self.times: dict[int, float] = {}

    def connect(self) -> None:
        """Connect to the server."""
        try:
            self.socket = connect(
                self.uri,
                open_timeout=CONNECT_SECONDS,
                close_timeout=CONNECT_SECONDS,
                max_size=MAX_MESSAGE_BYTES,
                compression=None,
                proxy=None,
            )
        except InvalidURI as error:
            raise DeviceError(
                f"server is {self.uri} ({error}); allowed is HOST:PORT"
            ) from error
        except InvalidHandshake as error:
            raise OSError(f"it is no such server: {error}") from error
        self.begin()

    def receive(self, timeout: float) -> list[PatchSample]:
        """Return the samples of the next message."""
        assert self.socket is not None
        try:
            text = self.socket.recv(timeout=max(timeout, 0.0))
        except TimeoutError:
            return []
        except ConnectionClosed as error:
            raise OSError(f"the server has closed the connection: {error}") from error
        self.counts["bytes"] += len(text)
        return self.parse(text, self.clock.now())

    def parse(self, text: str | bytes, now: int) -> list[PatchSample]:
        """Return the samples of a message that arrived now [ns]."""
        try:
            message = json.loads(text)
            number = message["message"]
            if isinstance(number, str) and not number.strip().isdecimal():
                return []
            number = int(number) if isinstance(number, str) else number
            time = float(message["time"])
            if not isinstance(number, int) or not 0 <= time < 1e10:
                raise ValueError("its number or its time is none")
            modules = [message[str(n)] for n in self.patches if str(n) in message]
            found = [self.parse_module(module, time) for module in modules]
        except PARSE_ERRORS as error:
            self.refuse(text, error)
            return []
        self.counts["messages"] += 1
        scan = self.server_clock.find_scan_time(
            round(time * US_PER_S) % DEVICE_TIME_SPAN,
            number % SCAN_NUMBER_SPAN,
            now,
            zlib.crc32(text.encode() if isinstance(text, str) else text),
        )
        if scan is None or self.server_clock.doubt is not None:
            self.counts["late"] += len(found)
            return []
        samples = []
        for patch, taken, values in found:
            # A server that repeats a module's last data leaves its time as it was.
            if self.times.get(patch) == taken:
                self.counts["repeated"] += 1
                continue
            self.times[patch] = taken
            self.counts["samples"] += 1
            counts = values[:, 2].copy()
            shear = values[:, :2] - SHEAR_REST
            samples.append(PatchSample(patch, scan.stamp, counts, shear))
        return samples

    def refuse(self, text: str | bytes, error: Exception) -> None:
        """Note why a message is not read."""
        self.counts["damaged"] += 1
        self.refused += 1
        words = text if isinstance(text, str) else text.decode("utf-8", "replace")
        reason = " ".join(str(error).split())
        if isinstance(error, KeyError):
            reason = f"it has no {error}"
        self.why = (
            f"{ascii(words[:MAX_SHOWN])} of {self.uri}: {reason:.200}; allowed are "
            "messages of the server of XELA Robotics, with three numbers of "
            f"{MAX_DIGITS} hexadecimal digits for each taxel of a module; check the "
            "server, and the taxels of the skin"
        )

    def take_refused(self) -> tuple[int, str]:
        """Return how many messages were not read since the last call, and why."""
        count = self.refused
        self.refused = 0
        return count, self.why if count else ""

    def parse_module(
        self,
        module: Any,  # noqa: ANN401
        time: float,
    ) -> tuple[int, float, Int[np.ndarray, "taxel 3"]]:
        """Return patch, time and counts of a module in a message of some time [s].

        Raises:
            ValueError: it has not three numbers of 16 bits for each taxel of its patch.
            KeyError: it lacks an entry.
        """
        patch = self.patches[int(module["sensor"])]
        data = module["data"]
        words = data.split(",") if isinstance(data, str) else data
        values = [parse_count(word) for word in words]
        if len(values) != 3 * self.taxels[patch]:
            raise ValueError(
                f"module {module['sensor']} has {len(values)} numbers, its patch "
                f"{self.taxels[patch]} taxels"
            )
        taken = float(module.get("time", time))
        return patch, taken, np.array(values, np.int32).reshape(-1, 3)

    def disconnect(self) -> None:
        """Close the connection."""
        socket = self.socket
        self.socket = None
        if socket is not None:
            socket.close()

    def counters(self) -> dict[str, int]:
        """Return bytes, messages, and samples by what became of them."""
        return {"bytes": 0, **self.counts}


PARSE_ERRORS = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RecursionError,
    OverflowError,
)
"""Errors of a message that the server would not send."""


def parse_count(word: Any) -> int:  # noqa: ANN401
    """Return the count of a number, or of a text of hexadecimal digits.

    Raises:
        ValueError: it is none of 16 bits, or a text with more digits: a decimal number,
            of which shorter ones would be read wrongly.
    """
    if isinstance(word, str) and len(word.strip()) > MAX_DIGITS:
        raise ValueError(f"'{word.strip():.20}' may be a decimal number")
    value = int(word, 16) if isinstance(word, str) else word
    if not isinstance(value, int) or not 0 <= value < 1 << 16:
        raise ValueError(f"{word!r:.20} is no count of 16 bits")
    return value
