"""The page of --control in headless Chromium: how often it paints, and what it costs a client.

    python3 benches/page.py SIM [--test]

Needs what tests/control/with_page.py needs. `--test` goes once through everything in seconds, and means
nothing.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
import tty
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "control"))
from with_page import Driver, Simulator, chromium, frame, open_page, wait

PROGRAM, QUICK = str(Path(sys.argv[1]).absolute()), "--test" in sys.argv
DESK = {"viewport": {"width": 1280, "height": 800}}
TEN = "schema = 1\n" + "".join(
    f'[[device]]\nkind = "r150"\nname = "r150-{at}"\nport = "r150-{at}"\n'
    f'pose = {{ x = "{at % 5 * 5} m", y = "{at // 5 * 5} m" }}\n'
    for at in range(10)
)
INSTANT = ["--wire", "instant", "--set", "r150.over_rate=answer", "--set", "r150.reply_spread=0s"]
# As long as they get, and all of it to be seen.
LONG_PATHS = """sim.picture.paths.forEach((path) => {
    const [x, y] = path[0];
    for (let at = 3900 - path.length; at > 0; at -= 1) path.unshift([x + 3 * Math.cos(at / 40), y + 3 * Math.sin(at / 40)]);
}); sim.picture.still.forget(); sim.picture.fit()"""
COUNT = """window.gaps = []; let last;
requestAnimationFrame(function next(now) { if (last) gaps.push(now - last); last = now; requestAnimationFrame(next); })"""


def paints(browser, folder):
    """Ten vehicles that drive, with their traffic and a chart."""
    simulator = Simulator(PROGRAM, folder / "ten", TEN)
    driver = Driver(*(simulator.folder / f"r150-{at}" for at in range(10)), back=False)
    page, _ = open_page(browser, simulator, **DESK)
    wait("they have driven", lambda: page.evaluate("sim.picture.paths.every((path) => path.length > 50)"))
    for what, before in [("with short paths", ""), ("with paths of 4000 points", LONG_PATHS)]:
        page.evaluate(before + ";" + COUNT)
        counted = lambda: page.evaluate("[sim.picture.frames, performance.now()]")
        first = counted()
        time.sleep(0.5 if QUICK else 10)
        last = counted()
        rate = (last[0] - first[0]) / (last[1] - first[1]) * 1000
        gaps = sorted(page.evaluate("gaps"))
        longest = gaps[int(len(gaps) * 0.99)]
        print(f"ten vehicles {what}: painted {rate:.1f} times a second, 99 % at most {longest:.1f} ms apart")
    page.context.close()
    driver.done.set()
    simulator.stop()


def costs(browser, folder):
    """A client that asks as soon as it is answered: without --control, with a reader, and with a page. All
    are there all the time, so that each has the same work beside it, and are asked in turns."""
    rig = 'schema = 1\n[[device]]\nkind = "r150"\nport = "r150"\n'
    read, seen = (Simulator(PROGRAM, folder / name, rig, *INSTANT) for name in ["read", "seen"])
    plain = folder / "r150"
    without = subprocess.Popen([PROGRAM, "--pty", plain, "--seed", "1", *INSTANT], stdout=subprocess.DEVNULL)
    wait("it is ready", plain.exists)
    page, _ = open_page(browser, seen, **DESK)
    asked = {
        "without": plain,
        "with a reader of the events of the page": read.folder / "r150",
        "with the page": seen.folder / "r150",
    }
    figures = {what: [] for what in asked}
    with reading(read):
        for turn in range(2 if QUICK else 100):
            for what in list(asked)[:: 1 if turn % 2 else -1]:
                figures[what].append(latencies(asked[what]))
    for what, measured in figures.items():
        for at, which in enumerate(["median", "99th percentile"]):
            ratios = sorted(figure[at] / floor[at] for figure, floor in zip(measured, figures["without"]))
            middle = statistics.median(figure[at] for figure in measured) * 1e6
            quarter = len(ratios) // 4
            spread = f"{statistics.median(ratios):.2f} ({ratios[quarter]:.2f} to {ratios[-1 - quarter]:.2f})"
            print(f"request to reply, {which}, {what}: {middle:.0f} µs, ratio {spread}")
    page.context.close()
    without.terminate()
    without.wait()
    read.stop()
    seen.stop()


@contextmanager
def reading(simulator):
    """A client that reads all events of the page, and does nothing else."""
    address, token = simulator.ctl("url").split("/#token=")
    query = "picture=60&traffic=true&rate=20&names=truth.speed_mps"
    command = ["curl", "--silent", "--no-buffer", "--header", f"Authorization: Bearer {token}"]
    read = simulator.folder / "read"
    with read.open("wb") as out:
        reader = subprocess.Popen([*command, f"{address}/v1/events?{query}"], stdout=out)
    wait("the first event comes", lambda: read.stat().st_size > 0)
    yield
    reader.kill()
    reader.wait()


def latencies(path):
    """Median and 99th percentile of heartbeats while the vehicle drives, s."""
    heartbeat, drive = frame(0x07), bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")
    file = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(file)
    taken = []
    for count in range(50 if QUICK else 2000):
        if count % 500 == 0:
            ask(file, drive, 14)
        begun = time.perf_counter()
        ask(file, heartbeat, 7)
        taken.append(time.perf_counter() - begun)
    os.close(file)
    taken.sort()
    return taken[len(taken) // 2], taken[int(len(taken) * 0.99)]


def ask(file, request, length):
    os.write(file, request)
    while length > 0:
        length -= len(os.read(file, length))


with tempfile.TemporaryDirectory() as work, chromium() as browser:
    paints(browser, Path(work))
    costs(browser, Path(work))
