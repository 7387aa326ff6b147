"""The driver keeps the rules of sources; run it with pytest, the device plugged in."""

from eskin.app import SourceConfig, open_source
from eskin.drivers import check_source


def test_driver_keeps_the_rules_of_sources():
    """Give the skin of the device, and its robot where it has joints."""
    config = SourceConfig("ur5", rate=50.0)
    assert check_source(lambda: open_source("glove:left", config=config)) == []
