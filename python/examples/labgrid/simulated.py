"""A vehicle that is switched on and off as one in the lab."""

from urllib.parse import urlsplit

import attr
import rigsim
from labgrid import target_factory
from labgrid.strategy import Strategy


@target_factory.reg_driver
@attr.s(eq=False)
class SimulatedR150(Strategy):
    bindings = {"serial": "SerialDriver"}
    simulator = attr.ib(default=None)

    def transition(self, state):
        if state == "on" and self.simulator is None:
            self.simulator = rigsim.start("r150", listen="rfc2217://127.0.0.1:0")
            self.serial.port.port = urlsplit(self.simulator.port).port
            self.target.activate(self.serial)
        elif state == "off" and self.simulator is not None:
            self.target.deactivate(self.serial)
            self.simulator.close()
            self.simulator = None
