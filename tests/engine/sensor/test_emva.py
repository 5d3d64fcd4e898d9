"""Cameras judged by emva1288, if installed by `make test-sensor`; and the figures in docs/camera.md."""

import re
from dataclasses import replace
from functools import cache

import pytest

from lensfield.engine.library.bodies import load_camera
from places import ROOT
from seed import SEED
from sensor_emva import FIGURES, QUICK, SENSORS, TABLE, Bench, Series, evaluate, figures, intervals

SERIES = replace(QUICK, seed=SEED)
CELL = re.compile(r"([\d.]+): \*\*([\d.]+)\*\*<br>([\d.]+) to ([\d.]+)")
sensors = pytest.mark.parametrize("column, sensor", list(enumerate(SENSORS)), ids=[name for name, _ in SENSORS])


@cache
def page():
    """Rows of the table of figures."""
    lines = TABLE.search((ROOT / "docs/camera.md").read_text(encoding="utf-8"))[2].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def stated(column):
    """Of a camera in the page, for each figure by name: texts of its own, the evaluated, and the interval's ends."""
    return {name: CELL.fullmatch(row[1 + column]).groups() for name, row in zip(FIGURES, page()[2:], strict=True)}


@sensors
def test_the_page_states_the_cameras_own_figures(column, sensor):
    camera, iso = sensor
    assert page()[0][1 + column] == f"{camera}, ISO {iso:g}"
    for name, ends in intervals(Bench(load_camera(camera), iso, Series())).items():
        own, _, low, high = stated(column)[name]
        assert (own, low, high) == tuple(f"{value:.{FIGURES[name][1]}f}" for value in ends), name


@sensors
def test_the_evaluator_returns_the_cameras_figures_and_those_of_the_page(column, sensor):
    pytest.importorskip("emva1288", reason="the judge of sensors is emva1288: make test-sensor")
    bench = Bench(load_camera(sensor[0]), sensor[1], SERIES)
    for figure in figures(bench, evaluate(bench)[1]):
        assert not figure.missed, figure
        _, evaluated, low, high = map(float, stated(column)[figure.name])
        assert abs(figure.evaluated - evaluated) <= max(figure.high - low, high - figure.low), figure


def test_the_evaluator_finds_a_camera_with_other_figures():
    pytest.importorskip("emva1288", reason="the judge of sensors is emva1288: make test-sensor")
    camera = load_camera("sony-a7-iii")
    other = replace(camera, gain_dn_per_e=1.1 * camera.gain_dn_per_e, dsnu_e=3 * camera.dsnu_e,
                    prnu=2 * camera.prnu, quantum_efficiency=0.9 * camera.quantum_efficiency,
                    dark_current_e_per_s=2 * camera.dark_current_e_per_s, dark_noise_e=3 * camera.dark_noise_e)
    bench, truth = (Bench(each, 800.0, SERIES) for each in (other, camera))
    values = evaluate(bench)[1]
    assert not any(figure.missed for figure in figures(bench, values))
    missed = {figure.name for figure in figures(truth, values) if figure.missed}
    assert missed >= {"K", "QE", "σ_d", "DSNU1288", "PRNU1288", "μ_I"}
