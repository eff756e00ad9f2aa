"""Recorded missions that play in a cell of a notebook."""

from __future__ import annotations

from dataclasses import dataclass, field

from markupsafe import Markup

from usvauv.cli.evaluation.comparison import labels
from usvauv.cli.web_report import document
from usvauv.cli.web_report.episodes import collects_data, player_data, thinned
from usvauv.env.record.trace import Trace
from usvauv.env.storage.tables import Combination
from usvauv.kernels.errors import UserError

SHARE = 4  # of the data of a report's player, that of a cell has one part in so many
WIDE = 640  # px
TALL = 900  # px, until the page in it says how tall it is
FRAME = Markup('<iframe title="{}" srcdoc="{}" style="width:100%;max-width:{}px;height:{}px;border:0"></iframe>')


@dataclass(frozen=True)
class Player:
    """What a cell of a notebook shows of recorded missions: world 0 of each. The page in it needs nothing else.

    Attributes:
        traces: to choose from, of missions in one area.
    """

    traces: tuple[Trace, ...] = field(repr=False)

    def _repr_html_(self) -> str:
        scenario = self.traces[0].scenario
        episodes = [thinned(trace, SHARE * len(self.traces)) for trace in self.traces]
        names = labels([Combination(each.policy, each.usv, _rule(each)) for each in self.traces])
        player = document.json_for_script(player_data(scenario, names, episodes))
        page = document.filled(
            "web_report/cell.html",
            policy=document.NOTHING_EXTERNAL,
            style=document.style(),
            player=document.block("web_report/page.html", "player", player=player, shown=episodes[0]),
            script=Markup(document.text("web_report/player.js")),
        )
        return FRAME.format(f"{scenario.name}: {', '.join(names)}", page, WIDE, TALL)


def play(*traces: Trace) -> Player:
    """Recorded missions as a player in a notebook: boat, AUVs, nodes and estimates, as in the page of `usvauv eval`.

    In IPython a trace that ends a cell is shown so by itself.

    Args:
        traces: one, or several to choose from, such as of the same world with different strategies.

    Raises:
        UserError: there is none, or their areas differ.
    """
    areas = {(each.scenario.area.width, each.scenario.area.length, each.scenario.current.period) for each in traces}
    if len(areas) != 1:
        raise UserError(f"traces: of {len(areas)} areas; must be of one")
    return Player(traces)


def _rule(trace: Trace) -> str:
    return trace.scenario.nodes.target_rule if collects_data(trace.scenario) else ""
