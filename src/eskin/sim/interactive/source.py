"""This module opens a simulated person who touches a skin as a source of scans."""

from eskin.app import SourceConfig
from eskin.drivers import Clock, PlayedSource, Source, SourceInfo
from eskin.errors import DeviceError
from eskin.robot import Robot
from eskin.sim.dataset import Simulator
from eskin.sim.interactive.player import TouchPlayer


def open_simulation(skin: str, config: SourceConfig, clock: Clock) -> Source:
    """Open a simulation of a person in no training set, who touches without end.

    Args:
        skin: name of the skin.
        config: how the source is opened.
        clock: clock that stamps the scans.

    Raises:
        DeviceError: the robot of the configuration is loaded already.
    """
    robot = config.robot
    if isinstance(robot, Robot):
        raise DeviceError(
            f"source sim:{skin} is given with a robot that is loaded; allowed is its "
            "name, or the path of its URDF; give that"
        )
    simulator = Simulator(skin, robot=None if robot is None else str(robot))
    player = TouchPlayer(simulator, config.seed)
    generator = player.generator
    info = SourceInfo(
        uri=f"sim:{skin}",
        robot_name=generator.robot_name,
        joint_names=generator.mounted.robot.joint_names,
        skin=generator.mounted.skin,
        calibration=generator.calibration(player.build),
        rate=player.rate,
        urdf=generator.urdf,
    )
    return PlayedSource(info, player.scans(), config.pace, clock, restamp=True)
