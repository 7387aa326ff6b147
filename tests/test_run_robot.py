"""`eskin run --robot`: what is refused before anything moves."""

import pytest

from eskin.cli.run import Command, check
from eskin.errors import ArmError, DeviceError, EskinError


@pytest.mark.parametrize(
    ("more", "kind", "said"),
    [
        ({"commands": "a.yaml"}, ArmError, "--commands is given without --robot"),
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
        check(Command(**({"source": ("sim:ur5",)} | more)))
    assert isinstance(error.value, kind)


def test_other_computers_may_be_allowed_and_this_one_is():
    for source, allowed in (("udp://0.0.0.0:9750", True), ("udp://127.0.0.1:9", False)):
        check(
            Command((source,), robot="ur://127.0.0.1", allow_remote=allowed, skin="ur5")
        )
