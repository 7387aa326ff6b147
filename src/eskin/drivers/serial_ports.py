"""Serial ports of this computer, and whether they may be used."""

import os
from dataclasses import dataclass

from serial.tools import list_ports


@dataclass(frozen=True)
class SerialPortInfo:
    """A serial port that could carry patches."""

    path: str
    """Of its device file."""

    description: str
    """What the device says of itself."""

    usable: bool
    """Whether this user may read and write it."""


def serial_ports() -> list[SerialPortInfo]:
    """Ports with hardware behind them, by path; built-in ones without are left out."""
    return [
        SerialPortInfo(
            port.device,
            " ".join(word for word in (port.description, port.serial_number) if word),
            os.access(port.device, os.R_OK | os.W_OK),
        )
        for port in sorted(list_ports.comports())
        if port.hwid != "n/a"
    ]
