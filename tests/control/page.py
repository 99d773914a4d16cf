"""The page in headless Chromium: looks, presses, and compares with the simulator and its trace.

    python3 tests/control/page.py SIM FOLDER

Pictures are left in FOLDER.
"""

import json
import sys
from pathlib import Path

from with_page import YARD, Driver, Simulator, chromium, open_page, wait

from browser import SCHEMES, VIEWS, overflow

HOSTILE = "<img src=x onerror=\"document.title='run'\">"


def looks(browser, simulator, folder):
    """Dark and light, on a desk and on a phone."""
    colours = set()
    for scheme in SCHEMES:
        for name, options in VIEWS.items():
            page, wrong = open_page(browser, simulator, color_scheme=scheme, **options)
            # The token is not left where it is seen.
            assert "token" not in page.url, page.url
            wait("the way is drawn", lambda page=page: page.evaluate("sim.picture.ways[0]?.length > 10"))
            wait("a chart is drawn", lambda page=page: page.evaluate("[...sim.charts.charts.values()][0].points.length > 60"))
            page.screenshot(path=folder / f"page-{name}-{scheme}.png")
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
    page, wrong = open_page(browser, simulator, viewport={"width": 1280, "height": 900})
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


def main(program, folder):
    simulator = Simulator(program, folder / "two", YARD)
    driver = Driver(simulator.folder / "r150")
    simulator.ctl("until", "r150.truth.distance_m > 0.5", "--within", "60s")
    with chromium() as browser:
        looks(browser, simulator, folder)
        presses(browser, simulator)
        driver.done.set()
        page, wrong = open_page(browser, simulator)
        trace = simulator.stop()
        wait("its end is told", lambda: "a new one prints a new URL" in page.inner_text("#state"))
        assert not wrong, wrong
    added = [line["text"] for line in trace if line["kind"] == "add"]
    assert any("bit-flips" in text and "100 ms" in text for text in added), added
    assert any(line["kind"] == "event" and "emergency stop" in line["text"] for line in trace)


main(str(Path(sys.argv[1]).absolute()), Path(sys.argv[2]))
