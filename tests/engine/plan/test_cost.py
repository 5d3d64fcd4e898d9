"""Seconds are measured on the current machine; plans are chosen by work, which is the same on all machines."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from lenses import comatic_lens
from lensfield.engine import Options, SpectralImage
from lensfield.engine.blur import METHODS
from lensfield.engine.kernels.library import NUMPY
from lensfield.engine.plan import cost
from lensfield.engine.plan.choose import make_plan, workload

LENS = comatic_lens()


@pytest.fixture
def machine(monkeypatch):
    """A simulated machine: its clock advances by `pace` seconds per reading, and by any waiting time that a test adds.
    """
    state = SimpleNamespace(pace=1e-4, now=0.0)
    ticks = itertools.count()

    def perf_counter():
        next(ticks)
        state.now += state.pace
        return state.now

    monkeypatch.setattr(cost, "_looks", ())
    monkeypatch.setattr(cost, "time", SimpleNamespace(perf_counter=perf_counter, monotonic=lambda: state.now))
    return state


def test_a_burst_of_load_has_no_lasting_effect(machine):
    machine.pace = 1.0  # during the first measurement
    busy = cost.machine_factor()
    machine.pace = 1e-4
    machine.now += 2 * cost.LOOK_AGAIN_S
    quiet = cost.machine_factor()
    assert quiet == pytest.approx(busy * 1e-4)
    machine.pace = 1.0
    machine.now += 2 * cost.LOOK_AGAIN_S
    assert cost.machine_factor() == quiet


def test_a_permanently_slower_machine_is_recognised(machine):
    quick = cost.machine_factor()
    machine.pace = 3e-4
    for _ in range(cost.LOOKS):
        machine.now += 2 * cost.LOOK_AGAIN_S
        slow = cost.machine_factor()
    assert slow == pytest.approx(3 * quick)


def test_one_uninterrupted_run_is_enough(machine, monkeypatch):
    pace = iter([1.0, 1e-4] * cost.RUNS)
    monkeypatch.setattr(cost.time, "perf_counter", lambda: machine.__setattr__("now", machine.now + next(pace))
                        or machine.now)
    assert cost._look() == pytest.approx(1e-4 / cost.REFERENCE_S)


def test_plans_in_quick_succession_share_one_measurement(machine, monkeypatch):
    looks = []
    monkeypatch.setattr(cost, "_look", lambda: looks.append(1) or 1.0)
    for _ in range(5):
        cost.machine_factor()
    assert len(looks) == 1


@pytest.mark.parametrize("accuracy", [0.1, 0.01, 1e-3])
@pytest.mark.parametrize("shape", [(40, 50), (400, 500)])
def test_every_machine_chooses_the_same_plan(accuracy, shape, monkeypatch):
    radiance, plans = SpectralImage(np.ones((1, *shape)), [550.0], pitch_um=10.0), []
    for factor in (1e-9, 1.0, 1e9):
        monkeypatch.setattr(cost, "machine_factor", lambda factor=factor: factor)
        plans.append(make_plan(Options(accuracy=accuracy), LENS, radiance.sampling))
    assert plans[0] == plans[1] == plans[2] and plans[2].seconds > 1e4 * plans[0].seconds


def test_the_seconds_of_a_plan_include_planning(monkeypatch):
    radiance = SpectralImage(np.ones((1, 40, 50)), [550.0], pitch_um=10.0)
    clock = itertools.count(0.0, 7.0)
    monkeypatch.setattr("lensfield.engine.plan.choose.time", SimpleNamespace(perf_counter=lambda: next(clock)))
    assert 7 <= make_plan(Options(), LENS, radiance.sampling).seconds < 14


def test_more_cores_shorten_all_but_single_threaded_work(monkeypatch):
    monkeypatch.setattr(cost, "machine_factor", lambda: 1.0)
    radiance = SpectralImage(np.ones((2, 400, 500)), [450.0, 550.0], pitch_um=10.0)
    plan = make_plan(Options(accuracy=0.01), LENS, radiance.sampling)
    waited = []
    for cores in (1, 2, 4, 10**9):
        monkeypatch.setattr(cost, "thread_count", lambda cores=cores: cores)
        waited.append(cost.seconds(workload(plan, LENS, radiance.sampling), plan))
    one, two, four, many = waited
    assert one - two == pytest.approx(2 * (two - four)) and 0 < many < four < two < one


@pytest.mark.parametrize("method", METHODS)
def test_every_kind_of_work_has_a_cost(method):
    radiance = SpectralImage(np.ones((1, 40, 50)), [550.0], pitch_um=10.0)
    plan = make_plan(Options(method=method), LENS, radiance.sampling)
    counts = cost.counts(workload(plan, LENS, radiance.sampling), plan)
    assert counts.keys() <= set().union(*cost.NANOSECONDS.values()) and all(0 <= n < np.inf for n in counts.values())


@pytest.mark.parametrize("accuracy", [0.1, 0.01])
def test_the_loop_variant_does_not_change_the_plan(accuracy, monkeypatch):
    radiance, plans = SpectralImage(np.ones((1, 1200, 1600)), [550.0], pitch_um=2.5), []
    for loops in (NUMPY, "base", "avx512"):
        monkeypatch.setattr(cost, "running", lambda loops=loops: loops)
        monkeypatch.setattr(cost, "machine_factor", lambda: 1e6)
        plans.append(make_plan(Options(accuracy=accuracy), LENS, radiance.sampling))
    by_numpy, base, newest = plans
    assert by_numpy == base == newest and by_numpy.seconds > base.seconds > newest.seconds
