"""A folder with a robot and a skin of one's own, and a device that stands in for it."""

import csv
import json
from contextlib import contextmanager
from importlib import resources
from shutil import copytree
from threading import Thread

import numpy as np

from eskin.app import nominal_calibration
from eskin.cli.main import run
from eskin.drivers import HostClock, read_key
from eskin.recording import Label, Metadata, RecordingWriter
from eskin.sim.virtual import PtyPort, UdpPort, VirtualSkin
from eskin.skin import load_skin, mount_skin
from eskin.skin.wiring import choose_press_targets
from eskin.touch import Scan
from eskin.units import NS_PER_S

ARM = """\
<robot name="arm">
  <link name="upper_arm">
    <collision>
      <origin xyz="0 0 0.2"/>
      <geometry><cylinder radius="0.045" length="0.4"/></geometry>
    </collision>
  </link>
  <joint name="elbow" type="revolute">
    <origin xyz="0 -0.1 0.4"/>
    <parent link="upper_arm"/>
    <child link="forearm"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="30" velocity="1"/>
  </joint>
  <link name="forearm">
    <collision>
      <origin xyz="0 0 0.15"/>
      <geometry><cylinder radius="0.045" length="0.3"/></geometry>
    </collision>
  </link>
</robot>
"""
RATE = 50.0
"""Scans a second."""
REST = 50
"""Counts of a taxel that nothing presses."""
NEWTONS = 4.0
"""Force of a press [N]."""
WIDTH = 0.005
"""Standard deviation of the place of its pressure [m]."""


def make_press(skin, taxel, seconds=1.0):
    """Return the counts of a press on a taxel and of rest after it, a row a scan."""
    calibration = nominal_calibration(skin)
    distances = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
    spread = np.exp(-0.5 * (distances / WIDTH) ** 2)
    kpa = NEWTONS * spread / (spread @ skin.areas) / 1000
    pressed = REST + calibration.compute_counts(kpa)
    rows = [pressed] * round(seconds * RATE)
    return [*rows, *[np.full(skin.count, REST)] * round(RATE)]


def make_scans(skin, rows, joints=0, seed=0):
    """Yield scans of counts with a little noise."""
    rng = np.random.default_rng(seed)
    received = np.ones(skin.count, bool)
    q = np.zeros(joints)
    for number, row in enumerate(rows, 1):
        counts = np.round(row + rng.normal(0, 0.6, skin.count)).astype(np.int32)
        yield Scan(round(number * 1e9 / RATE), np.maximum(counts, 0), received, q)


def find_presses(skin, words):
    """Return the rows of the presses that a command asks for, in its order."""
    middle = int(np.argmin(np.hypot(skin.rows - 8, skin.columns - 8)))
    taxels = [middle] * 5
    if "check" in words:
        taxels = [target.taxel for target in choose_press_targets(skin)]
    elif "pose" in words:
        path = words[words.index("--points") + 1]
        with open(path, encoding="utf-8", newline="") as file:
            places = [(int(r["row"]), int(r["column"])) for r in csv.DictReader(file)]
        cells = list(zip(skin.rows.tolist(), skin.columns.tolist(), strict=True))
        taxels = [cells.index(place) for place in places]
    elif "record" in words:
        taxels = [middle] * 30
    return [row for taxel in taxels for row in make_press(skin, taxel)]


def open_workshop(folder):
    """Make what the commands of the documentation name, in the working folder."""
    (folder / "arm.urdf").write_text(ARM)
    place = "skin place arm.urdf --link forearm --rows 16 --columns 16 --pitch-mm 6"
    call(f"{place} --out my_skin")
    # The names that the pages use for other robots, skins and recordings.
    (folder / "panda.urdf").write_text(ARM)
    for name in ("FOLDER", "arm_skin"):
        copytree(folder / "my_skin", folder / name)
    call("skin convert my_skin hand.urdf")
    call("skin convert my_skin iCub --to icub")
    (folder / "iCub" / "forearm.txt").rename(folder / "left_leg_lower.txt")
    call("skin convert my_skin skin.csv")
    call("skin points my_skin --out points.csv")
    write_recording(folder / "bob.mcap")
    weights = resources.files("eskin.live") / "presets" / "ur5.safetensors"
    (folder / "mine.safetensors").write_bytes(weights.read_bytes())
    spec = "regions: [{link: forearm, density_per_cm2: 1}]\n"
    (folder / "spec.yaml").write_text(spec)
    (folder / "skin.key").write_text(f"{'0123456789abcdef' * 4}\n")
    (folder / "skin.key").chmod(0o600)


def call(line):
    """Run a command that must succeed."""
    assert run(line.split()) == 0, line


def write_recording(path):
    """Write a recording of three labelled presses on `my_skin`."""
    mounted = mount_skin(path.parent / "my_skin")
    skin = mounted.skin
    robot = mounted.robot
    press = make_press(skin, 136)
    rows = [np.full(skin.count, REST)] * round(6 * RATE) + press * 3
    metadata = Metadata("own", "bob", "one")
    calibration = nominal_calibration(skin)
    with RecordingWriter(
        path, robot.name, skin, calibration, metadata, urdf=robot.urdf
    ) as writer:
        for scan in make_scans(skin, rows, len(robot.joint_names)):
            writer.write(scan)
        for number in range(3):
            start = (6 + 2 * number) * NS_PER_S
            writer.write_label(Label(start, start + NS_PER_S, "poke"))


@contextmanager
def stand_in(folder, words):
    """Send the presses that a command asks for, and yield its words with the ports.

    Rest is sent until the ports are opened and for 6 s more, then the presses, then
    rest. Words `serial:PATH`, `csv:PATH` and `udp://HOST:PORT` name the device.
    """
    kinds = [word.partition(":")[0] for word in words if ":" in word]
    kind = next((each for each in kinds if each in ("serial", "csv", "udp")), None)
    if kind is None:
        yield words
        return
    name = words[words.index("--skin") + 1] if "--skin" in words else words[2]
    skin = load_skin(str(folder / name) if (folder / name).is_dir() else name)
    key = read_key(folder / "skin.key") if "--key" in words else None
    port = make_port(words) if kind == "udp" else PtyPort()
    device = VirtualSkin(skin, [port], RATE, key=key)
    stopped = []

    def play_rows():
        is_open = False
        while not is_open and not stopped:
            is_open = kind == "udp" or port.has_receiver()
            yield np.full(skin.count, REST)
        yield from [np.full(skin.count, REST)] * round(6 * RATE)
        yield from find_presses(skin, words) if len(skin.patches) == 1 else ()
        while not stopped:
            yield np.full(skin.count, REST)

    def send():
        scans = make_scans(skin, play_rows())
        if kind == "csv":
            return send_lines(port, scans, stopped)
        return device.play(scans, HostClock())

    thread = Thread(target=send, daemon=True)
    thread.start()
    at = port.uri if kind != "csv" else f"csv:{port.path}"
    places = [word.partition(":")[0] == kind for word in words]
    try:
        yield [
            at if is_place else word
            for word, is_place in zip(words, places, strict=True)
        ]
    finally:
        stopped.append(True)
        device.stop()
        thread.join()
        port.close()


def make_port(words):
    """Return a port that sends to the `udp:` of a command."""
    host, _, number = next(w for w in words if w.startswith("udp"))[6:].rpartition(":")
    return UdpPort(host, int(number))


def send_lines(port, scans, stopped):
    """Send scans as lines of numbers, each at its time."""
    clock = HostClock()
    start = clock.now()
    for scan in scans:
        if stopped:
            return
        clock.sleep(max(start + scan.stamp - clock.now(), 0) / NS_PER_S)
        port.send([json.dumps(scan.counts.tolist()).encode() + b"\n"])
