"""Publishers on ROS 2 that wait for their subscribers."""

from eskin.drivers import HostClock

PATIENCE = 30.0
"""Longest time that anything is waited for [s]."""


def wait_until(condition):
    clock = HostClock()
    end = clock.now() + round(PATIENCE * 1e9)
    while not condition():
        assert clock.now() < end
        clock.sleep(0.02)


def start_when_heard(start, bus, topics):
    """Wait, after the start of a publisher, until some topics are subscribed to."""

    def start_and_wait(context):
        start(context)
        wait_until(lambda: all(bus.wants(topic) for topic in topics))

    return start_and_wait
