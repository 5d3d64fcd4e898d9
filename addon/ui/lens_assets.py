"""An asset library of the bundled lenses: a Quick Look node group for each, at rest, for the asset browser."""

from pathlib import Path

import bpy
import numpy as np

from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.library import described_lenses
from lensfield.engine.look.lens_tables import COLOURS_NM
from lensfield.engine.rays.rings import AT_REST
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import atomic_path

from ..scene.compositor import QUICK_LOOK
from ..scene.lens_cache import load_lens
from ..scene.lens_facts import lens_facts
from ..scene.quick_look import new_quick_look, set_lens
from .common.previews import asset_preview
from .common.stepped import Stepped
from .live.live import QUALITY
from .live.quick_look import compositor_lens

FILE, CATALOGUES = "lensfield_lenses.blend", "blender_assets.cats.txt"
CATALOGUE, CATALOGUE_ID = "Lensfield", "6a3a9f0e-5f0b-4b0e-9c53-3f9b6a1d7c42"
UNIT_MM = 1000.0  # of a new file


def lens_asset_steps(folder: Path):
    """Write the asset library into a folder, in steps: yields the finished fraction. The groups of anamorphic lenses
    are for pictures whose pixels have their squeeze as the aspect."""
    lenses, looks = described_lenses(), {}
    for number, name in enumerate(lenses, 1):
        lens = load_lens(name, AT_REST, QUALITY, wavelengths_nm=COLOURS_NM)
        looks[name] = (compositor_lens(lens, lens_facts(name).f_number, pixel_aspect=lens.squeeze),
                       focus_nearness(lens) * UNIT_MM)
        yield number / (len(lenses) + 1)
    groups = []
    try:
        for name, (look, nearness) in looks.items():
            groups.append(_asset(lenses[name], name, look, nearness))
        bpy.data.libraries.write(str(folder / FILE), set(groups), fake_user=True, compress=True)
    finally:
        images = [node.image for group in groups for node in group.nodes if node.bl_idname == "CompositorNodeImage"]
        bpy.data.batch_remove([*groups, *images])
    _add_catalogue(folder / CATALOGUES)


def _asset(lens, name, look, nearness):
    """A node group of a lens as an asset."""
    group = new_quick_look()
    group.name = lens.title
    del group[QUICK_LOOK]  # it does not follow a scene's lens
    set_lens(group, look, unit_mm=UNIT_MM)
    inputs = {item.name: item for item in group.interface.items_tree if item.in_out == "INPUT"}
    inputs["F-Stop"].default_value = look.f_number
    inputs["Focus Distance"].default_value = 1 / nearness if nearness else 0.0
    group.asset_mark()
    asset = group.asset_data
    asset.description, asset.author, asset.copyright = " ".join(lens.story.split()), lens.maker, lens.source
    asset.catalog_id = CATALOGUE_ID
    for word in lens.character:
        asset.tags.new(word, skip_if_exists=True)
    pixels = asset_preview(name)
    if pixels is not None:
        preview = group.preview_ensure()
        preview.image_size = pixels.shape[1::-1]
        preview.image_pixels_float.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
    return group


def _add_catalogue(path):
    """Add the catalogue to a folder's list, which may have others."""
    text = path.read_text(encoding="utf-8") if path.is_file() else "VERSION 1\n"
    if CATALOGUE_ID not in text:
        with atomic_path(path, overwrite=True) as temporary:
            temporary.write_text(f"{text.rstrip()}\n\n{CATALOGUE_ID}:{CATALOGUE}:{CATALOGUE}\n", encoding="utf-8")


class LENSFIELD_OT_write_lens_assets(Stepped, bpy.types.Operator):
    """Write an asset library with a Quick Look node group for each lens, at rest. Then add its folder in Preferences >
    File Paths > Asset Libraries"""

    bl_idname = "lensfield.write_lens_assets"
    bl_label = "Write Lens Assets"

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def steps(self, context):
        """Write the library, and report it."""
        folder = Path(bpy.path.abspath(self.directory))
        if not self.directory or not folder.is_dir():
            raise InputError("asset library", "folder", repr(self.directory), "choose an existing folder")
        yield from lens_asset_steps(folder)
        self.report({"INFO"}, f"{FILE} written")


classes = (LENSFIELD_OT_write_lens_assets,)
