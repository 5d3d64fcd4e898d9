"""What does not depend on light is computed while Cycles renders it, for exactly the light that the lens will get."""

import threading

import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render import render
from lensfield.engine import ChannelCache, LensError, Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.stray.options import StrayOptions
from small_scenes import light, material, set_world, wall

OPTIONS = {"wavelengths_nm": [450.0, 550.0, 600.0, 650.0], "lens_quality": "preview", "lens": "tessar-50mm",
           "stray": StrayOptions("veil,ghosts")}


@pytest.fixture
def deep(scene):
    """A wall behind a near square, and a lamp beyond the picture; the picture is neither square nor centred."""
    set_world(scene, (0.2, 0.4, 0.9), 0.5)
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2)).location = (2.0, 0.4, -0.5)
    wall(scene, material("Far", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0], 4.0)
    wall(scene, material("Near", "ShaderNodeBsdfDiffuse", (0.1, 0.3, 0.5))[0], 0.5, 0.1)
    scene.cycles.samples, scene.camera.data.shift_x = 64, 0.05
    return scene


@pytest.fixture
def cache(monkeypatch):
    """The cache of this test's renders."""
    new = ChannelCache()
    monkeypatch.setattr(render, "shared_cache", lambda: new)
    return new


def irradiance(result):
    return read_exr(result.irradiance).cube


@pytest.mark.parametrize("depth, detail", [("off", "off"), ("off", "on"), ("auto", "off"), ("auto", "on")])
def test_the_expected_light_is_the_light_that_the_lens_gets(deep, tmp_path, monkeypatch, cache, depth, detail):
    expected, light_of = [], []
    prepare, through = render.preparation, render.lens_image
    monkeypatch.setattr(render, "preparation", lambda of, *given: expected.append(of) or prepare(of, *given))

    def noted(radiance, *given, layers, outside, **named):
        light_of.append((layers or radiance, radiance, outside, bool(layers)))
        return through(radiance, *given, layers=layers, outside=outside, **named)

    monkeypatch.setattr(render, "lens_image", noted)
    addon.render_through_lens(deep, output_folder=tmp_path, depth=depth, options=Options(detail=detail), **OPTIONS)
    (of,), ((through_lens, radiance, outside, layered),) = expected, light_of
    assert layered == of.layered == (depth == "auto") and of.outside is outside and len(outside)
    assert of.sampling == through_lens.sampling and of.grid == radiance.grid
    assert (of.detail_times, of.across) == (through_lens.detail_times, through_lens.grid.across)
    assert (of.detail_times > 1) == (detail == "on") and of.needed_bytes > radiance.cube.nbytes


def test_a_prepared_render_has_the_same_bits(deep, tmp_path, monkeypatch, cache):
    prepared = irradiance(addon.render_through_lens(deep, output_folder=tmp_path / "prepared", **OPTIONS))
    monkeypatch.setattr(render, "preparation", lambda *given: iter(()))
    monkeypatch.setattr(render, "shared_cache", ChannelCache)
    unprepared = irradiance(addon.render_through_lens(deep, output_folder=tmp_path / "unprepared", **OPTIONS))
    np.testing.assert_array_equal(prepared, unprepared)


def test_closing_the_steps_ends_the_preparation(deep, tmp_path, monkeypatch, cache):
    """Between two passes."""
    taken = []

    def endless(*given):
        while True:
            taken.append(threading.current_thread())
            yield

    monkeypatch.setattr(render, "preparation", endless)
    steps = render.render_steps(deep, render.job_of_frame(deep, 1, output_folder=tmp_path, depth="off", **OPTIONS))
    step = next(steps)
    while not taken:
        assert not isinstance(step, RenderPass)  # it has begun before the first pass
        step = steps.send(step.call(lambda fraction, label=None: None))
    steps.close()
    assert not taken[0].is_alive() and taken[0] is not threading.main_thread()


def test_an_error_of_the_preparation_is_the_error_of_the_render(deep, tmp_path, monkeypatch, cache):
    def failing(*given):
        raise LensError("tessar-50mm", "glass", "N-BK7", "unknown")
        yield

    monkeypatch.setattr(render, "preparation", failing)
    with pytest.raises(LensError, match="N-BK7"):
        addon.render_through_lens(deep, output_folder=tmp_path, depth="off", **OPTIONS)


def test_a_traced_lens_expects_nothing(deep, tmp_path, monkeypatch, cache):
    monkeypatch.setattr(render, "preparation", None)
    addon.render_through_lens(deep, output_folder=tmp_path, depth="traced", **OPTIONS | {"stray": StrayOptions("off")})
