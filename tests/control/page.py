"""The page in headless Chromium: looks, presses, and compares with the simulator and its trace.

    python3 tests/control/page.py SIM FOLDER

Needs `pip install playwright` and a Chromium of the system. Pictures are left in FOLDER;
`page-desk-light.png` is `docs/pictures/page.png`.
"""

import atexit
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

SIM, FOLDER = str(Path(sys.argv[1]).absolute()), Path(sys.argv[2]).absolute()
ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from browser import SCHEMES, VIEWS, launch, overflow
# Spent only on failure, since the machine may be busy.
PATIENCE = 120
HOSTILE = "<img src=x onerror=\"document.title='run'\">"
RIG = f"""
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
TEN = "schema = 1\n" + "".join(
    f'[[device]]\nkind = "mecanum"\nname = "car-{at}"\nport = "car-{at}"\n'
    f'pose = {{ x = "{at % 5 * 2} m", y = "{at // 5 * 2} m" }}\n'
    for at in range(10)
)


def frame(command, parameters=b""):
    crc = 0xFFFF
    for byte in bytes([command]) + parameters:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return b"\xAA\x55" + bytes([len(parameters), command]) + parameters + struct.pack("<H", crc ^ 0xFFFF)


class Simulator:
    """A simulator of a rig, which ends well and whose recording is the same again."""

    def __init__(self, name, rig):
        self.folder = FOLDER / name
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True, mode=0o700)
        (self.folder / "rig.toml").write_text(rig)
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder)}
        self.environment.pop("SIM_CONTROL", None)
        self.trace, ready = self.folder / "trace.jsonl", self.folder / "ready"
        command = [SIM, "--rig", self.folder / "rig.toml", "--control", "127.0.0.1:0", "--seed", "1"]
        command += ["--ready-file", ready, "--trace", self.trace]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=self.environment)
        atexit.register(self.process.kill)
        wait("the simulator is ready", ready.exists)

    def ctl(self, *arguments):
        command = [SIM, "ctl", *arguments]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (arguments, done)
        return done.stdout.strip()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(PATIENCE) == 0
        subprocess.run([SIM, "replay", self.trace], check=True, stdout=subprocess.DEVNULL)
        return [json.loads(line) for line in self.trace.read_text().splitlines()]


class Driver(threading.Thread):
    """A client that drives the R150 to and fro, whatever happens."""

    def __init__(self, path):
        super().__init__(daemon=True)
        self.file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.done = threading.Event()

    def run(self):
        begun = time.monotonic()
        while not self.done.wait(0.1):
            ahead = 1 if (time.monotonic() - begun) % 8 < 4 else -1
            os.write(self.file, frame(0x12, struct.pack("<hh", ahead * 330, ahead * 250)))
            try:
                os.read(self.file, 1000)
            except BlockingIOError:
                pass


def wait(what, done):
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, f"in vain waited until {what}"
        time.sleep(0.05)


def open_page(browser, url, **options):
    page = browser.new_context(**options).new_page()
    page.set_default_timeout(PATIENCE * 1000)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("dialog", lambda dialog: wrong.append(dialog.message))
    page.goto(url)
    # The page forbids what the tool would wait with.
    wait("it is drawn", lambda: page.evaluate("window.sim?.picture.frames > 2 && sim.charts.names.length > 0"))
    return page, wrong


def looks(browser, simulator):
    """Dark and light, on a desk and on a phone."""
    colours = set()
    for scheme in SCHEMES:
        for name, options in VIEWS.items():
            page, wrong = open_page(browser, simulator.ctl("url"), color_scheme=scheme, **options)
            # The token is not left where it is seen.
            assert "token" not in page.url, page.url
            wait("the way is drawn", lambda page=page: page.evaluate("sim.picture.ways[0]?.length > 10"))
            wait("a chart is drawn", lambda page=page: page.evaluate("[...sim.charts.charts.values()][0].points.length > 60"))
            page.screenshot(path=str(FOLDER / f"page-{name}-{scheme}.png"))
            colours.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            assert overflow(page) <= 0, (name, overflow(page))
            # Something is drawn: more than one colour.
            assert page.evaluate(
                "(() => { const c = document.getElementById('picture'); const d = c.getContext('2d')"
                ".getImageData(0, 0, c.width, c.height).data; const seen = new Set();"
                "for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);"
                "return seen.size > 5; })()"
            )
            assert not wrong, wrong
            page.context.close()
    assert len(colours) == 2, colours


def presses(browser, simulator):
    """What is pressed happens, and what happens is seen."""
    page, wrong = open_page(browser, simulator.ctl("url"), viewport={"width": 1280, "height": 900})
    # The traffic as it flows.
    page.wait_for_selector("#lines li.request:has-text('set_motors')")
    # The emergency stop stops a driving vehicle.
    simulator.ctl("until", "r150.truth.speed_mps > 0.1", "--within", "60s")
    page.get_by_role("button", name="emergency stop", exact=True).click()
    simulator.ctl("until", "r150.truth.at_rest", "--within", "60s")
    page.wait_for_selector("#lines li:has-text('emergency stop pushed in')")
    page.get_by_role("button", name="emergency stop off", exact=True).click()
    # A fault, with a parameter and a time.
    page.locator("#side > details:has(#find) > summary").click()
    page.fill("#find", "bit-flips")
    fault = page.locator("#faults > details:visible")
    assert fault.count() == 1
    fault.locator("summary").click()
    fault.get_by_label("probability").fill("0.01")
    fault.get_by_label("for", exact=True).fill("100 ms")
    fault.get_by_role("button", name="Break it").click()
    page.wait_for_selector("#steps li:has-text('bit-flips')")
    # One that makes no sense is refused beside it.
    fault.get_by_label("probability").fill("7")
    fault.get_by_role("button", name="Break it").click()
    page.wait_for_selector("#faults .problem:has-text('probability')")
    # Another device has forms of its own.
    page.get_by_role("tab", name="car").click()
    page.fill("#find", "supply-lost")
    assert page.locator("#faults > details:visible").count() == 1
    page.fill("#find", "rail-short")
    assert page.locator("#faults > details:visible").count() == 0
    page.get_by_role("tab", name="r150").click()
    # Any name as a chart.
    page.fill("#name", "car.truth.x_m")
    page.keyboard.press("Enter")
    page.wait_for_selector("#charts b:has-text('car.truth.x_m')")
    wait("values come", lambda: "m" in page.locator("#charts output").last.inner_text())
    # Keys: space, a dot, and those of the map.
    page.locator("#picture").focus()
    page.keyboard.press("Space")
    wait("it stands still", lambda: json.loads(simulator.ctl("state"))["paused"])
    before = json.loads(simulator.ctl("state"))["t"]
    page.keyboard.press(".")
    wait("it has stepped", lambda: abs(json.loads(simulator.ctl("state"))["t"] - before - 0.05) < 1e-6)
    scale = page.evaluate("sim.picture.scale")
    page.keyboard.press("+")
    assert page.evaluate("sim.picture.scale") > scale
    page.keyboard.press("0")
    page.select_option("#speed", "2")
    wait("it is faster", lambda: json.loads(simulator.ctl("state"))["speed"] == 2)
    page.keyboard.press("Tab")
    page.locator("#picture").focus()
    page.keyboard.press("Space")
    wait("it goes on", lambda: not json.loads(simulator.ctl("state"))["paused"])
    # Names and messages are never run as HTML.
    for step in [
        {"name": HOSTILE, "fault": {"kind": "mute", "direction": "to-client"}, "for": "50 ms"},
        {"name": "<script>document.title='run'</script>", "expect": {"that": "false", "within": "200 ms", "message": HOSTILE}},
    ]:
        simulator.ctl("--device", "r150", "step", json.dumps(step))
    page.wait_for_selector("#steps li.failed")
    assert HOSTILE in page.locator("#steps").inner_text()
    assert page.locator("#side img, #log img, #side script").count() == 0
    assert page.title() != "run"
    assert not wrong, wrong
    page.context.close()


def paints(browser):
    """Ten vehicles: how many pictures a second there are."""
    simulator = Simulator("ten", TEN)
    page, _ = open_page(browser, simulator.ctl("url"), viewport={"width": 1280, "height": 800})
    count = lambda: page.evaluate("[sim.picture.frames, performance.now()]")
    first = count()
    time.sleep(3)
    last = count()
    rate = (last[0] - first[0]) / (last[1] - first[1]) * 1000
    page.context.close()
    simulator.stop()
    print(f"the page painted ten vehicles {rate:.0f} times a second")
    assert rate > 0


def main():
    with sync_playwright() as play:
        browser = launch(play)
        simulator = Simulator("two", RIG)
        driver = Driver(simulator.folder / "r150")
        driver.start()
        simulator.ctl("until", "r150.truth.distance_m > 0.5", "--within", "60s")
        looks(browser, simulator)
        presses(browser, simulator)
        driver.done.set()
        trace = simulator.stop()
        added = [line["text"] for line in trace if line["kind"] == "add"]
        assert any("bit-flips" in text and "100 ms" in text for text in added), added
        assert any(line["kind"] == "event" and "emergency stop" in line["text"] for line in trace)
        paints(browser)
        browser.close()


main()
