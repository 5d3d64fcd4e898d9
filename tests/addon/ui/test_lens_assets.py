"""The asset library of the lenses, on two of them and an anamorphic lens."""

import bpy
import pytest

from lenses import fine_grid_lens
from lensfield.addon.scene import lens_cache
from lensfield.addon.scene.compositor import QUICK_LOOK
from lensfield.addon.scene.quick_look import CURVES, MAP_X
from lensfield.addon.ui import lens_assets
from lensfield.engine.library import described_lenses

ANAMORPHIC = "atlas-42mm-1.5x"


@pytest.fixture
def few_lenses(monkeypatch):
    names = "tessar-50mm", "cooke-triplet-50mm", ANAMORPHIC
    lenses = {name: described_lenses()[name] for name in names}
    monkeypatch.setattr(lens_assets, "described_lenses", lambda: lenses)
    squeezed = fine_grid_lens(squeeze=1.5, wavelengths_nm=(400.0, 550.0, 700.0))  # a bake takes a quarter of a minute
    monkeypatch.setattr(lens_assets, "load_lens", lambda name, *rest, **options:
                        squeezed if name == ANAMORPHIC else lens_cache.load_lens(name, *rest, **options))
    return lenses


def test_each_lens_becomes_a_node_group_with_picture_story_and_tags(scene, tmp_path, few_lenses):
    (tmp_path / lens_assets.CATALOGUES).write_text("VERSION 1\n\n1f5a3c0e-0000-4000-8000-000000000000:Mine:Mine\n")
    for _ in range(2):
        assert bpy.ops.lensfield.write_lens_assets(directory=str(tmp_path)) == {"FINISHED"}
    assert not bpy.data.node_groups and not bpy.data.images
    lines = (tmp_path / lens_assets.CATALOGUES).read_text().splitlines()
    assert sum(":Mine:" in line for line in lines) == 1
    assert sum(line.startswith(lens_assets.CATALOGUE_ID) for line in lines) == 1
    with bpy.data.libraries.load(str(tmp_path / lens_assets.FILE), assets_only=True) as (available, chosen):
        assert set(available.node_groups) == {lens.title for lens in few_lenses.values()}
        chosen.node_groups = [few_lenses[name].title for name in ("tessar-50mm", ANAMORPHIC)]
    group, squeezed = chosen.node_groups
    assert CURVES in group.nodes and MAP_X in squeezed.nodes
    asset = group.asset_data
    assert "triplet" in asset.description and {tag.name for tag in asset.tags} == {"classic", "crisp"}
    assert asset.catalog_id == lens_assets.CATALOGUE_ID and min(group.preview.image_size) > 100
    assert QUICK_LOOK not in group, "it does not follow a scene's lens"
    f_stop = next(item for item in group.interface.items_tree if item.name == "F-Stop")
    assert f_stop.default_value == pytest.approx(5.5, rel=1e-3)


def test_a_missing_folder_is_refused(scene, tmp_path):
    with pytest.raises(RuntimeError, match="choose an existing folder"):
        bpy.ops.lensfield.write_lens_assets(directory=str(tmp_path / "missing"))
