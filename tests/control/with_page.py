"""A simulator and its page in headless Chromium, as tests, benchmarks and pictures need them.

Needs `pip install playwright` and a Chromium of the system.
"""

import atexit
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from browser import launch

# Spent only on failure, since the machine may be busy.
PATIENCE = 120
YARD = f"""
schema = 1
world = "{ROOT}/worlds/yard.toml"
[[device]]
kind = "r150"
port = "r150"
[[device]]
kind = "mecanum"
name = "car"
port = "car"
pose = {{ x = "-0.5 m", y = "1.6 m", heading = "40 deg" }}
"""


def frame(command, parameters=b""):
    crc = 0xFFFF
    for byte in bytes([command]) + parameters:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return b"\xAA\x55" + bytes([len(parameters), command]) + parameters + struct.pack("<H", crc ^ 0xFFFF)


class Simulator:
    """A simulator of a rig, which ends well and whose recording is the same again."""

    def __init__(self, program, folder, rig, *arguments, flag="--rig"):
        self.program, self.folder = program, folder.absolute()
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True, mode=0o700)
        (self.folder / "rig.toml").write_text(rig)
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder)}
        self.environment.pop("SIM_CONTROL", None)
        self.trace, ready = self.folder / "trace.jsonl", self.folder / "ready"
        command = [program, flag, self.folder / "rig.toml", "--control", "127.0.0.1:0", "--seed", "1"]
        command += ["--ready-file", ready, "--trace", self.trace, *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=self.environment)
        atexit.register(self.process.kill)
        wait("the simulator is ready or has ended", lambda: ready.exists() or self.process.poll() is not None)
        assert ready.exists(), "the simulator has ended"

    def ctl(self, *arguments):
        command = [self.program, "ctl", *arguments]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (arguments, done)
        return done.stdout.strip()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(PATIENCE) == 0
        subprocess.run([self.program, "replay", self.trace], check=True, stdout=subprocess.DEVNULL)
        return [json.loads(line) for line in self.trace.read_text().splitlines()]


class Driver(threading.Thread):
    """A client that drives R150s along arcs, whatever happens: to and fro, or ahead alone."""

    def __init__(self, *paths, back=True):
        super().__init__(daemon=True)
        self.files = [os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for path in paths]
        self.back = back
        self.done = threading.Event()
        self.start()

    def run(self):
        begun = time.monotonic()
        while not self.done.wait(0.1):
            ahead = -1 if self.back and (time.monotonic() - begun) % 8 > 4 else 1
            for file in self.files:
                os.write(file, frame(0x12, struct.pack("<hh", ahead * 330, ahead * 250)))
                try:
                    os.read(file, 1000)
                except BlockingIOError:
                    pass


def wait(what, done):
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, f"in vain waited until {what}"
        time.sleep(0.05)


@contextmanager
def chromium():
    with sync_playwright() as play:
        yield launch(play)


def from_folder(context):
    """The files of the page as they are in the folder, for work on them without builds."""
    def answer(route):
        file = ROOT / "control/page" / (route.request.url.split("/")[-1] or "index.html")
        answered = route.fetch()
        kind = {".js": "text/javascript", ".css": "text/css", ".html": "text/html"}[file.suffix]
        headers = {**answered.headers, "content-type": kind}
        route.fulfill(status=200, headers=headers, body=file.read_text())

    context.route(re.compile(r":\d+/([a-z]+\.(js|css))?$"), answer)


def open_page(browser, simulator, **options):
    """The page when it is drawn, and a list of what goes wrong on it."""
    context = browser.new_context(**options)
    if "SIM_PAGE_FROM_FOLDER" in os.environ:
        from_folder(context)
    page = context.new_page()
    page.set_default_timeout(PATIENCE * 1000)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("dialog", lambda dialog: wrong.append(dialog.message))
    page.goto(simulator.ctl("url"))
    # The page forbids what the tool would wait with.
    wait("it is drawn", lambda: page.evaluate("window.sim?.picture.frames > 2 && sim.charts.names.length > 0"))
    return page, wrong
