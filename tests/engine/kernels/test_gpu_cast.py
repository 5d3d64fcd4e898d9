"""Casting on a graphics processor: against C, and C in its place."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lensfield.engine.depth.cast as cast_module
from gpus import loops, warns
from lenses import make_grid_lens, make_lens
from lensfield import cli
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.depth.meetings import plan_meetings
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.kernels import gpu as gpu_module
from lensfield.engine.kernels import gpu_calls as gpu_calls_module
from lensfield.engine.kernels import gpu_cast as gpu_cast_module
from lensfield.engine.kernels.cast_tiles import cast_tiles
from lensfield.engine.kernels.gpu import GPU, VARIABLE, usable_gpu
from lensfield.engine.kernels.library import caster, running
from lensfield.engine.kernels.sample_casting import sample_casting
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.iris import Iris
from lensfield.engine.plan.options import Options
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.simulation.report import Report, together
from lensfield.engine.simulation.simulate import simulate
from refusals import refused

PITCH_UM, NM, TIMES = 16.0, (500.0, 600.0), 2
GRID = PixelGrid((75, 92), PITCH_UM, (31.3, 55.8), (11, 14))
"""Off-centre and not square; the last tiles are cut."""
SMALL_GRID = PixelGrid((34, 45), PITCH_UM, (12.3, 25.8), (4, 6))
OPTIONS = Options(accuracy=0.1)
MEAN_DIFFERENCE, LARGEST_DIFFERENCE = 1e-5, 1e-4
"""A tenth of the requested accuracy, 1 %, is 1e-3: rounding is a thousandth and a tenth of this."""


def radial_lens():
    return make_lens(object_distance_mm=700.0, magnification=-0.05)


def grid_lens(mirrored=(True, True), **changes):
    return make_grid_lens(source_mm=lambda nm, x, y: (x * (1 - 0.01 * x**2) * nm / 550, y * (1 - 0.02 * y**2)),
                          object_distance_mm=700.0, magnification=-0.05, mirrored=mirrored, **changes)


def scene(lens, grid, blurs):
    """Random rectangles at depths of these blurs in pixels, in front of a far plane."""
    random, count, layers = np.random.default_rng(5), len(NM), []
    for blur in blurs:
        rows, columns = grid.shape_px
        top, left = random.integers(0, (rows // 2, columns // 2))
        shape = tuple(random.integers(4, (rows - top + 1, columns - left + 1)))
        alpha = (random.random(shape) * (random.random(shape) < 0.8)).astype(np.float32)
        nearness = focus_nearness(lens) + blur * (1 + 0.2 * random.random(shape)) / blur_per_nearness_px(lens, PITCH_UM)
        light = random.random((count, *shape), np.float32) * alpha
        layers.append(Layer(light, alpha, 1 / nearness, (int(top), int(left))))
    sky = Layer(random.random((count, *grid.shape_px), np.float32), np.ones(grid.shape_px, np.float32),
                np.full(grid.shape_px, 1e6))
    return LayeredRadiance((*layers, sky), np.array(NM), grid, lens.capture_focal_length_mm)


def pictures(layered, lens, **options):
    rays = field_map(lens).first_order_rays(1.0)
    planes = list(cast(layered, lens, lambda: rays, **options))
    return np.array([[plane.blurred, plane.clear] for plane in planes])


def check_like_c(layered, lens, **options):
    """Assert that the graphics processor casts the same bits twice, and nearly the same picture as C."""
    once, again = (pictures(layered, lens, **options) for _ in range(2))
    assert np.array_equal(once, again)
    with loops():
        by_c = pictures(layered, lens, **options)
    assert by_c[:, 0].std() > 0.01 * by_c[:, 0].max()
    for one, other in zip(np.moveaxis(once, 1, 0), np.moveaxis(by_c, 1, 0), strict=True):
        difference = np.abs(one - other)
        assert difference.sum() <= MEAN_DIFFERENCE * np.abs(other).sum()
        assert difference.max() <= LARGEST_DIFFERENCE * np.abs(other).max()
    assert not np.array_equal(once, by_c), "C has cast this"


@pytest.mark.parametrize("blurs", [(40.0, 12.0, 3.0, 0.4), (-14.0,)])
def test_rays_of_heights_between_blades(gpu, blurs):
    lens = radial_lens()
    check_like_c(scene(lens, GRID, blurs), lens, most_rays=32, iris=Iris(5, 20.0, 0.3))


def test_rays_of_heights_in_a_panorama(gpu):
    lens, grid = radial_lens(), replace(GRID, projection=FISHEYE)
    check_like_c(scene(lens, grid, (12.0, 3.0, 0.4)), lens, most_rays=32)


@pytest.mark.parametrize("mirrored", [(False, False), (True, True)])
def test_rays_of_a_mesh(gpu, mirrored):
    lens = grid_lens(mirrored)
    check_like_c(scene(lens, SMALL_GRID, (14.0, 3.0, 0.4)), lens, most_rays=16, iris=Iris(7, 10.0, 0.2))


def test_rays_of_a_mesh_in_a_squeezed_panorama(gpu):
    lens, grid = grid_lens((True, False), squeeze=1.5), replace(SMALL_GRID, projection=FISHEYE, squeeze=1.5)
    check_like_c(scene(lens, grid, (14.0, 0.4)), lens, most_rays=16)


@pytest.mark.parametrize("step", [2, 3, 4, 16])
def test_pixels_between_those_that_are_cast(gpu, monkeypatch, step):
    lens = radial_lens()

    def planned(*given):
        meetings = plan_meetings(*given)
        return replace(meetings, steps=np.full_like(meetings.steps, step))

    monkeypatch.setattr(cast_module, "plan_meetings", planned)
    check_like_c(scene(lens, GRID, (40.0, 12.0)), lens, most_rays=32)


def test_parts_of_pixels(gpu):
    lens = radial_lens()
    lamp = np.full([TIMES * n for n in GRID.shape_px], 0.01, np.float32)
    lamp[71:76, 85:90] = 1
    light = np.stack([lamp, 3 * lamp])
    whole = Layer(merged(light, TIMES), np.ones(GRID.shape_px, np.float32),
                  np.full(GRID.shape_px, 1 / (focus_nearness(lens) + 4 / blur_per_nearness_px(lens, PITCH_UM))),
                  detail=Detail.of(light, NM, TIMES))
    check_like_c(LayeredRadiance((whole,), np.array(NM), GRID, lens.capture_focal_length_mm), lens, most_of_lamps=256)


@pytest.mark.parametrize("mesh", [False, True])
def test_neither_calls_nor_bands_nor_pieces_change_the_bits(gpu, monkeypatch, mesh):
    expected = sample_pictures(mesh)
    monkeypatch.setattr(gpu, "rate", 1.0)  # a workgroup in a call
    monkeypatch.setattr(gpu_module, "FASTER", 1.0)
    monkeypatch.setattr(gpu_cast_module, "BAND_SUMS", 1)  # a row of tiles in a band
    monkeypatch.setattr(gpu_calls_module, "PIECE_BYTES", 1000)
    fractions = []
    assert np.array_equal(sample_pictures(mesh, fractions), expected)
    assert len(fractions) > 10 and fractions == sorted(fractions) and fractions[-1] == 1


def sample_pictures(mesh=False, fractions=None):
    casting = sample_casting(2, mesh)
    planes = np.full((2, 2, 30, 45), 7, np.float32)
    for fraction in cast_tiles(casting, *planes):
        if fractions is not None:
            fractions.append(fraction)
    return planes


def test_many_rays_are_followed_in_several_calls(gpu):
    """Mesa's emulation silently ends loops after 65,535 iterations."""
    few, times = sample_casting(2, False), 50
    rays = replace(few.rays, values=few.rays.values.repeat(times, axis=1))
    many = replace(few, rays=rays, layers=few.layers * 5, meetings=np.tile(few.meetings, 5),
                   first_eights=0 * few.eights, eights=np.where(few.eights == 1, times * 3, 1))
    planes, by_c = np.zeros((2, 2, 2, 30, 45), np.float32)
    list(cast_tiles(many, *planes))
    with loops():
        list(cast_tiles(many, *by_c))
    assert np.abs(planes - by_c).max() < LARGEST_DIFFERENCE


def test_tiles_without_rays_are_not_written(gpu):
    casting, planes = sample_casting(2, False), np.full((2, 2, 30, 45), 7, np.float32)
    casting.eights[0, 1] = 0
    list(cast_tiles(casting, *planes))
    unwritten = planes == 7
    assert unwritten[..., :16, 16:32].all() and unwritten.sum() == 4 * 16 * 16


def test_a_casting_ends_between_calls(gpu, monkeypatch):
    """Closed, it frees its buffers; the next one is complete."""
    expected, closed = sample_pictures(), []
    monkeypatch.setattr(gpu_calls_module.Buffers, "close", lambda buffers: closed.extend(buffers._buffers))
    monkeypatch.setattr(gpu, "rate", 1.0)
    casting = cast_tiles(sample_casting(2, False), *np.zeros((2, 2, 30, 45), np.float32))
    of_casting = {gpu_cast_module.LENS, gpu_cast_module.SUMS}
    assert 0 < next(casting) < 1
    closed.clear()  # those of levels
    casting.close()
    assert of_casting <= set(closed)
    monkeypatch.undo()
    monkeypatch.setenv(VARIABLE, GPU)
    assert np.array_equal(sample_pictures(), expected)


def sample_by_c():
    with loops():
        return sample_pictures()


def test_a_shader_that_disagrees_with_c_is_not_used(gpu, monkeypatch):
    monkeypatch.setattr(gpu, "pipelines", {})
    monkeypatch.setattr(gpu_calls_module, "AGREEMENT", 0.0)
    with warns(gpu, "differently from C"):
        assert np.array_equal(sample_pictures(), sample_by_c())
        assert np.array_equal(sample_pictures(), sample_by_c())
        assert caster() == "C"


def test_a_driver_that_fails_during_a_casting_loses_nothing(gpu, monkeypatch):
    run, calls = gpu_calls_module.Buffers.run, []

    def failing(*given):
        calls.append(given)
        if len(calls) > 3:
            raise RuntimeError("Device lost\nwhile it was in use")
        return run(*given)

    monkeypatch.setattr(gpu_calls_module.Buffers, "run", failing)
    monkeypatch.setattr(gpu, "rate", 1.0)
    with warns(gpu, "Device lost while it was in use"):
        assert np.array_equal(sample_pictures(), sample_by_c())
        assert np.array_equal(sample_pictures(), sample_by_c())


def test_layers_above_the_limits_are_cast_by_c(gpu, monkeypatch):
    monkeypatch.setattr(gpu, "limit_bytes", 20_000)
    with warns(gpu, "MB"):
        assert np.array_equal(sample_pictures(), sample_by_c())
        assert np.array_equal(sample_pictures(), sample_by_c())
    monkeypatch.undo()
    monkeypatch.setenv(VARIABLE, GPU)
    assert caster() == gpu.name and not np.array_equal(sample_pictures(), sample_by_c())


def test_without_the_variable_emulations_are_not_used(gpu, searched_again, monkeypatch):
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setattr(gpu_module, "REAL", ())
    assert usable_gpu() is None and caster() == "C"
    gpu_module._opened.cache_clear()
    monkeypatch.setattr(gpu_module, "REAL", gpu_module.KINDS)
    assert caster() == gpu.name
    monkeypatch.setenv(VARIABLE, running())
    assert usable_gpu() is None and caster() == "C"


def test_forked_processes_cast_by_c(gpu, monkeypatch):
    monkeypatch.setattr(gpu_module, "PROCESS", -1)
    assert caster() == "C" and np.array_equal(sample_pictures(), sample_by_c())


def test_a_device_that_cannot_be_opened_is_not_used(gpu, searched_again, monkeypatch):
    def fails(adapter):
        raise OSError("no such device")

    monkeypatch.setattr(gpu_module, "Gpu", fails)
    with warns(gpu, "no such device"):
        assert np.array_equal(sample_pictures(), sample_by_c())


@pytest.mark.parametrize("problem, words", [
    (ImportError("no wgpu"), "the Python package wgpu is not installed"),
    (OSError("GLIBC_2.99 not found"), "the Python package wgpu fails: GLIBC_2.99 not found"),
    (None, "this machine has no graphics adapter for Vulkan, Metal or Direct3D 12")])
def test_the_variable_is_refused_without_an_adapter(searched_again, monkeypatch, capsys, problem, words):
    def search():
        if problem:
            raise problem
        return []

    monkeypatch.setattr(gpu_module, "_search", search)
    monkeypatch.setenv(VARIABLE, GPU)
    with refused(InputError, field=VARIABLE, value=GPU, where="environment"):
        running()
    assert cli.main(["--version"]) == 2
    assert f"environment: LENSFIELD_KERNELS is gpu: {words}\n" in capsys.readouterr().err
    monkeypatch.delenv(VARIABLE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert usable_gpu() is None


def test_command_and_reports_name_the_device(gpu, capsys):
    assert cli.main(["--version"]) == 0
    with loops():
        assert cli.main(["--version"]) == 0
    named, surroundings, plain, same = capsys.readouterr().out.splitlines()
    assert surroundings == same
    assert named == plain.replace(")", f"; casting, filter: {gpu.name})")
    lens = radial_lens()
    layered = scene(lens, SMALL_GRID, (12.0,))
    by_gpu, by_c, flat = Report(), Report(), Report()
    simulate(layered, lens, OPTIONS, report=by_gpu)
    simulate(SpectralImage(np.ones((2, 9, 9)), NM, pitch_um=PITCH_UM), lens, OPTIONS, report=flat)
    with loops():
        simulate(layered, lens, OPTIONS, report=by_c)
    assert [report.as_dict()["casting"] for report in (by_gpu, by_c, flat)] == [gpu.name, "C", ""]
    different = f"frames were cast by C (2), {gpu.name} (1): they differ by rounding"
    assert different in together({1: by_gpu, 2: by_c}, {3: by_c.as_dict(), 4: {}}).remarks()
    assert different not in together({1: by_c, 2: flat}, {3: by_c.as_dict()}).remarks()


def test_a_report_states_why_c_has_cast(gpu, monkeypatch):
    monkeypatch.setattr(gpu, "limit_bytes", 2_000)
    lens, report = radial_lens(), Report()
    with warns(gpu, "MB"):
        simulate(scene(lens, SMALL_GRID, (12.0,)), lens, OPTIONS, report=report)
    line, = report.lens_image.gpu_problems
    assert line in report.remarks() and line.startswith(f"{gpu.name}: cannot hold a table of ")
