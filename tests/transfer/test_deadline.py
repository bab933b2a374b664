"""`seconds`: chunks keep the deadline, evenly, whatever the machine does; what cannot be kept is refused first."""

import itertools
import math
import re
import time
from dataclasses import replace

import pytest
import torch
from tolerances import relative_error

from diffprt.errors import InputError
from diffprt.options.bake import BakeSettings
from diffprt.scene import builtin_scene
from diffprt.surface import Receivers, Surfaces
from diffprt.transfer import bake, prepare
from diffprt.transfer.baking import deadline as deadlines
from diffprt.transfer.baking.deadline import AIM, FEWEST_RAYS, LADDER, MOST_RAYS, Cost, Deadline, Pace, spread
from diffprt.transfer.diffuse.cost import measured_cost, straight


class Clock:
    """Time that passes where the test says so."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(deadlines, "time", made)
    return made


SECONDS, CHUNKS, SIDES = 30.0, 200, 100
COST = Cost(side=1e-5, ray=1e-6, tail=lambda rays: 0.5 + 1e-4 * rays)


def run(clock: Clock, slowness, start: float = 3.0, cost: Cost = COST) -> tuple[float, list[int]]:
    """A pass on two threads, whose chunks take `slowness(share of the time)` times what the cost says.

    Returns:
        seconds from begin to end, what follows the pass included, and the rays of each chunk.
    """
    deadline = Deadline(SECONDS, clock.now)
    clock.now += start
    pace = Pace(deadline, cost, CHUNKS * SIDES, cost.affordable(CHUNKS * SIDES, deadline), threads=2)
    rays, running = [], []

    def slow() -> float:
        return slowness((clock.now - deadline.begun) / SECONDS)

    for chunk in range(CHUNKS):
        rays.append(pace.begin(chunk, SIDES))
        # Two at a time, each at half of the machine's speed.
        running.append((clock.now + 2 * slow() * cost.trace(SIDES, rays[-1]), chunk))
        if len(running) == 2 or chunk == CHUNKS - 1:
            for end, done in sorted(running):
                clock.now = max(clock.now, end)
                pace.end(done)
            running = []
    clock.now += slow() * cost.tail(min(rays))
    return clock.now - deadline.begun, rays


def test_a_steady_machine_keeps_its_rays_and_uses_its_time(clock):
    seconds, rays = run(clock, lambda share: 1.0)
    assert len(set(rays)) == 1 and rays[0] in LADDER
    assert 0.7 * SECONDS < seconds <= AIM * SECONDS


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3, 2.0, 3.0])
def test_a_trial_that_was_wrong_is_put_right(clock, factor):
    """All chunks take longer, or less long, than the trial said."""
    seconds, rays = run(clock, lambda share: factor)
    assert 0.7 * SECONDS < seconds <= SECONDS
    later = rays[CHUNKS // 4 :]
    fair = sorted(later)[len(later) // 2]
    assert all(0.6 * fair <= r <= 1.7 * fair for r in later), "all but the first chunks take about the same"


@pytest.mark.parametrize("onset", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("factor", [2.0, 4.0])
def test_a_machine_that_turns_slow_still_ends_in_time(clock, onset, factor):
    seconds, rays = run(clock, lambda share: factor if share > onset else 1.0)
    assert 0.7 * SECONDS < seconds <= 1.3 * SECONDS
    assert min(rays) >= rays[0] / 8, "what comes late is not left with next to nothing"
    assert all(later <= before for before, later in itertools.pairwise(rays)), "nothing is gained where time is lost"
    assert min(rays) >= FEWEST_RAYS


def test_a_machine_that_stands_still_is_left_the_fewest_rays(clock):
    _, rays = run(clock, lambda share: 1.0 if share < 0.3 else 200.0)
    assert rays[-1] == FEWEST_RAYS


def test_making_patterns_is_no_slowness(clock):
    """Taken for it, one led to the next, each of fewer rays."""
    deadline = Deadline(SECONDS, clock.now)
    pace = Pace(deadline, COST, CHUNKS * SIDES, COST.affordable(CHUNKS * SIDES, deadline), threads=2)
    first = pace.rays
    for chunk in range(CHUNKS // 2):
        rays = pace.begin(chunk, SIDES)
        assert rays == first
        if chunk in (1, 2):
            clock.now += 0.5
            pace.waited(0.5)
            pace.waited(0.5)
        clock.now += COST.trace(SIDES, rays)
        pace.end(chunk)


def test_what_follows_is_left_its_time(clock):
    """A tail of half of the time, from a bake whose bounces trace again."""
    cost = Cost(side=0.0, ray=1e-6, tail=lambda rays: 2e-2 * rays)
    seconds, _ = run(clock, lambda share: 1.0, cost=cost)
    assert 0.7 * SECONDS < seconds <= AIM * SECONDS
    assert cost.then(1000).tail(64) == pytest.approx(cost.tail(64) + cost.trace(1000, 64))


def test_the_ladder_is_of_whole_packets():
    assert LADDER[0] == FEWEST_RAYS and LADDER[-1] == MOST_RAYS
    assert all(rays % 16 == 0 for rays in LADDER)
    assert all(a < b <= 1.5 * a for a, b in itertools.pairwise(LADDER))


@pytest.mark.parametrize("chunks", [1, 2, 7, 64, 100])
def test_any_first_chunks_lie_everywhere(chunks):
    order = spread(chunks)
    assert sorted(order) == list(range(chunks))
    first = sorted(order[: max(1, chunks // 4)])
    gaps = [b - a for a, b in itertools.pairwise([-1, *first, chunks])]
    assert max(gaps) <= 2 * chunks / len(first)


@pytest.mark.parametrize(("few", "many"), [(0.010, 0.1), (0.1, 0.010), (0.05, 0.05), (0.0, 0.0)])
def test_trials_that_come_out_in_the_wrong_order_still_rise(few, many):
    """Two trials of milliseconds inverted, and 262,144 rays were chosen where a thousand had fitted."""
    side, ray = straight(64, few, 1024, many)
    assert side >= 0 and ray > 0
    assert ray >= max(few, many) / 1024 / 2
    assert side + ray * 1024 >= 0.5 * max(few, many)


def test_cost_is_that_of_a_bake(bumpy):
    """Within a factor of three, on a machine that others may share."""
    surfaces = Surfaces.of(bumpy)
    cost, entries = measured_cost(
        surfaces, surfaces.receivers, BakeSettings(order=4, bounces=1), 2, stored=True, fit=lambda _: 8192
    )
    assert entries > 0
    report: dict = {}
    bake(bumpy, order=4, bounces=1, rays=8192, threads=2, report=report)
    taken = report["timings"]["visibility and transfer"]
    assert taken / 3 < cost.trace(surfaces.receivers.sides, 8192) < 3 * taken


@pytest.mark.parametrize("bounces", [0, 1, "converged"])
def test_seconds_are_kept_and_reported(bumpy, bounces):
    report: dict = {}
    begun = time.monotonic()
    transfer = bake(bumpy, order=4, bounces=bounces, seconds=2.0, report=report)
    taken = time.monotonic() - begun
    assert 0.5 < taken < 3.0
    assert 0 < transfer.certificate["estimated_error"] < 0.1
    rays = transfer.settings["rays"]
    assert rays in LADDER and report["settings"]["rays"] == rays
    fine = bake(bumpy, order=4, bounces=bounces, rays=2048, seed=9)
    assert relative_error(transfer.diffuse, fine.diffuse) < 1.1 * transfer.certificate["expected_error"] + 0.005


@pytest.mark.parametrize("operator", ["stored", "recompute"])
def test_rays_that_change_on_the_way_leave_the_same_signal(monkeypatch, operator):
    """Chunks of many numbers of rays: each receiver's transfer is that of a bake with its own number."""
    scene = builtin_scene("cornell", subdivisions=3)
    given = itertools.cycle((64, 32, 128, 96))
    monkeypatch.setattr(Pace, "_settled", lambda self, sides: next(given))
    options = {"order": 3, "bounces": 2, "operator": operator, "threads": 1, "fill_inside": False}
    mixed = bake(scene, **options, seconds=4)
    found = mixed.certificate
    assert (found["rays_fewest"], found["rays_most"]) == (32, 128) and 32 < found["rays_mean"] < 128
    assert mixed.settings["rays"] == 32
    whole = {rays: bake(scene, **{**options, "bounces": 0}, rays=rays).openness for rays in (32, 64, 96, 128)}
    same = torch.stack([(mixed.openness - part).abs() < 1e-6 for part in whole.values()])
    assert bool(same.any(0).all()), "every receiver has direct transfer of one of the numbers"
    assert int(same[0].sum()) < len(mixed.openness)
    fine = bake(scene, **{**options, "operator": "stored"}, rays=1024)
    assert relative_error(mixed.diffuse, fine.diffuse) < 0.2


def test_free_receivers_share_the_time(bumpy):
    """The scene's own vertices are traced first, for what they reflect."""
    points = Receivers.points(bumpy.meshes[0].positions * 1.01, bumpy.meshes[0].normals)
    begun = time.monotonic()
    transfer = bake(bumpy, order=3, bounces=1, seconds=2.0, receivers=points)
    assert 0.6 < time.monotonic() - begun < 3.0
    assert transfer.settings["rays"] >= FEWEST_RAYS


def test_what_does_not_fit_is_refused_first_and_the_least_fits():
    scene = builtin_scene("bunny")
    begun = time.monotonic()
    with pytest.raises(InputError, match="too short") as refused:
        bake(scene, order=4, bounces=1, seconds=0.05)
    assert time.monotonic() - begun < 5
    least = float(re.search(r"give at least ([0-9.]+) seconds", str(refused.value))[1])
    assert 0.05 < least < 10
    # Other processes may begin in between.
    assert bake(scene, order=4, bounces=1, seconds=1.5 * least).settings["rays"] >= FEWEST_RAYS


def test_memory_is_looked_at_where_the_clock_chose_the_rays(bumpy, monkeypatch):
    monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1 << 20)
    with pytest.raises(InputError, match="GiB are free"):
        bake(bumpy, order=3, bounces=1, seconds=4)


def test_open_scenes_and_planned_ones_take_no_time_at_all():
    scene = builtin_scene("sphere", subdivisions=2)
    from diffprt.planning import plan

    decided = plan(scene, 0.01)
    assert not decided.shadows.value
    transfer = bake(scene, plan=decided, seconds=0.001)
    assert math.isclose(float(transfer.openness.min()), 1.0, abs_tol=1e-6)


def test_a_checkpoint_is_refused_beside_seconds(bumpy, tmp_path):
    with pytest.raises(InputError, match=r"checkpoint is .* and seconds is 3"):
        prepare(bumpy, seconds=3).run(checkpoint=tmp_path / "parts")
    assert not (tmp_path / "parts").exists()


def test_a_bake_may_wait_between_preparing_and_running():
    # Of some thousand receivers: with a few hundred, making patterns of 100,000 rays is most of four seconds.
    job = prepare(builtin_scene("bunny", subdivisions=0), order=4, bounces=1, seconds=4)
    assert job.settings.rays > FEWEST_RAYS
    # As if a minute had passed.
    job.deadline = replace(job.deadline, begun=job.deadline.begun - 60)
    begun = time.monotonic()
    done = job.run()
    assert done.settings["rays"] > 4 * FEWEST_RAYS
    assert time.monotonic() - begun < 6


def test_the_clock_may_have_begun_before(bumpy):
    with pytest.raises(InputError, match=r"6[0-9] s have gone to the start"):
        _ = prepare(bumpy, seconds=30, begun=time.monotonic() - 60).settings
