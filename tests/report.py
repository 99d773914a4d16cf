"""The page of `sim run --report` in headless Chromium: looked at on a screen and a phone, light and dark, and
on paper.

    python3 tests/report.py SIM FOLDER

Needs `pip install playwright` and a Chromium of the system. The page and its pictures are left in FOLDER.
"""

import re
import subprocess
import sys
from pathlib import Path

from browser import SCHEMES, VIEWS, colours, launch, overflow
from playwright.sync_api import sync_playwright

SIM, FOLDER = str(Path(sys.argv[1]).absolute()), Path(sys.argv[2]).absolute()
ROOT = Path(__file__).parent.parent
# Spent only on failure, since the machine may be busy.
PATIENCE_MS = 120_000
# One that fails in a world with everything, with a fault; others that pass.
PLAYED = ["docs/pictures/ice.toml", "scenarios/r150/jobs", "scenarios/mecanum/person-crosses.toml"]

# Contrast of texts with what is behind them, as WCAG counts it.
CONTRASTS = """() => {
    const parse = text => text.match(/[\\d.]+/g).map(Number);
    const light = colour => {
        const [r, g, b] = colour.map(part => part / 255)
            .map(part => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const behind = element => {
        for (; element; element = element.parentElement) {
            const colour = parse(getComputedStyle(element).backgroundColor);
            if (colour.length === 3 || colour[3] > 0) return colour;
        }
        return [255, 255, 255];
    };
    const texts = [...document.querySelectorAll('h1, h2, p, li, td, th, small, span.badge, figcaption, svg text, pre')];
    return texts
        .filter(element => element.checkVisibility() && element.textContent.trim() && element.getClientRects().length)
        .filter(element => element.tagName !== 'text' || getComputedStyle(element).fill !== 'none')
        .map(element => {
            const style = getComputedStyle(element);
            const own = light(parse(element.tagName === 'text' ? style.fill : style.color));
            const other = light(behind(element));
            const contrast = (Math.max(own, other) + 0.05) / (Math.min(own, other) + 0.05);
            return {
                contrast,
                height: element.getBoundingClientRect().height,
                text: element.tagName + ' ' + element.textContent.trim().slice(0, 40),
            };
        });
}"""


def rgb(text):
    return tuple(map(int, re.findall(r"\d+", text)[:3]))


def make():
    """The page, and how many cases it has."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    page = FOLDER / "report.html"
    command = [SIM, "run", "--seed", "1", "--report", page, *PLAYED]
    played = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert played.returncode == 1, played
    passed, failed = map(int, re.search(r"(\d+) passed, (\d+) failed", played.stdout).groups())
    assert (passed, failed) == (2, 1), played.stdout
    return page


def open_page(browser, path, **options):
    # Thin lines have their own pixels.
    page = browser.new_context(**options, device_scale_factor=3).new_page()
    page.set_default_timeout(PATIENCE_MS)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda message: wrong.append(message.text))
    page.on("request", lambda request: wrong.append(request.url) if request.url != path.as_uri() else None)
    page.goto(path.as_uri())
    return page, wrong


def sees(blank, page, selector):
    """What is drawn there has the colour that it is said to have."""
    element = page.locator(selector).first
    element.scroll_into_view_if_needed()
    style = element.evaluate(
        "element => { const style = getComputedStyle(element);"
        "return [style.fill, style.stroke].filter(own => own !== 'none').map(own => [own, style.fillOpacity]); }"
    )
    box = element.bounding_box()
    # A line is as thin as its stroke, which is not part of its box.
    grown = {"x": box["x"] - 2, "y": box["y"] - 2, "width": box["width"] + 4, "height": box["height"] + 4}
    seen = colours(blank, page.screenshot(clip=grown))
    near = lambda one, other: all(abs(a - b) <= 40 for a, b in zip(one, other))
    for text, opacity in style:
        if float(opacity) == 1:
            count = sum(count for own, count in seen.items() if near(own, rgb(text)))
            assert count > 3, (selector, text, seen)
    assert len(seen) > 1, (selector, seen)


def looks(browser, blank, path):
    grounds = set()
    for scheme in SCHEMES:
        for name, options in VIEWS.items():
            page, wrong = open_page(browser, path, color_scheme=scheme, **options)
            where = f"{name}, {scheme}"
            assert page.locator("h1").inner_text() == "2 of 3 passed"
            assert page.locator("table.cases tbody tr").count() == 3
            # Titles have room, and the numbers stand in their own column.
            boxes = [page.locator(f"table.cases tbody tr:first-child td:nth-child({at})").bounding_box() for at in range(1, 6)]
            assert boxes[1]["width"] > (300 if name == "screen" else 150), (where, boxes)
            assert all(box["x"] >= boxes[1]["x"] + boxes[1]["width"] - 1 for box in boxes[3:]), (where, boxes)
            assert overflow(page) <= 0, (where, overflow(page))
            page.screenshot(path=str(FOLDER / f"report-{name}-{scheme}.png"), full_page=True)
            grounds.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            # What failed is open, with its map and its plots; what passed is folded.
            failed = page.locator("article.case")
            assert failed.count() == 1
            plots = failed.locator("figure:not(.world) svg").count()
            assert plots >= 7, (where, plots)
            for picture in failed.locator("svg").all():
                picture.scroll_into_view_if_needed()
                box = picture.bounding_box()
                assert box["width"] > 250 and box["height"] > 80, (where, box)
                assert len(colours(blank, picture.screenshot())) > 20, (where, picture.inner_html()[:200])
            for part in ["obstacle", "slippery", "begins", "ends", "fault", "failure", "scale"]:
                sees(blank, page, f"article.case .map .{part}")
            for part in ['.plot .fault', '.plot .failure', '.plot .curve0']:
                sees(blank, page, f"article.case .plots {part}")
            assert page.locator("details.case svg").first.is_hidden()
            for text in page.evaluate(CONTRASTS):
                assert text["contrast"] >= 4.5 and text["height"] >= 9, (where, text)
            # The way to a case, and what is folded there.
            page.locator("details.case summary").first.click()
            page.locator("details.case svg").first.wait_for(state="visible")
            page.locator("article.case details summary", has_text="Traffic").click()
            traffic = page.locator("article.case pre").first
            assert "set_motors" in traffic.inner_text() and traffic.is_visible()
            assert overflow(page) <= 0, where
            page.locator("table.cases a").first.click()
            assert page.url.endswith("#case-0"), page.url
            assert not wrong, (where, wrong)
            page.context.close()
    assert len(grounds) == 2, grounds


def prints(browser, path):
    """On paper it is light, whatever the screen is, and everything is on it."""
    page, wrong = open_page(browser, path, color_scheme="dark")
    page.emulate_media(media="print")
    assert rgb(page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--ground')")
               .replace("#fff", "255 255 255")) == (255, 255, 255)
    paper = page.pdf(path=str(FOLDER / "report.pdf"), format="A4")
    assert paper.startswith(b"%PDF") and paper.count(b"/Type /Page\n") >= 2, len(paper)
    assert not wrong, wrong
    page.context.close()


def main():
    path = make()
    with sync_playwright() as play:
        browser = launch(play)
        blank = browser.new_page()
        looks(browser, blank, path)
        prints(browser, path)
        browser.close()
    print(f"{path.stat().st_size} bytes, looked at on a screen, a phone and paper")


main()
