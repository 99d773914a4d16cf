"""pytest --lg-env vehicle.yaml"""

import pytest
from pexpect import TIMEOUT

HEARTBEAT = bytes.fromhex("AA 55 00 07 C7 84")
AHEAD = bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")


@pytest.fixture
def vehicle(strategy):
    strategy.transition("on")
    yield strategy.simulator
    strategy.transition("off")


@pytest.fixture
def serial(vehicle, target):
    return target.get_driver("ConsoleProtocol")


def test_stops_without_commands(vehicle, serial):
    serial.write(AHEAD)
    vehicle.until("truth.distance_m > 0.02", within="10 s")
    vehicle.until("truth.at_rest && firmware.motor_left == 0", within="10 s")


def test_a_dead_line_is_noticed(vehicle, serial):
    with vehicle.fault("mute", direction="to-client"):
        serial.write(HEARTBEAT)
        with pytest.raises(TIMEOUT):
            serial.read(7, timeout=1)
    serial.write(HEARTBEAT)
    assert serial.read(7, timeout=60)[3] == HEARTBEAT[3]
