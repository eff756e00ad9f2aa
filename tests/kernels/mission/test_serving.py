"""Which boat serves which AUV, and where boats begin: beside NumPy."""

from types import SimpleNamespace

import numpy as np
import taichi as ti

from tests.kernels.mission.stub import StubWorlds, unchanged
from usvauv.kernels.mission import serving
from usvauv.kernels.mission.columns import BoatColumn, EstimateColumn

WORLDS, AUVS, BOATS = 100, 6, 3
FLEET = SimpleNamespace(fleet=True)


def fleet(device) -> StubWorlds:
    r = np.random.default_rng(1)
    boat = r.uniform(0, 100, (WORLDS, BOATS, len(BoatColumn.names)))
    estimate = r.uniform(0, 100, (WORLDS, AUVS, len(EstimateColumn.names)))
    estimate[..., EstimateColumn.served_by] = r.integers(0, BOATS, (WORLDS, AUVS))
    return StubWorlds(device, {}, worlds=WORLDS, auvs=AUVS, boats=BOATS, boat=boat, estimate=estimate)


def test_an_auv_changes_to_a_boat_that_is_nearer_by_a_quarter(device):
    @ti.func
    def allot(worlds: ti.template(), w):
        serving.allot(worlds, w, 0.25)

    made = fleet(device)
    before, after = made.numbers(), made.after(allot, FLEET)
    boats, places = before["boat"][..., : BoatColumn.y + 1], before["estimate"][..., : EstimateColumn.y + 1]
    away = np.linalg.norm(places[:, :, None] - boats[:, None], axis=-1)
    by = before["estimate"][..., EstimateColumn.served_by].astype(int)[..., None]
    np.put_along_axis(away, by, 0.75 * np.take_along_axis(away, by, 2), 2)
    np.testing.assert_array_equal(after["estimate"][..., EstimateColumn.served_by], away.argmin(2))
    assert 0.2 < (away.argmin(2) == by[..., 0]).mean() < 0.8
    unchanged(after, before, {"estimate": [EstimateColumn.served_by]})


def test_boats_begin_in_the_middle_of_groups(device):
    """The first at AUV 0, each other one at the AUV farthest from those before it; then means and nearest in turn."""
    made = fleet(device)
    before, after = made.numbers(), made.after(serving.split, FLEET)
    for w in range(WORLDS):
        places = before["estimate"][w, :, : EstimateColumn.y + 1]
        boats, by = places[:1], before["estimate"][w, :, EstimateColumn.served_by]
        while len(boats) < BOATS:
            away = np.linalg.norm(places[:, None] - boats[None], axis=-1).min(1)
            boats = np.concatenate([boats, places[[away.argmax()]]])
        for _ in range(serving.LLOYD_ITERATIONS):
            by = np.linalg.norm(places[:, None] - boats[None], axis=-1).argmin(1)
            boats = np.array([places[by == b].mean(0) if (by == b).any() else boats[b] for b in range(BOATS)])
        np.testing.assert_allclose(after["boat"][w, :, : BoatColumn.y + 1], boats, rtol=1e-5)
        np.testing.assert_array_equal(after["estimate"][w, :, EstimateColumn.served_by], by)
    unchanged(after, before, {"boat": [BoatColumn.x, BoatColumn.y], "estimate": [EstimateColumn.served_by]})


def test_who_is_served(device):
    """Numbers and means of all boats, also of one that serves nobody; a boat alone serves all."""

    @ti.func
    def count(worlds: ti.template(), w):
        for b in range(worlds.boat.shape[1]):
            middle = serving.middle(worlds, w, b)
            worlds.boat[w, b, BoatColumn.goal_x] = middle[0]
            worlds.boat[w, b, BoatColumn.goal_y] = middle[1]
            worlds.boat[w, b, BoatColumn.visits] = serving.num_served(worlds, w, b)

    for alone in (False, True):
        made = fleet(device)
        before, after = made.numbers(), made.after(count, SimpleNamespace(fleet=not alone))
        for w, b in np.ndindex(WORLDS, BOATS):
            mine = alone | (before["estimate"][w, :, EstimateColumn.served_by] == b)
            places = before["estimate"][w, mine, : EstimateColumn.y + 1]
            wanted = places.mean(0) if len(places) else before["boat"][w, b, : BoatColumn.y + 1]
            found = after["boat"][w, b, [BoatColumn.goal_x, BoatColumn.goal_y, BoatColumn.visits]]
            np.testing.assert_allclose(found, [*wanted, len(places)], rtol=1e-5)
        assert (after["boat"][..., BoatColumn.visits] == 0).any() != alone
