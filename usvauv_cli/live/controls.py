"""The panel in the tab: play speed and past, sliders and choices, figures, and moving things in the scene."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from queue import SimpleQueue
from typing import Any

import numpy as np

from usvauv.cli.live.history import MOST_STATES
from usvauv.cli.live.scene import OPACITY, Scene
from usvauv.cli.live.session import Session
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.render.style import auv_colour, clock, web
from usvauv.kernels.errors import UserError

SPEEDS = {"½ ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "5 ×": 5.0, "10 ×": 10.0, "30 ×": 30.0, "as fast as possible": math.inf}
STATUS_EVERY = 0.25  # s
FIGURES_EVERY = 1.0  # s, and at most this share of the time is spent on them:
FIGURES_SHARE = 0.05
PLOTTED = 300.0  # s
COMPILING = "compiling another world, which takes some seconds …"
NARROW = 0.12  # rad, opening of the map's view, which is nearly parallel
WIDE = 0.75
SEEN_THROUGH = 0.35  # opacity of the sea on the map
LEGEND = """
**Boat** white; yellow: its goal. **AUVs** at depth; ball and ellipse (2 σ): the boat's estimates; lines: to
the estimate, white to the AUV's own estimate, thin to its node. **Nodes** green when empty, red when full.
**Arrows**: current at cruise depth.

Drag the boat or a node to move it. Shift and click: the nearest node moves there. Ctrl and click: the boat does.
"""


class Controls:
    """The panel of a session; actions in the tab wait until `serve_requests` carries them out."""

    def __init__(self, server: Any, session: Session, scene: Scene) -> None:
        self._server, self._session, self._scene = server, session, scene
        self._waiting: SimpleQueue[tuple[str, Callable[[], None], str]] = SimpleQueue()
        self._next_status = self._next_figures = 0.0
        self._pictures, self._since, self._since_time = 0, time.perf_counter(), 0.0
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()  # beside the scene, not over it
        for name, value in self._view(flat=False).items():
            setattr(server.initial_camera, "up" if name == "up_direction" else name, value)
        self._status = gui.add_markdown("")
        self._add_time(gui)
        views = gui.add_button_group("View", ("Perspective", "Map"))
        views.on_click(lambda event: self._ask("view", lambda: self._look(event.client, views.value == "Map")))
        self._plot = self._add_plot(gui)
        with gui.add_folder("Sea and sound"):
            self._sliders = {}
            for name, slider in session.sliders.items():
                value = session.values[name]
                handle = gui.add_slider(slider.label, *slider.bounds, slider.step, value, hint=slider.hint)
                self._on_change(handle, name, partial(session.set, name))
                self._sliders[name] = handle
        with gui.add_folder("Decisions"):
            self._choices = {}
            for label, options, choose, meanwhile in (
                ("Boat", session.strategies(), session.set_strategy, COMPILING),
                ("Targets", session.rules(), session.set_rule, COMPILING),
                ("AUVs", session.policies(), session.set_policy, ""),
            ):
                if options:
                    handle = gui.add_dropdown(label, tuple(options), initial_value=options[0])
                    self._on_change(handle, label, choose, meanwhile)
                    self._choices[label] = handle
        with gui.add_folder("Figures"):
            self._table = gui.add_html("")
        with gui.add_folder("What is shown", expand_by_default=False):
            gui.add_markdown(LEGEND)
        self._listen_to_scene()

    def _add_time(self, gui: Any) -> None:
        session = self._session
        self._run = gui.add_button("Pause")
        self._run.on_click(lambda _: self._ask("run", self._pause_or_run))
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1 ×")

        def set_speed() -> None:
            session.speed = SPEEDS[speed.value]

        speed.on_update(lambda _: self._ask("speed", set_speed))
        span = MOST_STATES * session.scenario.mission.step
        self._back = gui.add_slider(
            "Past, s", -span, 0.0, session.scenario.mission.step, 0.0, hint="Shows the past; Run continues from now"
        )
        self._on_change(self._back, "back", lambda seconds: session.look_back(-seconds))

    def _ask(self, about: str, action: Callable[[], None], meanwhile: str = "") -> None:
        """Let an action wait, from any thread; `meanwhile` is the status line while it runs, empty for short ones."""
        self._waiting.put((about, action, meanwhile))

    def _on_change(self, handle: Any, about: str, choose: Callable[[Any], None], meanwhile: str = "") -> None:
        """Ask for something with the value of a handle when a tab changes it."""

        def change(event: Any) -> None:
            if event.client is not None:  # not when the panel itself sets it
                self._ask(about, lambda: choose(handle.value), meanwhile)

        handle.on_update(change)

    def _add_plot(self, gui: Any) -> Any:
        from viser import uplot

        count = self._session.scenario.auv.count
        axis = uplot.Axis(stroke="#9ab", grid={"stroke": "#345", "width": 1})
        return gui.add_uplot(
            (np.zeros(1), *[np.zeros(1)] * count),
            (
                uplot.Series(label="s"),
                *(uplot.Series(label=f"AUV {k + 1}", stroke=web(auv_colour(k)), width=2) for k in range(count)),
            ),
            title=f"Error of estimated positions, m, in the last {PLOTTED:g} s",
            # A fixed span: one that follows the data is kept by each page as a share of the data that it saw first.
            scales={"x": uplot.Scale(time=False, range=(-PLOTTED, 0.0)), "y": uplot.Scale(range=(0.0, None))},
            axes=(axis, axis),
            height=170,
        )

    def _listen_to_scene(self) -> None:
        session, depth = self._session, self._session.scenario.area.depth

        def put(about: str, origin: np.ndarray, direction: np.ndarray, *index: int) -> None:
            move, height = (session.move_boat, 0.0) if about == "boat" else (session.move_node, -depth)
            place = meeting(origin, direction, height)
            if place is not None and np.isfinite(place).all():
                move(float(place[0]), float(place[1]), *index)

        def drag(about: str, index: int | None = None) -> Callable[[Any], None]:
            def moved(event: Any) -> None:
                camera, chosen = event.client.camera.position, event.instance_index if index is None else index
                put(about, camera, np.array(event.end_position) - camera, chosen)

            return lambda event: self._ask(about, lambda: moved(event))

        def click(about: str) -> Callable[[Any], None]:
            def clicked(event: Any) -> None:
                put(about, np.array(event.ray_origin), np.array(event.ray_direction))

            return lambda event: self._ask(about, lambda: clicked(event))

        for b, boat in enumerate(self._scene.boats):
            boat.on_drag(drag("boat", b))
        self._scene.nodes.on_drag(drag("node"))
        self._server.scene.on_click(modifier="shift")(click("node"))
        self._server.scene.on_click(modifier="cmd/ctrl")(click("boat"))

    def _pause_or_run(self) -> None:
        session = self._session
        if session.paused or session.ended:
            session.run()
            self._back.value = 0.0
        else:
            session.pause()

    def _view(self, flat: bool) -> dict[str, Any]:
        """Where a camera stands for the map or in perspective, and how far it sees."""
        area = self._session.scenario.area
        middle = np.array([area.width / 2, area.length / 2, 0.0])
        size = max(area.width, area.length)
        up, away = (0.0, 1.0, 0.0), np.array([0.0, 0.0, 0.62 * size / math.tan(NARROW / 2)])
        if not flat:
            middle[2] = -0.42 * min(area.depth, size)
            up, away = (0.0, 0.0, 1.0), np.array([-0.8, -1.75, 1.0]) * size
        lens = {"fov": NARROW if flat else WIDE, "far": 40 * size}
        return {**lens, "up_direction": up, "position": middle + away, "look_at": middle}

    def _look(self, client: Any, flat: bool) -> None:
        """Turn the camera of a tab to one of the views; the map shows what is below the sea."""
        self._scene.sea.opacity = SEEN_THROUGH if flat else OPACITY
        with client.atomic():
            for name, value in self._view(flat).items():
                setattr(client.camera, name, value)

    def serve_requests(self) -> None:
        """Carry out what waits, of several requests about the same the last; the tab shows refusals, and the panel the
        values now in force.
        """
        waiting: dict[str, tuple[Callable[[], None], str]] = {}
        while not self._waiting.empty():
            about, action, meanwhile = self._waiting.get()
            waiting.pop(about, None)
            waiting[about] = action, meanwhile
        for action, meanwhile in waiting.values():
            if meanwhile:
                self._status.content = f"**{clock(self._session.time)}** {meanwhile}"
            try:
                action()
            except (UserError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                # The last ones of messages that no page of viser's sends, or of a tab that has been closed.
                for client in self._server.get_clients().values():
                    client.add_notification("Refused", str(error), color="orange", auto_close_seconds=10.0)
            self._show_settings()
            self._next_status = 0.0

    def _show_settings(self) -> None:
        session = self._session
        for name, handle in self._sliders.items():
            handle.value = session.values[name]
        holding = {
            "Boat": session.world.strategy.name,
            "Targets": session.scenario.nodes.target_rule,
            "AUVs": session.policy,
        }
        for label, handle in self._choices.items():
            handle.value = holding[label]

    def show(self) -> None:
        """Count a picture; now and then show the pace and the figures."""
        self._pictures += 1
        now = time.perf_counter()
        if now >= self._next_status:
            self._show_status(now)
        if now >= self._next_figures:
            self._show_figures()
            spent = time.perf_counter() - now
            self._next_figures = now + max(FIGURES_EVERY, spent / FIGURES_SHARE)

    def _show_status(self, now: float) -> None:
        session, elapsed = self._session, max(now - self._since, 1e-6)
        if elapsed > 1.0 or not self._status.content:
            self._pace = (session.moment.time - self._since_time) / elapsed, self._pictures / elapsed
            self._pictures, self._since, self._since_time = 0, now, session.moment.time
        duration = session.world.steps * session.scenario.mission.step
        if session.ended:
            doing = f"{session.ended}; Run begins the next episode"
        elif session.back:
            doing = f"the past, {session.back:g} s before {clock(session.time)}"
        elif session.paused:
            doing = "paused"
        else:
            doing = f"{self._pace[0]:.2g} × real time · {self._pace[1]:.0f} frames/s"
        self._status.content = f"**{clock(session.moment.time)}** of {clock(duration)} · {doing}"
        self._run.label = "Run" if session.paused or session.ended else "Pause"
        self._next_status = now + STATUS_EVERY

    def _show_figures(self) -> None:
        figures, moment = self._session.figures(), self._session.moment
        own = {}
        if self._session.scenario.auv.dynamic:
            rudder, stern, propeller = moment.mixed("fins").T
            own = {
                "Depth": ", ".join(f"{depth:.1f}" for depth in moment.mixed("depth")) + " m",
                "Pitch": ", ".join(f"{pitch:+.0f}" for pitch in np.degrees(moment.mixed("attitude")[:, 1])) + "°",
                "Rudder": ", ".join(f"{angle:+.0f}" for angle in np.degrees(rudder)) + "°",
                "Stern plane": ", ".join(f"{angle:+.0f}" for angle in np.degrees(stern)) + "°",
                "Propeller": ", ".join(f"{60 * turns:.0f}" for turns in propeller) + " rpm",
            }
        self._table.content = table(figures, own) if figures else ""
        times, errors = self._session.errors(PLOTTED)
        self._plot.data = (times, *errors)


def meeting(origin: np.ndarray, direction: np.ndarray, height: float) -> np.ndarray | None:
    """Where a ray meets a height, (3,), m; None where it does not."""
    if abs(direction[2]) < 1e-9 or (height - origin[2]) / direction[2] <= 0:
        return None
    return origin + (height - origin[2]) / direction[2] * direction


def table(figures: EpisodeMetrics, more: Mapping[str, str]) -> str:
    """The figures that the panel shows, and more of them, as HTML."""
    task = figures.of_task
    rows = {"Distance to targets": f"{figures.target_distance:.1f} m"}
    if "lost_mbit" in task:
        rows = {
            "SDR": f"{figures.sdr:.1f} Mbit/s",
            "Services": f"{figures.services}, {figures.delivered_mbit:.1f} Mbit",
            "Lost at full nodes": f"{task['lost_mbit']:.2f} Mbit",
        }
    elif "track_error_median" in task:
        error = f"{task['track_error_median']:.1f} m median, {task['track_error_p95']:.1f} m p95"
        rows |= {"Error of targets": error, "Targets within 20 m": f"{task['track_close']:.1%}"}
    rows |= {
        "EC": f"{figures.ec:.0f} W",
        "Position error": f"{figures.position_error_median:.1f} m median, {figures.position_error_p95:.1f} m p95",
        "AUVs' own error": f"{figures.own_error_median:.1f} m median, {figures.own_error_p95:.1f} m p95",
        "Fixes available": f"{figures.fix_availability:.1%}",
        "Longest outage": f"{figures.outage_longest:.0f} s",
        **more,
    }
    cells = "".join(
        f'<tr><td style="opacity:.7;padding-right:1em">{name}</td><td><b>{value}</b></td></tr>'
        for name, value in rows.items()
    )
    return f'<table style="font-size:.85em;margin:.2em 1em">{cells}</table>'
