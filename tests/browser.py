"""Chromium for the tests of pages: how they are looked at, and what is seen then."""

import base64
import shutil

VIEWS = {
    "screen": {"viewport": {"width": 1280, "height": 800}},
    "phone": {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True},
}
SCHEMES = ["light", "dark"]


def launch(play):
    """The Chromium of the system, headless."""
    chromium = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])))
    # A container may have a small /dev/shm. On a busy machine a start takes its time.
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage"]
    return play.chromium.launch(executable_path=chromium, args=arguments, timeout=120_000)


def overflow(page):
    """By how many pixels it is wider than what it is looked at through."""
    return page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")


def colours(blank, screenshot):
    """How often each colour is in a screenshot, by its RGB; `blank` is a page without its own rules."""
    counts = blank.evaluate(
        """async png => {
            const bytes = Uint8Array.from(atob(png), letter => letter.charCodeAt(0));
            const image = await createImageBitmap(new Blob([bytes]));
            const canvas = new OffscreenCanvas(image.width, image.height);
            const context = canvas.getContext('2d');
            context.drawImage(image, 0, 0);
            const data = context.getImageData(0, 0, image.width, image.height).data;
            const counts = {};
            for (let i = 0; i < data.length; i += 4) {
                const own = [data[i], data[i + 1], data[i + 2]].join();
                counts[own] = (counts[own] ?? 0) + 1;
            }
            return counts;
        }""",
        base64.b64encode(screenshot).decode(),
    )
    return {tuple(map(int, own.split(","))): count for own, count in counts.items()}


if __name__ == "__main__":
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play, launch(play) as browser:
        page = browser.new_page()
        page.set_content("<p>It starts.</p>")
        print(browser.version, page.inner_text("p"))
