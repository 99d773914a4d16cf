"""Fixtures for pytest: a running R150, and scenarios as test cases. Needs no plugin.

Put it beside your tests. `r150` is a simulator of its own for each test. A test with the argument
`scenario` is run once for each scenario file, and plays it with `play`.
"""
import signal
import subprocess
import time
from pathlib import Path

import pytest


def pytest_addoption(parser):
    parser.addoption("--sim", default="sim", help="the simulator; on the path unless given")
    parser.addoption("--scenarios", action="append", help="files or folders of scenarios")
    parser.addoption("--scenario-tag", help="only scenarios with this tag")


@pytest.fixture(scope="session")
def sim(pytestconfig):
    """The simulator's command."""
    return pytestconfig.getoption("--sim")


class Simulator:
    """A simulator that is being served."""

    def __init__(self, process, port, log):
        self.process = process
        self.port = str(port)
        self._log = log

    def log(self):
        """Whatever it has printed so far."""
        return self._log.read_text()


@pytest.fixture
def r150(sim, tmp_path):
    """An R150 at `r150.port`, ready to drive; with its log in the test's report."""
    port, ready, log = tmp_path / "r150", tmp_path / "ready", tmp_path / "sim.log"
    command = [sim, "--pty", port, "--ready-file", ready, "--seed", "1", "-v"]
    with log.open("w") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
    try:
        end = time.monotonic() + 30
        while not ready.exists():
            assert process.poll() is None, f"the simulator ended:\n{log.read_text()}"
            assert time.monotonic() < end, f"the simulator is not ready:\n{log.read_text()}"
            time.sleep(0.02)
        yield Simulator(process, port, log)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            code = process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        print(log.read_text())
    assert code == 0, "the simulator did not end well"


def pytest_generate_tests(metafunc):
    """A test case for each scenario file that `sim run --list` finds."""
    if "scenario" not in metafunc.fixturenames:
        return
    option = metafunc.config.getoption
    command = [option("--sim"), "run", "--list", *(option("--scenarios") or ["scenarios"])]
    if option("--scenario-tag"):
        command[3:3] = ["--tag", option("--scenario-tag")]
    listed = subprocess.run(command, capture_output=True, text=True)
    if listed.returncode != 0:
        raise pytest.UsageError(listed.stderr)
    files = [line.split(": ")[0] for line in listed.stdout.splitlines()]
    metafunc.parametrize("scenario", files, ids=[Path(file).stem for file in files])


@pytest.fixture
def play(sim, tmp_path):
    """Plays a scenario with a client and fails the test with what `sim run` says."""

    def play(scenario, *client, seed=1):
        command = [sim, "run", "--seed", str(seed), "--output", tmp_path, scenario]
        if client:
            command += ["--", *client]
        ended = subprocess.run(command, capture_output=True, text=True)
        print(ended.stdout, ended.stderr)
        if ended.returncode != 0:
            pytest.fail(ended.stdout + ended.stderr, pytrace=False)

    return play
