"""Keywords for a simulated vehicle."""

import rigsim
from robot.api.deco import keyword, library


@library(scope="TEST")
class Vehicle:
    @keyword
    def start_vehicle(self, device="r150", **options):
        """Gives the path of its port; under ``sim run`` it is that of the vehicle which plays this test."""
        self.simulator = rigsim.connect() if rigsim.joinable() else rigsim.start(device, **options)
        return self.simulator.port

    @keyword
    def end_vehicle(self):
        self.simulator.clear()
        self.simulator.close()

    @keyword
    def until(self, condition, within="5 s"):
        """Waits for a condition, in simulated time."""
        self.simulator.until(condition, within)

    @keyword
    def fault(self, kind, lasts=None, **parameters):
        self.simulator.fault(kind, lasts, **parameters)

    @keyword
    def operator(self, action, value=None):
        self.simulator.operator(action, value)

    @keyword
    def client_report_should_be_empty(self):
        assert not self.simulator.report, self.simulator.report
