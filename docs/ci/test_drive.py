"""Tests of a client with pytest, with the fixtures of conftest.py.

    pytest docs/ci --scenario-tag drive
"""
import sys
from pathlib import Path

import serial

EXAMPLES = Path(__file__).parent.parent / "examples"
# By a folder on the way to the scenario; with one client for all, just its path.
CLIENTS = {"r150": "careful_client.py", "mecanum": "careful_car_client.py"}
HEARTBEAT = bytes.fromhex("AA 55 00 07 C7 84")
AHEAD = bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")


def test_a_heartbeat_is_answered(r150):
    with serial.Serial(r150.port, 115200, timeout=2) as port:
        port.write(HEARTBEAT)
        assert port.read(7).hex(" ") == "aa 55 01 07 01 c6 53"


def test_the_watchdog_stops_a_silent_client(r150):
    with serial.Serial(r150.port, 115200, timeout=2) as port:
        port.write(AHEAD)
        assert len(port.read(14)) == 14
        assert port.read(1) == b""  # two seconds of silence; the watchdog says nothing on the line
    assert "[watchdog_fired]" in r150.log()


def test_scenario(scenario, play):
    client = next(CLIENTS[part] for part in Path(scenario).parts if part in CLIENTS)
    play(scenario, sys.executable, EXAMPLES / client)
