"""Virtual vehicles behind serial ports: start or find a simulator, look at it, break it, wait.

    import rigsim

    with rigsim.start("r150") as r150:
        client = MyClient(r150.port)
        r150.until("truth.speed_mps > 0.4", within="3 s")
        with r150.fault("rail-short", rail="12v-a"):
            r150.until("truth.at_rest", within="1 s")
"""

from .control import Control, ControlError, Event, NotReached, Refused
from .simulator import Device, Simulator, Step, connect, find, joinable, program, scenarios, start

__all__ = [
    "Control",
    "ControlError",
    "Device",
    "Event",
    "NotReached",
    "Refused",
    "Simulator",
    "Step",
    "connect",
    "find",
    "joinable",
    "program",
    "scenarios",
    "start",
]
