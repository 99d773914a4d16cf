"""The site in headless Chromium: the recorded drive plays, the search finds a word, and the languages link.

    python3 tests/site.py FOLDER

FOLDER has the site. Needs `pip install playwright` and a Chromium of the system.
"""

import sys
from pathlib import Path

from browser import launch
from playwright.sync_api import expect, sync_playwright

SITE = Path(sys.argv[1]).absolute().as_uri()
# Spent only on failure, since the machine may be busy.
PATIENCE_MS = 120_000

with sync_playwright() as play:
    browser = launch(play)
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.set_default_timeout(PATIENCE_MS)
    expect.set_options(timeout=PATIENCE_MS)
    wrong = []
    page.on("pageerror", lambda error: wrong.append(str(error)))

    page.goto(f"{SITE}/drive.html")
    vehicle, slider = page.locator("#vehicle"), page.locator("#drive input")
    begins = vehicle.get_attribute("transform")
    page.click("#drive button")
    page.wait_for_function("Number(document.querySelector('#drive input').value) > 2.5")
    assert vehicle.get_attribute("transform") != begins
    expect(page.locator("#drive pre")).to_contain_text("fault drag")
    slider.fill(slider.get_attribute("max"))
    expect(page.locator("#drive pre")).to_contain_text("it hits something")
    expect(page.locator("#drive button")).to_have_text("Play")

    page.goto(f"{SITE}/index.html?search=watchdog")
    expect(page.locator("#mdbook-searchresults li, #searchresults li").first).to_contain_text("atchdog")

    page.goto(f"{SITE}/README.zh-CN.html")
    expect(page.locator("html")).to_have_attribute("lang", "zh-CN")
    page.locator("main a", has_text="English").click()
    expect(page.locator("html")).to_have_attribute("lang", "en")
    page.locator("main a", has_text="中文").click()
    expect(page.locator("html")).to_have_attribute("lang", "zh-CN")
    assert not wrong, wrong
    browser.close()
print("the recorded drive plays, the search finds, and the languages link")
