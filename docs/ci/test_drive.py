"""Tests of a client with pytest, with the plugin of the wheel `rigsim`."""

import sys
from pathlib import Path

import pytest
import rigsim
import serial

ROOT = Path(__file__).parent.parent.parent
SCENARIOS = rigsim.scenarios(ROOT / "scenarios/r150/jobs", ROOT / "scenarios/mecanum/jobs", tag="drive")
# By a folder on the way to the scenario; with one client for all, just its path.
CLIENTS = {"r150": "careful_client.py", "mecanum": "careful_car_client.py"}
AHEAD = bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")


def test_the_watchdog_stops_a_silent_client(sim_r150):
    with serial.Serial(sim_r150.port, 115200) as port:
        port.write(AHEAD)
        sim_r150.until("truth.distance_m > 0.02", within="5 s")
        sim_r150.until("truth.at_rest && firmware.motor_left == 0", within="5 s")
    assert [entry["code"] for entry in sim_r150.report] == ["watchdog_fired"]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: Path(path).stem)
def test_scenario(scenario, sim_play):
    client = next(CLIENTS[part] for part in Path(scenario).parts if part in CLIENTS)
    sim_play(scenario, sys.executable, ROOT / "docs/examples" / client)
