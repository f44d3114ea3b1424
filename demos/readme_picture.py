"""The README's picture: TIAGo's report, photographed in headless Chromium."""

import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

import rpctl

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PICTURE = Path(__file__).parent / "tiago.png"


def main() -> None:
    chromium = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if chromium is None:
        print("no picture: this needs Chromium on the PATH")
        return
    robot = rpctl.load("tiago")
    certificate = rpctl.verify(robot, samples=20)
    run = rpctl.track(robot, "eight", initial_error=(0.1, -0.1, 0.1), certificate=certificate)
    folder = Path("runs/readme")
    folder.mkdir(parents=True, exist_ok=True)
    report = rpctl.write_report(run, folder / "report.html")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(report.resolve().as_uri())
        while not page.evaluate("Boolean(window.rpctl && window.rpctl.ready)"):
            page.wait_for_timeout(50)
        page.evaluate("rpctl.pause(); rpctl.seek(17.2)")
        page.wait_for_timeout(1000)
        page.screenshot(path=PICTURE)
        browser.close()
    print(f"wrote {PICTURE.name}")


if __name__ == "__main__":
    main()
