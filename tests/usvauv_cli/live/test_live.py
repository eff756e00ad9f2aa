"""The running simulation: its pace and past, what is changed while it runs, also in a tab."""

import re
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from tests.usvauv_cli.web_report.pages import CHROMIUM
from usvauv.cli.live.session import Session
from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission.columns import BoatColumn, BodyColumn, NodeColumn

SMALL = ["sea.fine_cells=32", "mission.duration=60", "current.mutual=false", "current.viscosity=0"]
SMALL += ["boat.strategy=hold:100,100"]  # with one strategy and one rule all tests share what is compiled


def scenario(*overrides: str) -> Scenario:
    return Scenario.load("extreme-torpedo", [*SMALL, *overrides])


@pytest.fixture(scope="module")
def running() -> Session:
    """A session of a small sea; tests leave it running and not at its end."""
    return Session(scenario("mission.duration=2000"), seed=3)


def stepped(session: Session, steps: int) -> None:
    for _ in range(steps):
        session.step()


def test_the_time_shown_goes_as_fast_as_asked_for(running):
    running.run()
    begun = running.moment.time
    running.speed = 2.0
    running.advance(0.25)
    assert running.moment.time == pytest.approx(begun + 0.5)
    assert running.time - running.scenario.mission.step < running.moment.time <= running.time
    running.pause()
    running.advance(5.0)
    assert running.moment.time == pytest.approx(begun + 0.5)


def test_the_past_is_shown_exactly_and_the_run_goes_on_from_the_latest_state(running):
    running.run()
    seen = {}
    for _ in range(6):
        stepped(running, 1)
        seen[running.time] = running.world.auv[0].numpy().copy(), running.world.surface(104)
    now = running.time
    running.look_back(4.0)
    running.advance(10.0)
    moment = running.moment
    auv, surface = seen[now - 4.0]
    assert moment.time == now - 4.0
    assert np.array_equal(moment.mixed("auv"), auv)
    inner = slice(1, -1), slice(1, -1)  # the outermost points lie on the border
    assert running.surface(moment)[inner] == pytest.approx(surface[inner], abs=1e-4)
    running.look_back(1e9)
    assert running.moment.time == running.history.oldest.time
    running.run()
    assert running.moment.time > now - 4.0
    stepped(running, 1)
    assert running.time == now + running.scenario.mission.step


def test_twice_the_current_is_twice_the_velocity_at_an_auv(running):
    field = torch.zeros(1, 2, 2, 2)

    def of_vortices() -> torch.Tensor:
        running.world.current_field(field)
        with_them = field.clone()
        kept = running.world.vortex.clone()
        running.world.vortex[..., Vortex.Gamma] = 0.0
        running.world.current_field(field)
        running.world.vortex[:] = kept
        return with_them - field

    running.set("current", 1.0)
    once = of_vortices()
    running.set("current", 2.0)
    assert once.abs().max() > 0.05
    assert torch.allclose(of_vortices(), 2 * once, atol=1e-5)
    running.set("current", 0.0)
    assert of_vortices().abs().max() == 0.0
    running.set("current", 1.0)
    assert torch.equal(of_vortices(), once)


def test_sliders_change_the_world_at_once(running):
    world = running.world
    height, level = running.values["storm"], running.values["source_level"]
    storm = world.storm.elevation(0, np.linspace(0, 200, 50), np.linspace(0, 200, 50))
    running.set("storm", height / 2)
    halved = world.storm.elevation(0, np.linspace(0, 200, 50), np.linspace(0, 200, 50))
    assert halved == pytest.approx(storm / 2, abs=1e-5)
    running.set("source_level", level + 6)
    assert world.scenario.acoustics.source_level == level + 6
    running.set("ping", 20.0)
    assert world.scenario.channel.interval == 20.0
    with pytest.raises(ScenarioError, match="significant_height"):
        running.set("storm", 25.0)
    assert running.values["storm"] == height / 2, "a refused value is not kept"
    for name, value in (("storm", height), ("source_level", level), ("ping", 0.0), ("current", 1.0)):
        for moved_to in (*running.sliders[name].bounds, value):
            running.set(name, moved_to)
    stepped(running, 1)


def test_what_is_moved_is_where_it_was_put(running):
    running.run()
    running.move_node(50.0, 60.0, 4)
    running.move_boat(-20.0, 70.0)
    assert running.world.node[0, 4, NodeColumn.span("x", "y")].tolist() == [50.0, 60.0]
    assert running.world.boat[0, 0, BoatColumn.span("x", "y")].tolist() == [0.0, 70.0], "within the area"
    assert running.history.latest.node[4, : NodeColumn.y + 1].tolist() == [50.0, 60.0]
    running.move_node(52.0, 60.0)
    assert running.world.node[0, 4, NodeColumn.x] == 52.0, "the nearest"
    stepped(running, 1)


def test_another_strategy_or_rule_goes_on_with_the_state():
    session = Session(scenario(), seed=2)
    stepped(session, 5)
    session.set("current", 2.0)
    before = session.world.state()
    elevation = session.world.sea.elevation()
    for change in (lambda: session.set_strategy("hold:20,30"), lambda: session.set_rule("nearest")):
        change()
        after = session.world.state()
        for name in ("auv", "body", "boat", "vortex", "estimate", "track", "own", "exchange", "clock", "tally"):
            assert torch.equal(before[name], after[name]), name
        backlog = [NodeColumn.x, NodeColumn.y, NodeColumn.rate, NodeColumn.backlog]
        assert torch.equal(before["node"][..., backlog], after["node"][..., backlog])
        assert np.array_equal(session.world.sea.elevation(), elevation)
        assert session.values["current"] == 2.0
        assert session.time == 5.0
    stepped(session, 3)
    assert session.world.strategy.name == "hold:20,30"
    assert session.scenario.nodes.target_rule == "nearest"
    assert session.figures() is not None
    assert session.figures().usv == "hold:20,30"
    old = session.world
    with pytest.raises(ScenarioError, match=r"was removed in 0\.3$"):
        session.set_strategy("fim-horizon")
    assert session.world is old, "the run goes on"


def test_a_run_that_continues_in_the_same_kind_of_world_is_the_same():
    whole, parted = Session(scenario(), seed=5), Session(scenario(), seed=5)
    stepped(whole, 4)
    stepped(parted, 4)
    parted.set("storm", parted.values["storm"])  # the same: tables are made anew, and nothing changes
    parted.set_rule(parted.scenario.nodes.target_rule)
    stepped(whole, 8)
    stepped(parted, 8)
    for name, value in whole.world.state().items():
        assert torch.equal(value, parted.world.state()[name]), name


def test_the_end_of_a_mission_waits_for_the_next_episode():
    session = Session(scenario("mission.duration=4"))
    session.speed = float("inf")
    for _ in range(50):
        session.advance(0.01)
    assert session.ended
    assert session.time == 4.0
    assert session.figures().services >= 0
    session.run()
    assert (session.ended, session.time) == ("", 0.0)
    stepped(session, 1)


@pytest.fixture
def in_tabs():
    """Run a function of a browser and the address of a session's tab while the session is shown."""
    pytest.importorskip("viser")
    playwright = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM:
        pytest.skip("there is no Chromium: neither chromium nor google-chrome is on the path")
    from usvauv.cli.live.server import Show, listen, serve

    def use(address: str, act) -> None:
        software = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        with playwright.sync_playwright() as started:
            browser = started.chromium.launch(executable_path=CHROMIUM, args=software)
            act(browser, address)
            browser.close()

    def run(session: Session, act) -> None:
        with serve(listen(0), "test") as (server, address), ThreadPoolExecutor() as tabs:
            show = Show(server, session)
            tab = tabs.submit(use, address, act)
            while not tab.done():
                show.picture(0.02)
                time.sleep(0.02)
            tab.result()

    return run


@pytest.mark.slow
def test_sliders_and_choices_in_a_tab_change_the_world(running, in_tabs):
    asked = []

    def act(browser, address: str) -> None:
        page = browser.new_page(viewport={"width": 900, "height": 1000})
        page.set_default_timeout(120_000)  # on a busy machine
        page.on("request", lambda request: asked.append(request.url.replace(address, "")))
        page.goto(address)
        slider = page.get_by_role("slider").nth(2)  # after the past and the current
        while float(slider.get_attribute("aria-valuenow")) < height + 0.45:
            slider.press("ArrowRight")
            page.wait_for_timeout(200)  # a page that still loads takes back what comes faster
        page.get_by_role("combobox", name="AUVs").click()
        page.get_by_role("option", name="straight").click()
        page.get_by_role("button", name="Pause").click()
        page.get_by_text("paused").wait_for()

    running.run()
    running.speed = 1.0
    height = running.values["storm"]
    before = float(running.world.storm.amplitude.sum())
    in_tabs(running, act)
    assert running.values["storm"] == pytest.approx(height + 0.5)
    assert float(running.world.storm.amplitude.sum()) == pytest.approx(before * (height + 0.5) / height)
    assert running.policy == "straight"
    assert running.paused
    assert asked
    assert not [url for url in asked if "://" in url and not url.startswith("blob:")], "nothing comes from elsewhere"


def figure(in_tabs, session: Session, name: str) -> str:
    """A figure of the panel, as the page shows it."""
    shown = []

    def act(browser, address: str) -> None:
        page = browser.new_page()
        page.goto(address)
        row = page.locator("tr").filter(has_text=name)
        row.wait_for(state="attached", timeout=120_000)
        shown.append(row.locator("td").last.text_content())

    in_tabs(session, act)
    return shown[0]


def test_a_page_shows_what_the_rudders_of_vehicles_do(in_tabs):
    session = Session(scenario(), seed=3)
    stepped(session, 20)
    session.pause()
    shown = figure(in_tabs, session, "Rudder")
    rudder = np.degrees(session.world.body[0, :, BodyColumn.rudder].cpu().numpy())
    assert np.abs(rudder).max() > 1
    assert [float(angle) for angle in shown.rstrip("°").split(", ")] == pytest.approx(rudder, abs=0.51)


def test_a_page_of_moving_targets_shows_how_far_off_their_estimates_are(in_tabs):
    session = Session(Scenario.load("tracking-plain"), seed=3)
    stepped(session, 30)
    session.pause()
    shown = figure(in_tabs, session, "Error of targets")
    past = session.history.until(session.time, 30)
    late = [each for each in past if each.time >= session.scenario.task_numbers["settling"]]
    off = [each.tracked - each.node[:, NodeColumn.span("x", "y")] for each in late]
    expected = np.quantile(np.linalg.norm(off, axis=-1), (0.5, 0.95))
    assert [float(number) for number in re.findall(r"[\d.]+(?= m )", shown)] == pytest.approx(expected, abs=0.051)


def test_the_command_prints_the_address_that_it_opens_and_ctrl_c_ends_it(run_usvauv, monkeypatch):
    viser = pytest.importorskip("viser")
    from websockets.sync.client import connect

    received = []

    def act(address: str) -> None:
        with connect(address.replace("http", "ws").rstrip("/"), subprotocols=[f"viser-v{viser.__version__}"]) as tab:
            received.extend(len(tab.recv(timeout=60)) for _ in range(20))
        signal.raise_signal(signal.SIGINT)

    with ThreadPoolExecutor() as tabs:
        opened = []
        monkeypatch.setattr("webbrowser.open", lambda address: opened.append((address, tabs.submit(act, address))))
        code, out, err = run_usvauv("live", "extreme-torpedo", "--open", *(f"--set={each}" for each in SMALL))
        ((address, tab),) = opened
        tab.result()
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]+/", address)
    assert (code, out, err) == (130, f"live: {address} (Ctrl-C ends it)\n", "stopped\n")
    assert sum(received) > 10_000
