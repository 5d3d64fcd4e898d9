"""Comparing lenses: the dialog that ticks them, and the choice of one by a click on the contact sheet.

Pictures on the sheet are clicked through a gizmo. In an Image Editor gizmos get clicks first; the active tool takes
them before any keymap that an add-on can extend.
"""

import time

import bpy

from lensfield.engine.library import bundled_names, has_rings
from lensfield.engine.runtime.errors import InputError

from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_settings
from ..scene.camera import frame_px
from ..scene.linked import check_editable
from . import window_render
from .common.plain_words import plain
from .common.previews import lens_picture
from .common.properties import lens_title, matching_lenses, offered_lenses, offered_title
from .common.session import session
from .operators import LensRender

F_STOPS = "1", "1.4", "2", "2.8", "4", "5.6", "8", "11", "16"
F_STOPS_TEXT = "F-stops. None: the camera's F-Stop if its Depth of Field is on, otherwise the widest of each lens"
SIDE_PX, SAMPLES = 640, 64  # of each picture, the longer side
PICTURE, WIDGET_PX = 4, 20  # side of a picture in the dialog, in widgets; and of a widget
COLUMN_PX, ROW_WIDGETS = 170, PICTURE + 1.4  # of a picture with its title
FRAME_PX, FRAME_WIDGETS = 150, 15  # of the window that the pictures leave free, at the side and at top and bottom
MOST_COLUMNS, MOST_ROWS = 8, 6
LEAST_PX = 4
CHOOSE = "Click a picture on the contact sheet to choose its lens"
OUTLINE_PX, OUTLINE = 3.0, (1.0, 0.6, 0.1, 1.0)


class LensfieldTick(bpy.types.PropertyGroup):
    """A lens in the dialog, by its name in the list of lenses."""

    ticked: bpy.props.BoolProperty(name="Compare", description="Compare this lens")


class LENSFIELD_OT_compare(LensRender, bpy.types.Operator):
    """Render the camera's view once, through several lenses at several f-stops, in the background. A contact sheet
    shows the pictures side by side; click one to choose its lens"""

    bl_idname = "lensfield.compare"
    bl_label = "Compare Lenses"

    lenses: bpy.props.CollectionProperty(type=LensfieldTick)
    search: bpy.props.StringProperty(name="Search", options={"TEXTEDIT_UPDATE", "SKIP_SAVE"},
                                     description="Show only lenses with these words in their name, maker or character")
    page: bpy.props.IntProperty(name="Page", default=1, min=1, options={"SKIP_SAVE"},
                                description="Page of the list of lenses")
    f_stops: bpy.props.EnumProperty(
        name="F-Stops", options={"ENUM_FLAG"}, items=[(stop, f"f/{stop}", f"Compare at f/{stop}") for stop in F_STOPS],
        description=F_STOPS_TEXT)
    side_px: bpy.props.IntProperty(name="Picture Size", default=SIDE_PX, min=LEAST_PX, soft_max=1920, subtype="PIXEL",
                                   description="Longer side of each picture")
    samples: bpy.props.IntProperty(name="Samples", default=SAMPLES, min=1, soft_max=1024,
                                   description="Cycles samples for each pixel; the pictures are denoised")

    def invoke(self, context, event):
        """Ask for the lenses and f-stops; the lenses of the last sheet are ticked, or else the scene's lens."""
        try:
            settings, sheet = camera_settings(context.scene), session.last_sheet
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        before = {compared.lens for compared in sheet.lenses} if sheet else {settings.lens}
        self.lenses.clear()
        names = [name for name, *_ in offered_lenses() if name != FROM_FILE or settings.lens == FROM_FILE]
        for name in sorted(names, key=lambda name: name not in before):
            lens = self.lenses.add()
            lens.name, lens.ticked = name, name in before
        columns, _ = _grid(context.window)
        return context.window_manager.invoke_props_dialog(self, width=COLUMN_PX * columns, confirm_text="Compare")

    def draw(self, context):
        columns, rows = _grid(context.window)
        shown, pages = _page(self.lenses, self.search, self.page, columns * rows)
        row = self.layout.row()
        row.prop(self, "search", text="", icon="VIEWZOOM")
        if pages > 1:
            row.prop(self, "page", text=f"Page of {pages}")
        grid = self.layout.grid_flow(columns=columns, row_major=True, even_columns=True)
        for lens in shown:
            cell = grid.column(align=True)
            cell.template_icon(icon_value=lens_picture(lens.name), scale=PICTURE)
            cell.prop(lens, "ticked", text=_offered_title(context.scene, lens.name), toggle=True)
        titles = [_offered_title(context.scene, lens.name) for lens in self.lenses if lens.ticked]
        self.layout.label(text=f"To compare: {', '.join(titles) or 'none'}")
        self.layout.label(text=F_STOPS_TEXT)
        self.layout.row(align=True).prop(self, "f_stops")
        row = self.layout.row()
        row.prop(self, "side_px")
        row.prop(self, "samples")

    def execute(self, context):
        outcome = LensRender.invoke(self, context, None)
        while bpy.app.background and window_render.tick():  # Blender's timers do not run
            time.sleep(window_render.TICK_S)
        return outcome

    def start(self, scene):
        """Start the comparison, and return remarks on what the pictures will lack."""
        names = [lens.name for lens in self.lenses if lens.ticked]
        if not names:
            raise InputError("comparison", "lenses", "none", "tick at least one")
        lenses = [camera_settings(scene).lens_name_or_path() if name == FROM_FILE else name for name in names]
        stops = [float(stop) for stop in F_STOPS if stop in self.f_stops]
        return window_render.start_comparison(scene, lenses, stops, _size_px(scene, self.side_px), self.samples)


def _grid(window):
    """The columns and rows of pictures for which a window has room."""
    scale = bpy.context.preferences.system.ui_scale
    columns = int((window.width / scale - FRAME_PX) / COLUMN_PX)
    rows = int((window.height / scale / WIDGET_PX - FRAME_WIDGETS) / ROW_WIDGETS)
    return max(1, min(columns, MOST_COLUMNS)), max(1, min(rows, MOST_ROWS))


def _page(lenses, search, page, most):
    """The lenses on a page, counted from 1, of those that match a search; and the number of pages."""
    names = matching_lenses(search)
    matches = [lens for lens in lenses if lens.name in names]
    pages = max(1, -(-len(matches) // most))
    first = (min(page, pages) - 1) * most
    return matches[first:first + most], pages


def _offered_title(scene, name):
    return lens_title(camera_settings(scene).lens_text()) if name == FROM_FILE else offered_title(name)


def _size_px(scene, side_px):
    """Width and height of a picture with the scene's sides and this longer one."""
    rows, columns = frame_px(scene)
    return tuple(max(LEAST_PX, round(side_px * n / max(rows, columns))) for n in (columns, rows))


class LENSFIELD_OT_choose_compared(bpy.types.Operator):
    """Choose the lens of a picture on the contact sheet and, if the camera's Depth of Field sets the f-stop or f-stops
    were compared, its f-stop"""

    bl_idname = "lensfield.choose_compared"
    bl_label = "Choose Compared Lens"
    bl_options = {"REGISTER", "UNDO"}

    number: bpy.props.IntProperty(name="Picture", description="Counted from 0, row by row", min=0)

    @classmethod
    def poll(cls, context):
        return _compared_scene() is not None

    def execute(self, context):
        lenses, scene = session.last_sheet.lenses, _compared_scene()
        try:
            if self.number >= len(lenses):
                raise InputError("contact sheet", "picture", self.number, f"expected 0 to {len(lenses) - 1}")
            _choose(scene, lenses[self.number])
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        self.report({"INFO"}, lenses[self.number].label)
        return {"FINISHED"}


def _choose(scene, compared):
    """Give a scene the lens of a picture, and its camera the f-stop."""
    settings = camera_settings(scene)
    dof = settings.id_data.dof
    check_editable(settings.id_data)
    if has_rings(compared.lens) and (dof.use_dof or session.last_sheet.f_stops):
        dof.use_dof, dof.aperture_fstop = True, compared.f_number
    if compared.lens in bundled_names():
        settings.lens = compared.lens
    else:
        settings.lens = FROM_FILE
        if settings.lens_name_or_path() != compared.lens:
            settings.lens_file = compared.lens


def _compared_scene():
    """The scene of the last contact sheet, or None if it is gone."""
    sheet = session.last_sheet
    return sheet and next((scene for scene in bpy.data.scenes if scene.session_uid == sheet.scene_uid), None)


class LENSFIELD_GT_pictures(bpy.types.Gizmo):
    """The pictures of the contact sheet: outlined under the mouse, and chosen by a click."""

    bl_idname = "LENSFIELD_GT_pictures"
    __slots__ = ("number",)  # of the picture under the mouse

    def setup(self):
        self.number = -1

    def test_select(self, context, location):
        """The gizmo's part under the mouse, the number of a picture; a click then calls the part's operator."""
        u, v = context.region.view2d.region_to_view(*location)
        width, height = context.space_data.image.size
        self.number = picture_at(session.last_sheet.lenses, u * width, (1 - v) * height)
        if self.number >= 0:
            self.target_set_operator("lensfield.choose_compared", index=self.number).number = self.number
        return self.number

    def draw(self, context):
        if self.is_highlight and 0 <= self.number < len(session.last_sheet.lenses):
            _draw_outline(context, session.last_sheet.lenses[self.number].box)


def picture_at(lenses, across_px, down_px):
    """The number of the picture at a pixel of a contact sheet, counted from its upper left corner; -1 without one."""
    for number, lens in enumerate(lenses):
        left, top, right, bottom = lens.box
        if left <= across_px < right and top <= down_px < bottom:
            return number
    return -1


def _draw_outline(context, box):
    import gpu  # not available in background mode
    from gpu_extras.batch import batch_for_shader

    (left, top, right, bottom), (width, height) = box, context.space_data.image.size
    corners = [context.region.view2d.view_to_region(across / width, 1 - down / height, clip=False)
               for across, down in ((left, top), (right, top), (right, bottom), (left, bottom), (left, top))]
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", OUTLINE_PX)
    shader.uniform_float("color", OUTLINE)
    batch_for_shader(shader, "LINE_STRIP", {"pos": [(*corner, 0.0) for corner in corners]}).draw(shader)


class LENSFIELD_GGT_pictures(bpy.types.GizmoGroup):
    """Makes the pictures of the contact sheet clickable in Image Editors that show it."""

    bl_idname = "LENSFIELD_GGT_pictures"
    bl_label = "Contact Sheet"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT"}

    @classmethod
    def poll(cls, context):
        image = context.space_data.image
        return bool(image and _compared_scene() and bpy.path.abspath(image.filepath) == str(session.last_sheet.path))

    def setup(self, context):
        self.gizmos.new(LENSFIELD_GT_pictures.bl_idname)


def draw_compare(layout):
    """Draw the button that compares lenses."""
    layout.operator("lensfield.compare", text="Compare Lenses\u2026", icon="IMGDISPLAY")


classes = (LensfieldTick, LENSFIELD_OT_compare, LENSFIELD_OT_choose_compared, LENSFIELD_GT_pictures,
           LENSFIELD_GGT_pictures)
