"""Publish a stream over ROS 2 to a program that is not eskin; count what arrives.

    python -m lab.ros2

The 2112 taxels of a moving UR5, touched once in 3 s, are recognised and published with
reliable quality of service on the loopback interface; `ros2_listener` reads every
topic.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from eskin.bus import Publisher
from eskin.bus.messages import CONTACTS, DIAGNOSTICS, MARKERS, PRESSURE
from eskin.bus.ros2 import Ros2Bus, Ros2Node
from eskin.drivers import HostClock, PlayedSource, SourceInfo
from eskin.live import Recognizer, load_model, warm_up
from eskin.recording.cdr import Topic
from eskin.recording.messages import DETECTION, JOINT_STATES, READING
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.stream import Recognition, Stream, short_switch_interval
from eskin.touch import Calibration, Scan

LISTENER = Path(__file__).parent / "ros2_listener.py"
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface name="lo" multicast="true"/>'
    "</Interfaces></General></Domain></CycloneDDS>"
)
TOPICS = (
    READING,
    PRESSURE,
    CONTACTS,
    DETECTION,
    MARKERS,
    JOINT_STATES,
    DIAGNOSTICS,
)
PERIOD = 3.0
"""Time from one touch to the next [s]."""


@dataclass(frozen=True)
class Command:
    """Publish at a rate."""

    seconds: float = 60.0
    """Duration of the stream [s]."""
    rate: float = 200.0
    """Rate of the readings [1/s]."""
    domain: int = 77
    """Domain of ROS 2."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    os.environ["ROS_DOMAIN_ID"] = str(command.domain)
    measure(command)


def measure(command: Command) -> None:
    """Publish to a listener, and print what was sent and what arrived."""
    on = MountedSkin(load_skin("ur5"), load_robot("ur5"))
    calibration = Calibration.uniform(on.skin.count, 4095, 100.0)
    info = SourceInfo(
        "bench:", "ur5", on.robot.joint_names, on.skin, calibration, command.rate
    )
    recognizer = Recognizer(load_model("ur5"), on, calibration)
    warm_up(recognizer)
    recognition = Recognition(recognizer)
    bus = Ros2Bus(Ros2Node(), reliable=True)
    sent: dict[str, int] = {}
    send = bus.send

    def count(topic: Topic, stamp: int, data: bytes) -> None:
        sent[topic.name] = sent.get(topic.name, 0) + 1
        send(topic, stamp, data)

    bus.send = count
    publisher = Publisher(bus, on, recognizer.model.card.vocabulary)
    source = PlayedSource(info, scans(on, command), 1.0, HostClock(), restamp=True)
    words = [sys.executable, str(LISTENER), str(command.seconds)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as listener:
        assert listener.stdout is not None
        start = publisher.start

        def start_and_wait(context: object) -> None:
            start(context)
            while not all(bus.wants(topic) for topic in TOPICS):
                time.sleep(0.05)
            time.sleep(1.0)

        publisher.start = start_and_wait
        began = time.process_time()
        with (
            short_switch_interval(),
            Stream(source, [recognition, publisher], patience=60) as running,
        ):
            running.wait()
        spent = time.process_time() - began
        found = json.loads(listener.stdout.read().splitlines()[-1])
    print(f"{spent / command.seconds:.0%} of a core; unsent {bus.unsent}")
    print(f"queues {running.queue_counts()['ros2'].dropped} dropped")
    print("topic, sent, arrived, distinct, latency p50, p99, max [ms]")
    for topic in TOPICS:
        stamps = found["stamps"][f"rt{topic.name}"]
        late = found["latency_ms"][f"rt{topic.name}"] or [np.nan]
        p50, p99 = np.percentile(late, [50, 99])
        print(
            f"{topic.name}, {sent.get(topic.name, 0)}, {len(stamps)}, "
            f"{len(set(stamps))}, {p50:.2f}, {p99:.2f}, {max(late):.2f}"
        )


def scans(on: MountedSkin, command: Command) -> Iterator[Scan]:
    """Yield the scans of a moving arm whose forearm is poked."""
    rng, skin = np.random.default_rng(0), on.skin
    noise = rng.normal(20, 1, (997, skin.count))
    centre = int(skin.find_taxels(skin.patches[4].id)[20])
    same = skin.patch_index == skin.patch_index[centre]
    distance = np.linalg.norm(skin.positions - skin.positions[centre], axis=1)
    shape = np.where(same, np.exp(-((distance / 0.012) ** 2)), 0.0)
    received = np.ones(skin.count, bool)
    for index in range(round(command.seconds * command.rate)):
        t = index / command.rate
        press = np.sin(np.pi * np.clip((t % PERIOD - 1.5) / 0.3, 0, 1))
        counts = noise[index % len(noise)] + 1600 * press * shape
        q = 0.3 * np.sin(0.5 * t * np.arange(1, 7))
        yield Scan(round(t * 1e9), np.int32(counts), received, q)


if __name__ == "__main__":
    main()
