"""Renders that exceed the machine's memory."""

import re

import pytest

from lensfield.addon.render import render as render_module
from lensfield.addon.render.preflight import preflight
from lensfield.addon.render.render import render_through_lens
from lensfield.engine import InputError
from lensfield.engine.runtime import memory

NO_ROOM = r"^scene 'Scene': size is [\d.]+ GB in memory: %d GB are free: render a smaller picture"


def test_a_render_that_exceeds_memory_is_refused_before_it_starts(scene, tmp_path, monkeypatch):
    """With overscan, more than 1e9 pixels of about 100 bytes each."""
    monkeypatch.setattr(memory, "available_bytes", lambda: 16 * 10**9)
    monkeypatch.setattr(render_module, "_render", lambda scene: pytest.fail("it is rendered"))
    scene.render.resolution_x = scene.render.resolution_y = 32_000
    scene.lensfield.tier = "REFERENCE"  # without denoising
    with pytest.raises(InputError, match=NO_ROOM % 16):
        render_through_lens(scene, lens="edmund-54852", wavelengths_nm=[450, 550, 650], output_folder=tmp_path / "out",
                            depth="off")
    assert not list((tmp_path / "out").iterdir())


def test_preflight_reports_a_lack_of_memory(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 0)
    refusals = preflight(scene, output_folder=tmp_path, lens="edmund-54852", wavelengths_nm=[450, 550, 650]).refusals
    assert any(re.match(NO_ROOM % 0, str(refusal)) for refusal in refusals)
