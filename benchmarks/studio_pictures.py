"""Make the pictures of the studio: ``python -m benchmarks.studio_pictures docs/assets``."""

from __future__ import annotations

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks.studio import LOG, running

_CHROMIUM = "/usr/bin/chromium"


def main(folder: Path) -> None:
    """Open the studio with the example log, and take pictures of the result and of Play."""
    with running(LOG) as (_, address), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1120, "height": 1000})
        page.goto(f"{address}?ran=yes")
        page.wait_for_selector("#found", timeout=300_000)
        page.evaluate("document.querySelector('#run .step').scrollIntoView()")
        page.wait_for_timeout(500)
        page.screenshot(path=folder / "studio-identify.png")
        page.goto(f"{address}?room=play&reading=1,1,3&pin=yes")
        page.wait_for_selector("#play-figures table", timeout=300_000)
        page.evaluate("document.querySelector('#room-play .step').scrollIntoView()")
        page.wait_for_timeout(500)
        page.screenshot(path=folder / "studio-play.png")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
