"""The page in headless Chromium: looks, presses, and compares with the simulator and its trace.

    python3 tests/control/page.py SIM FOLDER

Pictures are left in FOLDER. With SIM_PAGE_FROM_FOLDER in the environment, the files of the page are those of
control/page, whatever SIM has in it.
"""

import atexit
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

from with_page import YARD, Driver, Simulator, chromium, open_page, wait

from browser import SCHEMES, VIEWS, overflow

SCENARIO = """
schema = 1
title = "It should not drive"
good_client = "Stands still."
limit = "10 min"
device = [{ kind = "r150" }]
never = [{ that = "truth.distance_m > 0.5", message = "it drives" }]
[[step]]
name = "slow"
at = "100 ms"
fault = { kind = "dragging", motors = "left", torque = "20 N*m" }
[[step]]
name = "lock"
when = "truth.x_m > 1000"
operator = "lock"
optional = true
"""
HOSTILE = "<img src=x onerror=\"document.title='run'\">"
DESK = {"viewport": {"width": 1280, "height": 900}}
# Of text; of what is not text, as edges of controls and lines of charts.
LEAST_CONTRAST, LEAST_CONTRAST_OF_LINES = 4.5, 3
# What text is harder to read than that, with its contrast. What is disabled does not count.
FAINT = """(least) => {
    const parse = (text) => { const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number); return [r, g, b, a]; };
    const over = (top, below) => [0, 1, 2].map((at) => top[at] * top[3] + below[at] * (1 - top[3])).concat(1);
    const linear = (value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
    const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
    const contrast = (one, other) => {
        const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
        return (high + 0.05) / (low + 0.05);
    };
    const ground = (element) => {
        const layers = [];
        for (let at = element; at; at = at.parentElement) layers.push(parse(getComputedStyle(at).backgroundColor));
        return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255, 1]);
    };
    const faint = [];
    const look = (element, colour, what) => {
        if (element.matches(":disabled, :disabled *") || !element.checkVisibility({ visibilityProperty: true })) return;
        const below = ground(element);
        const found = contrast(over(parse(colour), below), below);
        if (found < least) faint.push([what.slice(0, 40), found.toFixed(2)]);
    };
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    let seen = 0;
    while (texts.nextNode()) {
        const { parentElement: element, textContent } = texts.currentNode;
        if (!textContent.trim()) continue;
        seen += 1;
        look(element, getComputedStyle(element).color, textContent.trim());
    }
    for (const element of document.querySelectorAll("input, select")) {
        look(element, getComputedStyle(element).color, element.value || element.id);
        if (element.placeholder) look(element, getComputedStyle(element, "::placeholder").color, element.placeholder);
    }
    return { faint, seen };
}"""
# The contrast of pairs of colours of the style sheet, by their names.
PAIRS = """(pairs) => {
    const probe = document.body.appendChild(document.createElement("i"));
    const luminance = (name) => {
        probe.style.color = `var(--${name})`;
        const parts = getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number).map((value) => value / 255);
        const [r, g, b] = parts.map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const found = pairs.map(([one, other]) => {
        const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
        return [one, other, (high + 0.05) / (low + 0.05)];
    });
    probe.remove();
    return found;
}"""
# What is written and drawn on canvases, and edges of what can be used.
ON_CANVAS = [("dim", "ground"), ("dim", "panel")] + [(one, "place") for one in ["ink", "accent", "good", "warn", "bad"]]
LINES = [(f"line-{at}", "panel") for at in range(1, 7)] + [("edge", "panel"), ("edge", "ground"), ("accent", "ground")]
LINES += [(one, "ground") for one in ["wall", "strip", "tag", "slip", "slope", "ray", "path"]]


def is_readable(page):
    """Contrast as WCAG 2 has it at level AA."""
    found = page.evaluate(FAINT, LEAST_CONTRAST)
    assert found["seen"] > 60 and not found["faint"], found
    for pairs, least in [(ON_CANVAS, LEAST_CONTRAST), (LINES, LEAST_CONTRAST_OF_LINES)]:
        faint = [pair for pair in page.evaluate(PAIRS, pairs) if pair[2] < least]
        assert not faint, faint


def looks(browser, simulator, folder):
    """Dark and light, on a large screen and on a phone."""
    colours = set()
    for scheme in SCHEMES:
        for name, options in VIEWS.items():
            page, wrong = open_page(browser, simulator, color_scheme=scheme, **options)
            # The token is not left where it is seen.
            assert "token" not in page.url, page.url
            wait("the path is drawn", lambda page=page: page.evaluate("sim.picture.paths[0]?.length > 10"))
            wait("a chart is drawn", lambda page=page: page.evaluate("[...sim.charts.charts.values()][0].points.length > 60"))
            page.locator("#faults summary").first.click()
            page.fill("#name", "no.such.name")
            page.keyboard.press("Enter")
            page.wait_for_selector(".alert")
            page.screenshot(path=folder / f"page-{name}-{scheme}.png", full_page=True)
            colours.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            assert overflow(page) <= 0, (name, overflow(page))
            is_readable(page)
            # What can be pressed is large enough to be hit.
            small = page.evaluate(
                "[...document.querySelectorAll('button, select, summary')].filter((one) => one.checkVisibility())"
                ".filter((one) => { const { width, height } = one.getBoundingClientRect(); return width < 24 || height < 24; })"
                ".map((one) => one.outerHTML.slice(0, 80))"
            )
            assert not [one for one in small if 'class="link"' not in one], small
            # Something is drawn: more than one colour.
            assert page.evaluate(
                "(() => { const c = document.getElementById('picture'); const d = c.getContext('2d')"
                ".getImageData(0, 0, c.width, c.height).data; const seen = new Set();"
                "for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);"
                "return seen.size > 5; })()"
            )
            # Faults come before what operators do, and both before the log.
            tops = [page.evaluate("(id) => document.getElementById(id).getBoundingClientRect().top", one) for one in ["active", "faults", "operator"]]
            assert tops == sorted(tops), tops
            assert not wrong, wrong
            page.context.close()
    assert len(colours) == 2, colours


def presses(browser, simulator):
    """What is pressed happens, and what happens is seen."""
    page, wrong = open_page(browser, simulator, **DESK)
    # The traffic as it flows.
    page.wait_for_selector("#lines li.request:has-text('set_motors')")
    # The emergency stop stops a driving vehicle, and its state says so.
    mode = page.locator("#values tr[data-row=mode] td").first
    simulator.ctl("until", "r150.truth.speed_mps > 0.1", "--within", "60s")
    assert mode.locator(".pill.bad").count() == 0
    page.get_by_role("button", name="emergency stop", exact=True).click()
    simulator.ctl("until", "r150.truth.at_rest", "--within", "60s")
    page.wait_for_selector("#lines li:has-text('emergency stop pushed in')")
    wait("the state shows it", lambda: mode.locator(".pill.bad").all_inner_texts() == ["emergency stop"])
    # Steps say what they are.
    page.wait_for_selector("#steps b:text-is('emergency stop on')")
    assert "step " not in page.locator("#steps").inner_text()
    page.get_by_role("button", name="emergency stop off", exact=True).click()
    wait("the state shows its end", lambda: mode.locator(".pill.bad").count() == 0)
    # A fault, with a parameter and a time.
    page.fill("#find", "bit-flips")
    fault = page.locator("#faults > details:visible")
    assert fault.count() == 1
    fault.locator("summary").click()
    fault.get_by_label("probability").fill("0.01")
    fault.get_by_label("for", exact=True).fill("100 ms")
    fault.get_by_role("button", name="Inject").click()
    page.wait_for_selector("#steps li:has-text('bit-flips, probability 0.01')")
    # One that makes no sense is refused beside it.
    fault.get_by_label("probability").fill("7")
    fault.get_by_role("button", name="Inject").click()
    page.wait_for_selector("#faults .problem:has-text('probability')")
    # Another device has its own forms.
    page.get_by_role("tab", name="car").click()
    page.fill("#find", "supply-lost")
    assert page.locator("#faults > details:visible").count() == 1
    page.fill("#find", "rail-short")
    assert page.locator("#faults > details:visible").count() == 0
    page.get_by_role("tab", name="r150").click()
    # A name of all devices, their values side by side; and of one.
    wait("both values", lambda: [text.split()[0] for text in page.locator("#charts output").all_inner_texts()] == ["r150", "car"])
    page.fill("#name", "car.truth.x_m")
    page.keyboard.press("Enter")
    page.wait_for_selector("#charts b:has-text('car.truth.x_m')")
    wait("values come", lambda: "m" in page.locator("#charts output").last.inner_text())
    heads = page.locator("#values thead th").all_inner_texts()
    assert heads == ["r150", "car"], heads
    wait("each has its speed", lambda: all("m/s" in text for text in page.locator("#values tr[data-row=speed] td").all_inner_texts()))
    # Keys: space, a dot, and those of the map.
    page.locator("#picture").focus()
    page.keyboard.press("Space")
    wait("it stands still", lambda: json.loads(simulator.ctl("state"))["paused"])
    wait("it says so", lambda: page.inner_text("#state") == "paused" and page.inner_text("#pause") == "Resume")
    before = json.loads(simulator.ctl("state"))["t"]
    page.keyboard.press(".")
    wait("it has advanced", lambda: abs(json.loads(simulator.ctl("state"))["t"] - before - 0.05) < 1e-6)
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
    page.wait_for_selector(".alert")
    assert HOSTILE in page.locator("#steps").inner_text() and HOSTILE in page.locator("#notices").inner_text()
    assert page.locator("#side img, #log img, #side script, #notices img").count() == 0
    assert page.title() != "run"
    assert not wrong, wrong
    page.context.close()


def errors(browser, simulator):
    """What goes wrong is shown until it is dismissed, and beside the state, not in its place."""
    page, wrong = open_page(browser, simulator, **DESK)
    while page.locator(".alert").count():
        page.locator(".alert").first.get_by_label("Dismiss").click()
    page.fill("#name", "r150.truth.sped_mps")
    page.keyboard.press("Enter")
    page.wait_for_selector(".alert:has-text('r150.truth.sped_mps')")
    assert page.inner_text("#state") == "live"
    page.get_by_label("Dismiss").click()
    assert page.locator(".alert").count() == 0
    # A failure says why, pauses if that is wanted, and leads to its time.
    page.check("#halt")
    wanted = {"expect": {"that": "r150.truth.speed_mps > 9", "within": "100 ms", "message": "too slow for a race"}}
    simulator.ctl("step", json.dumps(wanted))
    page.wait_for_selector(".alert:has-text('too slow for a race')")
    notice = page.inner_text(".alert")
    assert "expected `r150.truth.speed_mps > 9`, but r150.truth.speed_mps = " in notice, notice
    wait("it pauses", lambda: json.loads(simulator.ctl("state"))["paused"] and page.inner_text("#state") == "paused")
    page.wait_for_selector("#lines li.failed:has-text('too slow for a race')")
    page.wait_for_selector("#steps li.failed:has-text('too slow for a race')")
    page.locator(".alert").get_by_role("button", name="Show").click()
    failed_at = float(notice.split(" s: ")[0].split()[-1])
    assert abs(page.evaluate("sim.timeline.past") - failed_at) < 0.1, (notice, page.evaluate("sim.timeline.past"))
    # It is known to who comes later, too.
    later, _ = open_page(browser, simulator, **DESK)
    later.wait_for_selector(".alert:has-text('too slow for a race')")
    later.context.close()
    simulator.ctl("resume")
    assert not wrong, wrong
    page.context.close()


def looks_back(browser, simulator):
    """The slider shows the last minute, with everything as it was."""
    page, wrong = open_page(browser, simulator, **DESK)
    simulator.ctl("pause")
    wait("it stands still", lambda: page.inner_text("#state") == "paused")
    then, there = (float(simulator.ctl("get", name).split()[-1]) for name in ["t", "r150.truth.x_m"])
    wait("it is shown", lambda: abs(page.evaluate("sim.history.last") - then) < 0.01)
    simulator.ctl("resume")
    simulator.ctl("until", f"abs(r150.truth.x_m - {there}) > 0.3", "--within", "60s")
    simulator.ctl("--device", "r150", "fault", "watchdog-off", "--for", "50ms")
    position = page.locator("#values tr[data-row=position] td").first
    wait("it has moved", lambda: abs(float(position.inner_text().split(",")[0]) - there) > 0.2)
    slider = page.locator("#when")
    slider.evaluate("(slider, t) => { slider.value = t; slider.dispatchEvent(new Event('input')); }", then + 0.0005)
    wait("the state is that of then", lambda: abs(float(position.inner_text().split(",")[0]) - there) < 0.02)
    assert abs(page.evaluate("sim.picture.past.devices[0].x") - there) < 0.01
    assert page.inner_text("#past").startswith("at ") and page.locator("#lines li.place").count() == 1
    # By key: on by a step, and to the end, which is now.
    slider.focus()
    page.keyboard.press("ArrowRight")
    assert abs(page.evaluate("sim.timeline.past") - then - 0.05) < 0.01
    # Before the first frame there is nothing to look at.
    page.evaluate("sim.timeline.show(-10)")
    assert page.evaluate("sim.timeline.past === sim.history.first")
    page.keyboard.press("End")
    wait("now is shown", lambda: page.evaluate("sim.timeline.past === null && sim.picture.past === null"))
    # What was active has left its mark.
    span = "sim.timeline.spans.get('watchdog-off')"
    wait("its end is known", lambda: page.evaluate(f"({span}?.to ?? null) !== null"))
    assert 0.0499 < page.evaluate(f"{span}.to - {span}.from") < 30, page.evaluate(span)
    # The axis of charts is that of the slider.
    minute = page.evaluate("[sim.history.begin(sim.history.last), sim.history.last]")
    assert 5 - 1e-6 <= minute[1] - minute[0] <= 60 + 1e-6, minute
    assert not wrong, wrong
    page.context.close()


def offers(browser, simulator):
    """Each device is offered what it takes, and nothing that it refuses."""
    page, wrong = open_page(browser, simulator, **DESK)
    for device, others in {"r150": ["strafe-left", "left-front", "ros"], "car": ["ros"]}.items():
        page.get_by_role("tab", name=device).click()
        words = page.evaluate(
            "[...document.querySelectorAll('#side option, #side button')].map((one) => one.textContent.trim())"
        )
        assert not [word for word in words for other in others if other in word], words
        assert any("strafe-left" in word for word in words) == (device == "car"), words
        fields = page.evaluate("[...document.querySelectorAll('#side input')].map((one) => one.value + one.placeholder)")
        assert len(fields) > 50 and not [text for text in fields if "[" in text or "{" in text], fields
    page.get_by_role("tab", name="r150").click()
    # What holds if a field is left empty is seen in it.
    mute = page.locator("#faults details:has(summary:text-is('mute'))")
    assert mute.locator("option").first.text_content() == "to-client (default)"
    # What has the word in its name comes before what has it in its description.
    page.fill("#find", "cable")
    found = page.evaluate("[...document.querySelectorAll('#faults > :not([hidden]) > summary')].map((one) => one.textContent)")
    assert found[0] == "cable-pulled" and "mute" in found, found
    page.fill("#find", "")
    # Every fault with each of its words is taken.
    page.evaluate(
        """async () => {
            const wait = (ms) => new Promise((done) => setTimeout(done, ms));
            window.tried = []; window.refused = [];
            for (const device of [0, 1]) {
                document.querySelectorAll("#devices button")[device].click();
                const forms = [...document.querySelectorAll("#faults form")];
                for (let at = 0; at < forms.length; at += 1) {
                    const form = forms[at];
                    const selects = [...form.querySelectorAll("select")];
                    const most = Math.max(1, ...selects.map((one) => one.options.length));
                    for (let word = 0; word < most; word += 1) {
                        for (const one of selects) one.selectedIndex = Math.min(Math.max(word, one.required ? 1 : 0), one.options.length - 1);
                        for (const one of form.querySelectorAll("input")) {
                            if (one.ariaLabel === "for") one.value = "1 ms";
                            else if (one.required || one.ariaLabel === "power") one.value = one.placeholder || "1";
                        }
                        if (selects.length > 1 && selects.every((one) => one.ariaLabel !== "direction" && one.required)) {
                            selects[1].selectedIndex = selects[0].selectedIndex % (selects[1].options.length - 1) + 1;
                        }
                        const before = sim.journal.length;
                        form.requestSubmit();
                        const problem = form.querySelector(".problem");
                        while (sim.journal.length === before && problem.hidden) await wait(5);
                        tried.push(form.parentElement.querySelector("summary").textContent);
                        if (!problem.hidden) { refused.push([tried.at(-1), problem.textContent]); problem.hidden = true; }
                    }
                }
            }
            document.title = "tried all";
        }"""
    )
    assert page.title() == "tried all"
    tried, refused = page.evaluate("[tried.length, refused]")
    assert tried > 100 and not refused, (tried, refused)
    # A list is a box for each word, and a field for each number.
    page.get_by_role("tab", name="r150").click()
    sets = page.locator("#operator details:has(summary:text-is('app sets'))")
    sets.locator("summary").click()
    sets.get_by_label("12v-b").check()
    sets.get_by_label("pwm 2").fill("500")
    sets.get_by_role("button").click()
    page.wait_for_selector("#steps b:has-text('app sets on 12v-b pwm 0 500 0 0')")
    # A remote control's keys are buttons.
    page.get_by_role("button", name="press left", exact=True).click()
    page.wait_for_selector("#steps b:has-text('press left')")
    page.get_by_role("button", name="release", exact=True).click()
    page.get_by_role("button", name="autonomous", exact=True).click()
    assert not wrong, wrong
    page.context.close()


def keyboard(browser, simulator):
    """The tab key reaches everything that can be used, in the order of reading."""
    page, wrong = open_page(browser, simulator, **DESK)
    page.evaluate("document.activeElement.blur()")
    reached = []
    for _ in range(200):
        page.keyboard.press("Tab")
        found = page.evaluate(
            "(() => { const one = document.activeElement; const seen = getComputedStyle(one).outlineStyle !== 'none';"
            "return [one.id || one.closest('[id]')?.id, seen]; })()"
        )
        assert found[1] or found[0] is None, f"focus on {found[0]} is not seen"
        if found[0] not in reached:
            reached.append(found[0])
        if found[0] == "lines":
            break
    wanted = ["pause", "advance", "by", "speed", "halt", "picture", "fit", "follow", "when", "devices", "find", "faults", "operator", "name", "lines"]
    assert [one for one in reached if one in wanted] == wanted, reached
    # From the map, a key leads to the faults, and keys alone inject one.
    page.locator("#picture").focus()
    page.keyboard.press("/")
    page.keyboard.type("missing-reply")
    for key in ["Tab", "Enter"]:
        page.keyboard.press(key)
    page.locator("#faults > details[open]").get_by_label("for", exact=True).focus()
    page.keyboard.type("20 ms")
    page.keyboard.press("Enter")
    page.wait_for_selector("#steps b:has-text('missing-reply')")
    assert not wrong, wrong
    page.context.close()


def saves(browser, simulator):
    """What was done by hand is a scenario file that can be played."""
    page, wrong = open_page(browser, simulator, **DESK)
    assert not page.locator("#save").is_visible()
    page.get_by_role("button", name="emergency stop", exact=True).click()
    page.wait_for_selector("#steps b:text-is('emergency stop on')")
    page.get_by_role("button", name="emergency stop off", exact=True).click()
    page.wait_for_selector("#steps b:text-is('emergency stop off')")
    page.fill("#find", "rail-short")
    fault = page.locator("#faults > details:visible")
    fault.locator("summary").click()
    fault.get_by_label("rail", exact=True).select_option("12v-b")
    fault.get_by_role("button", name="Inject").click()
    page.wait_for_selector("#steps li.active:has-text('rail-short')")
    page.locator("#steps li.active:has-text('rail-short')").get_by_role("button").click()
    page.wait_for_selector("#steps li.done:has-text('rail-short')")
    # They outlive the page being loaded again.
    page.reload()
    page.wait_for_selector("#save:has-text('3 steps')")
    with page.expect_download() as download:
        page.locator("#save").click()
    file = simulator.folder / download.value.suggested_filename
    download.value.save_as(file)
    checked = subprocess.run([simulator.program, "check", file], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, (checked, file.read_text())
    saved = tomllib.loads(file.read_text())
    assert [device["name"] for device in saved["device"]] == ["r150", "car"] and saved["world"].endswith("yard.toml")
    assert saved["settings"]["r150"]["heartbeat_timeout"] == "6s", saved["settings"]
    assert not wrong, wrong
    page.context.close()
    return file, saved["step"]


def plays(browser, program, folder):
    """A scenario that fails pauses there, says why and what was expected, and more steps can be saved on top of it."""
    port = folder / "played"
    simulator = Simulator(program, folder / "scenario", SCENARIO, "--pty", port, flag="--scenario")
    page, wrong = open_page(browser, simulator, **DESK)
    page.check("#halt")
    assert page.inner_text("#title") == "It should not drive"
    driver = Driver(port, back=False)
    page.wait_for_selector(".alert")
    notice = page.inner_text(".alert")
    assert "it drives: never `truth.distance_m > 0.5`, but truth.distance_m = " in notice and "Expected: Stands still." in notice, notice
    wait("it pauses", lambda: page.inner_text("#state") == "paused")
    assert page.locator("#steps li.active b").all_inner_texts() == ["slow: dragging"]
    page.get_by_role("button", name="lock", exact=True).click()
    page.wait_for_selector("#save:has-text('1 step')")
    # While time stands still, what is cleared has done nothing.
    page.fill("#find", "watchdog-off")
    page.locator("#faults summary:visible").click()
    page.locator("#faults form:visible button").click()
    page.locator("#steps li:has-text('watchdog-off') button").click()
    page.wait_for_selector("#save:has-text('2 steps')")
    page.wait_for_selector("#steps li.done:has-text('watchdog-off')")
    with page.expect_download() as download:
        page.locator("#save").click()
    file = folder / "on-top.toml"
    download.value.save_as(file)
    checked = subprocess.run([program, "check", file], capture_output=True, text=True, check=False)
    assert checked.returncode == 0 and "base = " in file.read_text(), (checked, file.read_text())
    # The file below has a step of that name.
    assert [step["name"] for step in tomllib.loads(file.read_text())["step"]] == ["lock 2"], file.read_text()
    assert not wrong, wrong
    page.context.close()
    driver.done.set()
    simulator.process.terminate()
    simulator.process.wait()


class Replayed(Simulator):
    """A recorded run that is played again up to a time."""

    def __init__(self, program, folder, trace, until):
        self.program, self.folder = program, folder.absolute()
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder)}
        command = [program, "replay", trace, "--until", f"{until} s"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=self.environment)
        atexit.register(self.process.kill)
        assert any(line == "ready\n" for line in self.process.stdout), "it has ended"


def looks_before(browser, program, trace, folder):
    """The slider goes back into what was played again, the values of charts and names included."""
    until, then = 6.0, 2.0
    simulator = Replayed(program, folder / "replayed", trace, until)
    page, wrong = open_page(browser, simulator, **DESK)
    wait("now is shown", lambda: abs(page.evaluate("sim.history.last") - until) < 0.001)
    first = "[sim.history.first, Number(document.getElementById('when').min)]"
    wait("the past is there", lambda: page.evaluate(first) == [0, 0])
    page.wait_for_selector("#lines li.request")
    page.locator("#when").evaluate("(slider, t) => { slider.value = t; slider.dispatchEvent(new Event('input')); }", then)
    # The log of before is there, and follows.
    line = page.locator("#lines li.place").inner_text()
    assert abs(float(line.split()[0]) - then) < 0.5, line
    names = ["r150.truth.x_m", "r150.truth.speed_mps"]
    csv = [program, "trace", trace, "--csv", ",".join(names), "--from", f"{then} s", "--until", f"{then} s"]
    x, speed = map(float, subprocess.run(csv, check=True, capture_output=True, text=True).stdout.splitlines()[1].split(","))
    assert abs(page.evaluate("sim.picture.past.devices[0].x") - x) < 1e-9 and x > 0.1
    shown = page.evaluate(f"sim.history.valuesAt({then}).values")
    assert abs(shown[names[1]] - speed) < 1e-9 and abs(speed) > 0.01, (shown, speed)
    # Further names are known then, too.
    page.fill("#name", "r150.truth.y_m")
    page.keyboard.press("Enter")
    wait("it has values of then", lambda: "r150.truth.y_m" in page.evaluate(f"sim.history.valuesAt({then}).values"))
    assert page.evaluate("sim.history.first") == 0
    assert not wrong, wrong
    page.context.close()
    simulator.process.terminate()
    assert simulator.process.wait() == 0


def main(program, folder):
    simulator = Simulator(program, folder / "two", YARD, "--set", "r150.heartbeat_timeout=6s")
    driver = Driver(simulator.folder / "r150")
    simulator.ctl("until", "r150.truth.distance_m > 0.5", "--within", "60s")
    with chromium() as browser:
        plays(browser, program, folder)
        looks(browser, simulator, folder)
        file, saved = saves(browser, simulator)
        presses(browser, simulator)
        looks_back(browser, simulator)
        errors(browser, simulator)
        keyboard(browser, simulator)
        offers(browser, simulator)
        driver.done.set()
        page, wrong = open_page(browser, simulator, **DESK)
        trace = simulator.stop()
        page.wait_for_selector(".alert:has-text('A new one prints a new URL')")
        # On a busy machine the connection may be reset before the end is read.
        assert page.inner_text("#state") in ("ended", "no answer"), page.inner_text("#state")
        # Nothing can be pressed that would do nothing; one can still look.
        acts = page.locator("#time button, #time select, #faults button, #operator button, #steps button, #choose button")
        assert acts.count() > 50
        assert all(acts.nth(at).is_disabled() for at in range(acts.count()))
        page.get_by_label("Dismiss").last.click()
        page.locator("#when").focus()
        page.keyboard.press("Home")
        assert page.evaluate("sim.timeline.past !== null")
        assert not wrong, wrong
        looks_before(browser, program, simulator.trace, folder)
    added = {line["step"]: line for line in trace if line["kind"] == "add"}
    assert any("bit-flips" in line["text"] and "100 ms" in line["text"] for line in added.values()), added
    assert any(line["kind"] == "event" and "emergency stop" in line["text"] for line in trace)
    # The file has what the trace has, at the same times, to the microsecond; cleared by hand is `for`.
    seconds = lambda text: float(text.removesuffix(" s"))
    lines = list(added.values())
    for step in saved:
        t = seconds(step["at"])
        line = next(line for line in lines if abs(line["t"] / 1e9 - t) < 2e-6 and any(word in line["text"] for word in ["emergency_stop", "rail-short"]))
        assert step["device"] == "r150" and line["text"].count('device = "r150"') == 1, (step, line)
    short = next(step for step in saved if "fault" in step)
    assert short["fault"] == {"kind": "rail-short", "rail": "12v-b"} and [step["operator"] for step in saved[:2]] == [{"emergency_stop": True}, {"emergency_stop": False}]
    cleared = next(line["t"] for line in trace if line["kind"] == "clear" and line["step"].startswith("rail-short"))
    assert abs(seconds(short["at"]) + seconds(short["for"]) - cleared / 1e9) < 2e-6, (short, cleared)
    # Played, the same is done at the same times.
    output = folder / "saved"
    subprocess.run([program, "run", "--seed", "1", "--output", output, file], capture_output=True, check=False)
    played = [json.loads(line) for line in next(output.glob("**/*.jsonl")).read_text().splitlines()]
    began = {line["step"]: line["t"] / 1e9 for line in played if line["kind"] == "step" and line["what"] == "begun"}
    assert {step["name"]: seconds(step["at"]) for step in saved}.keys() <= began.keys(), began
    for step in saved:
        assert abs(began[step["name"]] - seconds(step["at"])) < 2e-6, (step, began)


main(str(Path(sys.argv[1]).absolute()), Path(sys.argv[2]))
