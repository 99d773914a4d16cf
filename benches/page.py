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
LONG_WAYS = """sim.picture.ways.forEach((way) => {
    const [x, y] = way[0];
    for (let at = 3900 - way.length; at > 0; at -= 1) way.unshift([x + 3 * Math.cos(at / 40), y + 3 * Math.sin(at / 40)]);
}); sim.picture.still.forget(); sim.picture.fit()"""
COUNT = """window.gaps = []; let last;
requestAnimationFrame(function next(now) { if (last) gaps.push(now - last); last = now; requestAnimationFrame(next); })"""


def paints(browser, folder):
    """Ten vehicles that drive, with their traffic and a chart."""
    simulator = Simulator(PROGRAM, folder / "ten", TEN)
    driver = Driver(*(simulator.folder / f"r150-{at}" for at in range(10)), back=False)
    page, _ = open_page(browser, simulator, **DESK)
    wait("they have come a way", lambda: page.evaluate("sim.picture.ways.every((way) => way.length > 50)"))
    for what, before in [("with short ways", ""), ("with ways of 4000 points", LONG_WAYS)]:
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
    """A client that asks as soon as it is answered: without --control, and with a page open, in turns."""
    rig = 'schema = 1\n[[device]]\nkind = "r150"\nport = "r150"\n'
    simulator = Simulator(PROGRAM, folder / "one", rig, *INSTANT)
    plain = folder / "r150"
    command = [PROGRAM, "--pty", plain, "--seed", "1", *INSTANT]
    without = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    wait("it is ready", plain.exists)
    medians, tails = [], []
    for _ in range(1 if QUICK else 10):
        own = latencies(plain)
        page, _ = open_page(browser, simulator, **DESK)
        other = latencies(simulator.folder / "r150")
        page.context.close()
        medians.append((own[0], other[0]))
        tails.append((own[1], other[1]))
    for what, pairs in [("median", medians), ("99th percentile", tails)]:
        ratios = sorted(other / own for own, other in pairs)
        own, other = (statistics.median(figures) * 1e6 for figures in zip(*pairs))
        spread = f"{ratios[0]:.2f} to {ratios[-1]:.2f}"
        print(f"request to reply, {what}: {own:.0f} µs without, {other:.0f} µs with a page, ratio "
              f"{statistics.median(ratios):.2f} ({spread})")
    without.terminate()
    without.wait()
    simulator.stop()


def latencies(path):
    """Median and 99th percentile of heartbeats while the vehicle drives, s."""
    heartbeat, drive = frame(0x07), bytes.fromhex("AA 55 04 12 F4 01 F4 01 45 38")
    file = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(file)
    taken = []
    for count in range(50 if QUICK else 20000):
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
