"""This module reads shear modules that a server sends as JSON over a WebSocket.

The messages are those of the server of XELA Robotics' modules:

    {"message": 786, "time": 1619157045.61, "sensors": 1,
     "1": {"sensor": "1", "taxels": 16, "data": "7F3C,7B6C,8C3D,..."}}

`message` counts up, `time` is the server's [s since the epoch], and `data` holds the
counts along x, y and z of each taxel in turn, in hexadecimal. A message whose number is
a text, such as the first one, is a greeting.
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
        self.clock, self.uri = clock, uri
        self.patches = {patch.address: n for n, patch in enumerate(skin.patches)}
        self.taxels = [len(skin.find_taxels(patch.id)) for patch in skin.patches]
        self.socket: ClientConnection | None = None
        self.counts: Counter[str] = Counter()
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
                f"server is {self.uri} ({error}); allowed is HOST:PORT; correct it"
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
            number, time = message["message"], message["time"]
            if isinstance(number, str):
                return []
            if not isinstance(number, int) or not 0 <= time < 1e10:
                raise ValueError
            modules = [message[str(n)] for n in self.patches if str(n) in message]
            found = [self.parse_module(module, time) for module in modules]
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            self.counts["damaged"] += 1
            return []
        self.counts["messages"] += 1
        scan = self.server_clock.push(
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
            counts, shear = values[:, 2].copy(), values[:, :2] - SHEAR_REST
            samples.append(PatchSample(patch, scan.stamp, counts, shear))
        return samples

    def parse_module(
        self,
        module: Any,  # noqa: ANN401
        time: float,
    ) -> tuple[int, float, Int[np.ndarray, "taxel 3"]]:
        """Return patch, time and counts of a module in a message of some time [s].

        Raises:
            ValueError: it has not three numbers of 16 bits for each taxel of its patch.
            KeyError: it lacks what is needed.
        """
        patch = self.patches[int(module["sensor"])]
        values = [int(word, 16) for word in module["data"].split(",")]
        if len(values) != 3 * self.taxels[patch] or not all(
            0 <= value < 1 << 16 for value in values
        ):
            raise ValueError
        taken = float(module.get("time", time))
        return patch, taken, np.array(values, np.int32).reshape(-1, 3)

    def disconnect(self) -> None:
        """Close the connection."""
        socket, self.socket = self.socket, None
        if socket is not None:
            socket.close()

    def counters(self) -> dict[str, int]:
        """Return bytes, messages, and samples by what became of them."""
        return {"bytes": 0, **self.counts}
