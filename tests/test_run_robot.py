"""`eskin run --robot`: what is refused, and from a touch to the arm's state."""

import json

import numpy as np
import pytest

import eskin.app
from eskin.cli.main import run
from eskin.cli.run import Command, build_listeners, check_options
from eskin.command import SimulatedArm
from eskin.drivers import ManualClock
from eskin.errors import ArmError, DeviceError, EskinError
from eskin.live import Recognizer
from eskin.recording import Metadata, RecordingWriter
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.stream import Recognition
from eskin.viewer import Viewer
from helpers.live import write_all

PAUSING = "version: 1\ncommands:\n  - gesture: poke\n    action: pause\n"
SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("more", "kind", "said"),
    [
        ({"commands": "a.yaml"}, ArmError, "--commands is given without --robot"),
        ({"port": 8081}, DeviceError, "--port is given without --view"),
        ({"robot": "sim:ur5", "q": (0.0,) * 6}, ArmError, "--q is given with --robot"),
        (
            {"robot": "ur://127.0.0.1", "source": ("udp://0.0.0.0:9750",)},
            DeviceError,
            "allow remote senders",
        ),
    ],
)
def test_what_cannot_be_meant_with_a_robot_is_refused(more, kind, said):
    with pytest.raises(EskinError, match=said) as error:
        check_options(Command(**({"source": ("sim:ur5",)} | more)))
    assert isinstance(error.value, kind)


def test_other_computers_may_be_allowed_and_this_one_is():
    for source, allowed in (("udp://0.0.0.0:9750", True), ("udp://127.0.0.1:9", False)):
        check_options(
            Command((source,), robot="ur://127.0.0.1", allow_remote=allowed, skin="ur5")
        )


@pytest.fixture
def poked(tmp_path):
    """A recording of a hand that pokes the forearm three times."""
    live = InteractiveSkin(seed=4)
    skin = live.mounted.skin
    place = skin.positions[skin.find_taxels("forearm_back")[100]].astype(float)
    scans = []
    for number in range(300):
        if number in (120, 180, 240):
            live.hand.poke(LinkPoint("forearm_link", place), 12.0, 0.3)
        scans.append(live.scan(SECOND + number * SECOND // 50, np.zeros(6)))
    path = tmp_path / "poked.mcap"
    metadata = Metadata(dataset="scene", session="one")
    with RecordingWriter(path, "ur5", skin, live.calibration, metadata) as writer:
        write_all(writer, scans, ())
    return path


def test_pokes_of_a_recording_pause_the_arm(poked, tmp_path, monkeypatch, capsys):
    arms, opened = [], eskin.app.open_arm

    def noted(*arguments, **options):
        arms.append(opened(*arguments, **options))
        return arms[-1]

    monkeypatch.setattr(eskin.app, "open_arm", noted)
    (tmp_path / "pausing.yaml").write_text(PAUSING)
    words = ["run", "--source", f"replay:{poked}", "--robot", "sim:ur5"]
    words += ["--commands", str(tmp_path / "pausing.yaml"), "--json"]
    assert run(words) == 0
    out, err = capsys.readouterr()
    told = json.loads(out.splitlines()[-1])
    (arm,) = arms
    assert err == "" and arm.state().paused
    assert told["readings"] == 300 and told["detections"] >= told["commands"] >= 1
    assert "pause            done: poke on forearm_back" in out


def test_the_page_of_a_run_shows_its_arm_and_takes_no_touches():
    recognition = Recognition(Recognizer.load("ur5"))
    arm = SimulatedArm(clock=ManualClock())
    command = Command(("sim:ur5",), view=True, port=0)
    for shown in (arm, None):
        viewer = build_listeners(command, None, recognition, shown)[-1]
        assert isinstance(viewer, Viewer) and viewer.arm is shown
        setup = viewer.setup()
        assert setup.is_arm == (shown is not None) and not setup.touchable
