"""The live view of a viewport, compared with the engine: places of dots, illumination, and discs of blurred dots.

The dots are small squares in front of the camera, drawn in Solid shading without light and shadow.
"""

import time
from importlib import import_module

import bpy
import numpy as np
from hands import MODULE, area, over, region, session, until

LEAST_DISTANCE = 2.0  # of the dots in focus, in scene units
METRES_PER_UNIT = 0.5
DOT_PX, LAMP_PX = 9.0, 2.5  # sides of dots in focus and of blurred ones, in the viewport
GRID = np.linspace(-0.83, 0.89, 7), np.linspace(-0.91, 0.77, 5)  # of the dots, in half sides of the frame: lopsided
LAMPS = (0.03, -0.04), (0.44, 0.52)  # from the axis, in half sides of the frame
LIMITS = {"place": 0.3, "illumination": 0.02, "disc": 0.10}  # px of 1080 rows; of the light; of the radius
BLUR_PX, LEAST_BLUR_PX = 32.0, 8.0  # diameters of discs; the least that is measured
REDRAWS = 5
FRAME_PX = 900, 1200  # rows and columns of the render
SHIFT = 0.07, -0.05  # of the camera, in widths of the frame; 0 for discs


class Viewport:
    """The main viewport in the camera's view, which the live view is switched on for.

    Attributes
    ----------
    plain, light : float array (row, column, 4)
        The picture that it drew last, before and after the live view has changed it.
    """

    def __init__(self):
        self._framebuffer = self.plain = self.light = None
        place = area("VIEW_3D")
        self.space, self.region = place.spaces.active, region(place)
        self.space.region_3d.view_perspective = "CAMERA"
        self.space.region_3d.view_camera_zoom = 14
        self.space.overlay.show_overlays = self.space.show_gizmo = False
        shading = self.space.shading
        shading.type, shading.light, shading.color_type = "SOLID", "FLAT", "OBJECT"
        shading.background_type, shading.background_color = "VIEWPORT", (0, 0, 0)
        add = bpy.types.SpaceView3D.draw_handler_add
        add(self._note, (), "WINDOW", "PRE_VIEW")
        add(lambda: setattr(self, "plain", self._read()), (), "WINDOW", "POST_VIEW")
        with over():
            assert bpy.ops.lensfield.live("INVOKE_DEFAULT") == {"FINISHED"}
        add(lambda: setattr(self, "light", self._read()), (), "WINDOW", "POST_VIEW")

    def _note(self):
        import gpu

        self._framebuffer = gpu.state.active_framebuffer_get()

    def _read(self):
        _, _, width, height = self._framebuffer.viewport_get()
        with self._framebuffer.bind():
            read = self._framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT")
        return np.array(memoryview(read), dtype=np.float32).reshape(height, width, 4)

    def settled(self):
        """Wait until the lens's tables are drawn and the viewport has smoothed its edges."""
        live, name = session().live, bpy.context.scene.lensfield.lens
        area("VIEW_3D").tag_redraw()
        yield from until(lambda: live.question[:1] == (name,) and live.answer.done()
                         and live.shown is not None and live.shown[0] is live.answer.result())
        for _ in range(3):
            area("VIEW_3D").tag_redraw()
            yield 0.4


def module(name):
    return import_module(f"{MODULE}.{name}")


def make_scene():
    """A file with a camera at an angle, and a mesh for the dots in its space."""
    bpy.ops.wm.read_homefile(use_empty=True)
    yield 1
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (1.5, -2.0, 3.0), (1.1, 0.3, -0.7)
    dots = bpy.data.objects.new("Dots", bpy.data.meshes.new("Dots"))
    wall = bpy.data.objects.new("Wall", bpy.data.meshes.new("Wall"))
    wall.color = (0, 0, 0, 1)
    for each in (camera, dots, wall):
        scene.collection.objects.link(each)
    dots.parent = wall.parent = camera
    scene.camera = camera
    camera.data.clip_start, camera.data.clip_end = 0.1, 1000
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", METRES_PER_UNIT
    scene.render.resolution_y, scene.render.resolution_x = FRAME_PX
    scene.render.resolution_percentage = 100


def place_dots(tangents, side_tangent, depth):
    """Replace the dots by squares with these middles, in tangents to the right and up, at a depth in scene units, in
    front of a black wall."""
    make_squares("Dots", np.asarray(tangents), side_tangent, depth)
    make_squares("Wall", np.zeros((1, 2)), 1e3, depth * (1 + 1e-4))


def make_squares(name, tangents, side_tangent, depth):
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * side_tangent / 2
    points = (tangents[:, None] + corners).reshape(-1, 2) * depth
    mesh = bpy.data.objects[name].data
    mesh.clear_geometry()
    mesh.from_pydata([(x, y, -depth) for x, y in points], [],
                     [range(first, first + 4) for first in range(0, len(points), 4)])
    mesh.update()


class Judge:
    """A lens of the engine on the viewport's frame."""

    def __init__(self, viewport, name, rings):
        library, self._field_map = module("engine.library"), module("engine.field.field_map").field_map
        self._live = module("addon.ui.live")
        self.lens = library.load_lens(name, rings, "preview", wavelengths_nm=self._live.COLOURS_NM)
        self._pitch_mm = module("engine.lens.pinhole").fitting_pitch_um(self.lens, FRAME_PX) / 1e3
        self.tangents = [n * self._pitch_mm / 2 / self.lens.capture_focal_length_mm for n in reversed(FRAME_PX)]
        self._viewport = viewport
        self.distance = bpy.context.scene.camera.data.dof.focus_distance

    def places(self, parts):
        """Tangents of places in the frame, which are given from its middle in half sides: array (..., 2)."""
        camera = bpy.context.scene.camera.data
        return 2 * self.tangents[0] * np.array((camera.shift_x, camera.shift_y)) + np.asarray(parts) * self.tangents

    def view(self):
        """Axis and scale of the viewport: pixels, and pixels per tangent."""
        matrix, place = self._viewport.space.region_3d.window_matrix, self._viewport.region
        return ((1 - matrix[0][2]) * place.width / 2, (1 - matrix[1][2]) * place.height / 2,
                matrix[0][0] * place.width / 2)

    @property
    def px_per_mm(self):
        return self.view()[2] / self.lens.capture_focal_length_mm

    def landing_px(self, tangents, nm):
        """Where the engine sees points of these tangents: positions in the region, array (point, 2)."""
        focal_mm = self.lens.capture_focal_length_mm
        landing_mm = np.stack(self._field_map(self.lens).at_wavelength(nm).landing_mm(
            *(np.asarray(tangents).T * focal_mm)), axis=-1)
        return np.array(self.view()[:2]) + landing_mm * self.px_per_mm

    def illumination(self, position_px):
        x_mm, y_mm = ((position_px - np.array(self.view()[:2])) / self.px_per_mm).T
        return self._field_map(self.lens).at_wavelength(self._live.COLOURS_NM[1]).relative_illumination(x_mm, y_mm)

    def disc_px(self, tangent, depth_mm):
        """The middle and the RMS radius of the engine's PSF of a point at a depth, on the viewport."""
        rays, nm = module("engine.library.rays").lens_rays(self.lens), self._live.COLOURS_NM[1]
        middle_px = self.landing_px([tangent], nm)[0]
        height_mm = np.hypot(*(middle_px - np.array(self.view()[:2]))) / self.px_per_mm
        psf = module("engine.bake.through_focus").psf_at_depth(
            rays, nm, float(height_mm), depth_mm, 1e3 / self.px_per_mm, 2 * int(BLUR_PX) + 1, quality="preview")
        return middle_px, moments(psf)[1]


def redraw_s():
    """Processor seconds of Blender for a redraw of the main viewport."""
    begin_s = time.process_time()
    with over():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=REDRAWS)
    return (time.process_time() - begin_s) / REDRAWS


def moments(light):
    """Centroid (x, y) in pixels from the first, and RMS radius, of a picture."""
    rows, columns = np.indices(light.shape)
    total = light.sum()
    x, y = (light * columns).sum() / total, (light * rows).sum() / total
    return np.array([x, y]), np.sqrt((light * ((columns - x)**2 + (rows - y)**2)).sum() / total)


def around(picture, position_px, half_px):
    """The square of a picture around a position, and its lower left corner; None beyond the picture."""
    left, bottom = (int(round(each)) - half_px for each in position_px)
    if min(left, bottom) < 0 or left + 2 * half_px > picture.shape[1] or bottom + 2 * half_px > picture.shape[0]:
        return None
    return picture[bottom:bottom + 2 * half_px, left:left + 2 * half_px], np.array([left, bottom])


def visible(viewport, judge, tangents):
    """The tangents that the viewport shows, both without the lens and through it."""
    middle, size = np.array(judge.view()[:2]), np.array([viewport.region.width, viewport.region.height])
    half, frame = np.array(judge.tangents) * judge.view()[2], middle + judge.places((0, 0)) * judge.view()[2]
    shown = np.asarray(tangents) * judge.view()[2] + middle
    landing = judge.landing_px(tangents, 550.0)
    fits = np.all((shown > 20) & (shown < size - 20) & (np.abs(landing - frame) < half - 12), axis=1)
    return np.asarray(tangents)[fits]


def set_up(viewport, name):
    """Choose a lens, and give the camera its view: its Judge."""
    scene = bpy.context.scene
    scene.lensfield.lens = name
    dof = scene.camera.data.dof
    facts = module("addon.scene.lens_facts").lens_facts(name)
    distance = max(LEAST_DISTANCE, 1.1 * facts.reach[2] / METRES_PER_UNIT / 1e3)
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, distance, 0.1
    judge = Judge(viewport, name, module("addon.scene.rings").rings_for(scene, name))
    scene.camera.data.sensor_width, scene.camera.data.lens = 36.0, 18.0 / judge.tangents[0]
    return judge


def errors(viewport, name):
    """The largest errors of the live view through a lens: dict with the keys of LIMITS."""
    judge, found = set_up(viewport, name), {}
    for key, error, shift in (("place", place_error, SHIFT), ("illumination", illumination_error, SHIFT),
                              ("disc", disc_error, (0.0, 0.0))):
        camera = bpy.context.scene.camera.data
        camera.shift_x, camera.shift_y = shift
        yield 0.5  # for the view to follow the camera
        found[key] = yield from error(viewport, judge)
    print(f"{name:24}" + "  ".join(f"{key} {value:.3f} of {LIMITS[key]}" for key, value in found.items()), flush=True)
    return found


def place_error(viewport, judge):
    """The largest distance of dots from where the engine sees them, in pixels of a frame of 1080 rows."""
    tangents = visible(viewport, judge, judge.places(np.stack(np.meshgrid(*GRID), axis=-1).reshape(-1, 2)))
    assert len(tangents) >= 9, len(tangents)
    place_dots(tangents, DOT_PX / judge.view()[2], judge.distance)
    yield from viewport.settled()
    tangents = drawn_tangents(viewport, judge, tangents)
    worst_px = 0.0
    for colour, nm in enumerate(module("addon.ui.live").COLOURS_NM):
        for position_px in judge.landing_px(tangents, nm):
            part, corner = around(viewport.light[..., colour], position_px, int(2 * DOT_PX))
            worst_px = max(worst_px, np.hypot(*(corner + moments(part)[0] + 0.5 - position_px)))
    rows_px = 2 * judge.tangents[1] * judge.view()[2]
    return worst_px / rows_px * 1080


def drawn_tangents(viewport, judge, tangents):
    """The tangents of dots as the viewport without the lens has drawn them, in whole pixels."""
    *middle_px, px_per_tangent = judge.view()
    drawn_px = []
    for position_px in np.array(middle_px) + np.asarray(tangents) * px_per_tangent:
        part, corner = around(viewport.plain[..., 1], position_px, int(DOT_PX))
        drawn_px.append(corner + moments(part)[0] + 0.5)
    return (np.array(drawn_px) - middle_px) / px_per_tangent


def illumination_error(viewport, judge):
    """The largest difference of a white wall's light from the engine's, relative to the axis."""
    place_dots([(0.0, 0.0)], 1e3, judge.distance)
    yield from viewport.settled()
    middle_px = np.array(judge.view()[:2])
    parts = 0.98 * np.stack(np.meshgrid(*GRID), axis=-1).reshape(-1, 2)
    position_px = middle_px + judge.places(parts) * judge.view()[2]
    column, row = np.floor(position_px).astype(int).T
    light = viewport.light[row, column, 1]
    lit = light > 0  # beyond the edge of the viewport a fisheye's light is unknown
    assert lit.sum() >= 9
    return float(np.abs(light - judge.illumination(position_px))[lit].max())


def disc_error(viewport, judge):
    """The largest relative difference of discs' RMS radii from the engine's PSFs, before and behind the focus."""
    per_nearness_px = module("engine.depth.depth_range").blur_per_nearness_px(judge.lens, 1e3 / judge.px_per_mm)
    focus = 1 / (judge.distance * METRES_PER_UNIT * 1e3)
    clip = 1 / (bpy.context.scene.camera.data.clip_start * METRES_PER_UNIT * 1e3)
    most_px = 0.5 * (clip - focus) * per_nearness_px, 0.9 * focus * per_nearness_px
    blurs_px = [sign * min(BLUR_PX, most) for sign, most in zip((1, -1), most_px, strict=True) if most > LEAST_BLUR_PX]
    assert blurs_px
    tangents = visible(viewport, judge, np.array(LAMPS) * judge.tangents)
    worst = 0.0
    for blur_px in blurs_px:
        nearness = focus + blur_px / per_nearness_px
        place_dots(tangents, LAMP_PX / judge.view()[2], 1 / nearness / METRES_PER_UNIT / 1e3)
        yield from viewport.settled()
        for tangent in tangents:
            middle_px, radius_px = judge.disc_px(tangent, 1 / nearness)
            part, _ = around(viewport.light[..., 1], middle_px, int(BLUR_PX))
            assert part.sum() > 1
            worst = max(worst, abs(moments(part)[1] / radius_px - 1))
    return worst
