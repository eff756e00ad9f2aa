"""Frames per second that a tab of `usvauv live` gets, and how fast the mission runs meanwhile; a picture of a tab.

    python -m benchmarks.live
    python -m benchmarks.live --out docs/live.png

A session is shown at real time and as fast as possible, each for some seconds. Another process is the tab: it connects
as one, receives everything and counts the messages that hold a new surface of the sea. It draws nothing, as what
drawing costs depends on the browser and its graphics. With `--out` the tab is a real one, in Chromium without a window,
and what it shows of `extreme-torpedo` is all that is made.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.machine import command_line, describe, parse, show
from tests.usvauv_cli.web_report.pages import CHROMIUM
from usvauv.cli.live.server import INTERVAL, Show, listen, serve
from usvauv.cli.live.session import Session
from usvauv.env import Scenario

SPEEDS = {"real time": 1.0, "as fast as possible": math.inf}
WARM_UP = 2.0  # s
PICTURED, WHEN = "extreme-torpedo", 330  # scenario, s
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

TAB = """
import sys, time
import viser
from websockets.sync.client import connect
address, least, warm_up, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
with connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as connection:
    begun = time.perf_counter()
    pictures = received = 0
    while (now := time.perf_counter() - begun) < warm_up + seconds:
        size = len(connection.recv())
        if now > warm_up:
            pictures += size > least
            received += size
print(pictures / seconds, received / seconds)
"""


def watched(show: Show, address: str, seconds: float) -> dict[str, float]:
    """Rates while a tab watches for some seconds."""
    session = show.session
    vertices = 12 * len(session.grid.x) * len(session.grid.y)
    arguments = [address.replace("http", "ws").rstrip("/"), str(vertices), str(WARM_UP), str(seconds)]
    tab = subprocess.Popen([sys.executable, "-c", TAB, *arguments], stdout=subprocess.PIPE, text=True)
    begun = last = time.perf_counter()
    first = session.moment.time
    while tab.poll() is None:
        now = time.perf_counter()
        show.picture(now - last)
        last = now
        if session.ended:
            raise SystemExit(f"{session.ended} before {seconds:g} s have passed")
        time.sleep(max(0.0, INTERVAL - (time.perf_counter() - now)))
    assert tab.stdout is not None
    pictures, received = map(float, tab.stdout.read().split())
    pace = (session.moment.time - first) / (time.perf_counter() - begun)
    return {"pictures_per_second": pictures, "megabytes_per_second": received / 1e6, "times_real_time": pace}


def measure(scenarios: list[str], seconds: float, arch: str) -> dict:
    rows = []
    for name in scenarios:
        scenario = Scenario.load(name, ["mission.duration=20000"])
        with listen(0) as listening, serve(listening, name) as (server, address):
            shown = Show(server, Session(scenario, arch=arch))
            for speed, factor in SPEEDS.items():
                shown.session.speed = factor
                rows.append({"scenario": name, "speed": speed, **watched(shown, address, seconds)})
    return {"machine": describe(), "rows": rows}


def photograph(out: Path) -> None:
    """Write a picture of the tab of `PICTURED` after `WHEN` s."""
    from playwright.sync_api import sync_playwright

    session = Session(Scenario.load(PICTURED), seed=1)
    while session.time < WHEN:
        session.step()
    session.speed = 1.0

    def visit(address: str) -> None:
        with sync_playwright() as started:
            browser = started.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
            page = browser.new_page(viewport={"width": 1360, "height": 860}, color_scheme="dark")
            page.goto(address)
            page.get_by_text("Position error").wait_for(timeout=120_000)
            page.locator(".mantine-Notification-closeButton").click()  # that of software that draws
            page.wait_for_timeout(15_000)  # it draws slowly
            page.screenshot(path=out)
            browser.close()

    title = f"usvauv {PICTURED}"
    with listen(0) as listening, serve(listening, title) as (server, address), ThreadPoolExecutor() as tabs:
        shown = Show(server, session)
        tab = tabs.submit(visit, address)
        last = time.perf_counter()
        while not tab.done():
            now = time.perf_counter()
            shown.picture(now - last)
            last = now
            time.sleep(INTERVAL)
        tab.result()


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("scenarios", nargs="*", default=["extreme", "wide"], help="default: extreme wide")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--out", type=Path, help="X.png: a picture of the tab to write instead")
    arguments = parse(parser)
    if arguments.out:
        photograph(arguments.out)
        return
    show(measure(arguments.scenarios, arguments.seconds, arguments.arch), arguments.json)


if __name__ == "__main__":
    main()
