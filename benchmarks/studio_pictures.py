"""The pictures of the studio: ``python -m benchmarks.studio_pictures docs/assets``."""

from __future__ import annotations

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from benchmarks.studio import LOG, running

_CHROMIUM = "/usr/bin/chromium"


def main(folder: Path) -> None:
    """Open the studio with the example log, identify it, and picture what is found."""
    with running(LOG) as (_, address), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1120, "height": 1000})
        page.goto(f"{address}?ran=yes")
        page.wait_for_selector("#found", timeout=300_000)
        page.evaluate("document.querySelector('#run .step').scrollIntoView()")
        page.wait_for_timeout(500)
        page.screenshot(path=folder / "studio-identify.png")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
