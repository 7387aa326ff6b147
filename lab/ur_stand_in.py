"""Simulate a UR controller on loopback: RTDE, dashboard and script ports.

It moves within the limits of a UR5, stops as a UR does, and faults can be injected. Its
protocol was derived from the client that it serves.
"""

import asyncio
import logging
import os
import struct
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, final

import numpy as np

from eskin.progress import Closing

Reader = asyncio.StreamReader
Writer = asyncio.StreamWriter

PORTS = {"rtde": 30004, "dashboard": 29999, "script": 30003}
TICK = 0.008
"""Period of a UR5's controller [s]."""
SPEED = 3.15
"""Greatest speed of a joint [rad/s]."""
ACCELERATION = 40.0
"""Greatest acceleration of a joint [rad/s2]."""
LOOKAHEAD = 0.05
"""Time by which a joint lags behind its target [s]."""
SHAPES = {
    "DOUBLE": "d",
    "VECTOR6D": "6d",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "UINT8": "B",
    "BOOL": "?",
    "VECTOR6INT32": "6i",
    "VECTOR3D": "3d",
}
TYPES = {
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "speed_slider_mask": "UINT32",
    "joint_mode": "VECTOR6INT32",
    "payload_cog": "VECTOR3D",
    "actual_digital_input_bits": "UINT64",
    "actual_digital_output_bits": "UINT64",
}
VECTORS = ("_q", "_qd", "_qdd", "_current", "_moment", "TCP", "torque", "temperatures")
SERVO = 11
SERVO_STOP = 16
WATCHDOG = 35
STOP_SCRIPT = 255
NOTHING = 0


def get_type(name: str) -> str:
    """Return the RTDE type of a variable."""
    if name in TYPES:
        return TYPES[name]
    if "bit_register" in name and "registers" not in name:
        return "BOOL"
    if "registers" in name:
        return "UINT32"
    if "int_register" in name:
        return "INT32"
    if name.endswith(("_mask", "_output", "analog_output_type")):
        return "UINT8"
    return "VECTOR6D" if any(part in name for part in VECTORS) else "DOUBLE"


@dataclass
class Controller:
    """Holds the state of the controller, and moves the joints."""

    q: np.ndarray
    qd: np.ndarray = field(default_factory=lambda: np.zeros(6))
    time: float = 0.0
    slider: float = 1.0
    """Speed slider, of the teach pendant or set by RTDE, as a share."""
    running: bool = False
    protective: bool = False
    emergency: bool = False
    ready: int = 1
    outputs: int = 0
    servo: np.ndarray | None = None
    watchdog: float = 0.0
    """Longest silence of the client [s]; 0 for no limit."""
    last_message: float = 0.0
    """Time of the last message of the client [s]."""
    inputs: dict[str, float] = field(default_factory=dict)
    commands: list[int] = field(default_factory=list)

    def step(self) -> None:
        """Advance by one tick."""
        self.time += TICK
        if self.watchdog and self.time - self.last_message > self.watchdog:
            self.end_program()
        free = self.running and not self.protective and not self.emergency
        if not free:
            self.servo = None
        target = self.q if self.servo is None else self.servo
        wanted = np.clip((target - self.q) / LOOKAHEAD, -SPEED, SPEED) * self.slider
        change = ACCELERATION * TICK
        self.qd += np.clip(wanted - self.qd, -change, change)
        self.q = self.q + self.qd * TICK

    def end_program(self) -> None:
        """Stop the program, and with it the arm."""
        self.running = False
        self.servo = None
        self.watchdog = 0.0
        self.ready = 1

    def take(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Store the inputs of a client."""
        self.last_message = self.time
        self.inputs.update(zip(names, values, strict=True))
        if self.inputs.pop("speed_slider_mask", 0):
            self.slider = float(self.inputs["speed_slider_fraction"])
        if mask := int(self.inputs.pop("standard_digital_output_mask", 0)):
            bits = int(self.inputs["standard_digital_output"])
            self.outputs = (self.outputs & ~mask) | (bits & mask)
        if "input_int_register_0" in names:
            self.execute(int(self.inputs["input_int_register_0"]))

    def execute(self, command: int) -> None:
        """Execute the command register of the client's program."""
        if not self.running:
            return
        if command == NOTHING:
            self.ready = 1
        elif command == SERVO:
            registers = [self.inputs[f"input_double_register_{i}"] for i in range(6)]
            self.servo = np.array(registers)
        elif command == STOP_SCRIPT:
            self.end_program()
        elif self.ready == 1:
            self.commands.append(command)

            if command == SERVO_STOP:
                self.servo = None
            elif command == WATCHDOG:
                rate = self.inputs["input_double_register_0"]
                self.watchdog = 1 / rate
            self.ready = 2

    def value(self, name: str) -> object:
        """Return the value of a variable."""
        known = {
            "timestamp": self.time,
            "actual_q": self.q,
            "target_q": self.q,
            "actual_qd": self.qd,
            "target_qd": self.qd,
            "robot_mode": 7,
            "safety_mode": 3 if self.protective else 1,
            "runtime_state": 2 if self.running else 1,
            "robot_status_bits": 1 | 2 * self.running,
            "safety_status_bits": 1 | 4 * self.protective | 128 * self.emergency,
            "speed_scaling": self.slider,
            "target_speed_fraction": self.slider,
            "output_int_register_0": self.ready,
            "actual_digital_output_bits": self.outputs,
        }
        return known.get(name, 0)


def pack_values(values: Sequence[object], types: Sequence[str]) -> bytes:
    """Pack values in the format of RTDE."""
    parts = []
    for value, kind in zip(values, types, strict=True):
        shape = SHAPES[kind]
        row = np.broadcast_to(np.asarray(value), (int(shape[:-1] or 1),)).tolist()
        parts.append(struct.pack(f">{shape}", *row))
    return b"".join(parts)


@final
class Ports:
    """Serves a controller at three ports of a host, and executes orders."""

    def __init__(self, host: str, q: Sequence[float], orders: Connection) -> None:
        """Prepare the ports; `serve` opens them."""
        self.host = host
        self.orders = orders
        self.robot = Controller(np.array(q, np.float64))
        self.writers: set[Writer] = set()
        self.mute = False
        """Whether no data passes, as with a cut cable."""

    async def serve(self) -> None:
        """Open the ports; move and execute orders until they end."""
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)
        self.loop = asyncio.get_running_loop()
        await self.open()
        moving = asyncio.create_task(self.move())
        self.orders.send(None)
        while (order := await self.next_order()) is not None:
            name, value = order
            if name == "hang_up":
                await self.shut()
            elif name == "come_back":
                await self.open()
            elif name == "mute":
                self.mute = value
            elif value is not None:
                setattr(self.robot, name, value)
            self.orders.send(getattr(self.robot, name, None))
        moving.cancel()
        await self.shut()

    async def next_order(self) -> tuple[str, Any] | None:
        """Return the next order; None at the end."""
        while not self.orders.poll():
            await asyncio.sleep(0.001)
        try:
            return self.orders.recv()
        except EOFError:
            return None

    async def open(self) -> None:
        """Listen at the three ports."""
        handlers = (self.rtde, self.dashboard, self.script)
        self.servers = [
            await asyncio.start_server(self.guarded(handler), self.host, port)
            for handler, port in zip(handlers, PORTS.values(), strict=True)
        ]

    async def shut(self) -> None:
        """Close ports and connections."""
        for server in self.servers:
            server.close()
        for writer in list(self.writers):
            writer.transport.abort()
        await asyncio.sleep(0.01)

    def guarded(
        self, handler: Callable[[Reader, Writer], Awaitable[None]]
    ) -> Callable[[Reader, Writer], Awaitable[None]]:
        """Wrap a handler so that it ends with its connection."""

        async def handle(reader: Reader, writer: Writer) -> None:
            self.writers.add(writer)
            with suppress(OSError, EOFError, asyncio.CancelledError):
                await handler(reader, writer)
            self.writers.discard(writer)
            writer.close()

        return handle

    async def move(self) -> None:
        """Step the controller on time."""
        due = self.loop.time()
        while True:
            self.robot.step()
            due += TICK
            await asyncio.sleep(max(0.0, due - self.loop.time()))

    async def dashboard(self, reader: Reader, writer: Writer) -> None:
        """Answer each line of a dashboard client with one line."""
        writer.write(b"Connected: Universal Robots Dashboard Server\n")
        answers = {
            b"polyscopeversion": b"3.15.8.106339\n",
            b"get serial number": b"2015301234\n",
            b"stop": b"Stopped\n",
        }
        while line := await reader.readline():
            word = line.strip().lower()
            if word == b"stop":
                self.robot.end_program()
            if word == b"unlock protective stop":
                self.robot.protective = False
            writer.write(answers.get(word, b"ok\n"))

    async def script(self, reader: Reader, writer: Writer) -> None:
        """Run a script as soon as its last line has arrived."""
        text = b""
        while data := await reader.read(65536):
            text += data
            if text.rstrip().endswith(b"end"):
                text = b""
                self.robot.end_program()
                self.robot.running = True

    async def rtde(self, reader: Reader, writer: Writer) -> None:
        """Speak version 2 of the protocol with one client."""
        recipes: list[list[str]] = []
        sending = None
        try:
            while True:
                size, kind = struct.unpack(">HB", await reader.readexactly(3))
                payload = await reader.readexactly(size - 3)

                if kind == ord("S"):
                    self.reply(writer, kind, b"\1")
                    sending = sending or asyncio.create_task(self.send(writer, output))
                elif kind == ord("O"):
                    output = payload[8:].decode().rstrip(",").split(",")
                    types = ",".join(map(get_type, output)).encode()
                    self.reply(writer, kind, b"\1" + types)
                elif kind == ord("I"):
                    recipes.append(payload.decode().rstrip(",").split(","))
                    types = ",".join(map(get_type, recipes[-1])).encode()
                    self.reply(writer, kind, bytes([len(recipes)]) + types)
                elif kind == ord("U"):
                    self.receive(recipes[payload[0] - 1], payload[1:])
                elif kind == ord("v"):
                    self.reply(writer, kind, struct.pack(">4I", 3, 15, 8, 106339))
                else:
                    self.reply(writer, kind, b"\1")
        finally:
            if sending is not None:
                sending.cancel()

    def receive(self, names: list[str], data: bytes) -> None:
        """Pass on inputs that have arrived, unless the connection is mute."""
        if not self.mute:
            shape = ">" + "".join(SHAPES[get_type(name)] for name in names)
            self.robot.take(names, struct.unpack(shape, data))

    async def send(self, writer: Writer, names: list[str]) -> None:
        """Send the outputs at every tick."""
        types = [get_type(name) for name in names]
        while not writer.is_closing():
            if not self.mute:
                values = [self.robot.value(name) for name in names]
                self.reply(writer, ord("U"), b"\1" + pack_values(values, types))
            await asyncio.sleep(TICK)

    def reply(self, writer: Writer, kind: int, payload: bytes) -> None:
        """Send one packet."""
        writer.write(struct.pack(">HB", 3 + len(payload), kind) + payload)


def serve(host: str, q: Sequence[float], orders: Connection) -> None:
    """Serve a controller in this process."""
    asyncio.run(Ports(host, q, orders).serve())


@final
class StandIn(Closing):
    """Runs a controller at a loopback address of its own, in a process of its own.

    The client holds the interpreter lock while it waits for an answer, so the
    controller cannot run in the same process.
    """

    def __init__(self, q: Sequence[float]) -> None:
        """Start the controller at joint positions [rad]; `with` ends it."""
        number = os.getpid() % 60_000
        self.host = f"127.7.{number // 250}.{number % 250 + 1}"
        context = get_context("spawn")
        self.orders, theirs = context.Pipe()
        values = (self.host, list(q), theirs)
        self.process = context.Process(target=serve, args=values, daemon=True)
        self.process.start()
        theirs.close()
        self.orders.recv()

    def ask(self, name: str) -> Any:  # noqa: ANN401
        """Return the value of an attribute of the controller."""
        return self.order(name, None)

    def order(self, name: str, value: object = True) -> Any:  # noqa: ANN401
        """Set an attribute of the controller, or hang up, come back or mute it."""
        self.orders.send((name, value))
        return self.orders.recv()

    def close(self) -> None:
        """End the process."""
        self.orders.close()
        self.process.join(5)
        self.process.close()
