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
LIMITS = {"place": 0.3, "illumination": 0.02, "disc": 0.10}  # px of 1080 rows; of the light; of the size
BLUR_PX, LEAST_BLUR_PX = 32.0, 8.0  # diameters of discs; the least that is measured
LARGE_BLUR_PX, GRAIN_LIMIT = 56.0, 0.2  # radius of a foreground lamp's disc, and its unevenness
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
        live, scene = session().live, bpy.context.scene
        name = scene.camera.data.lensfield.lens
        lens = name, module("addon.scene.rings").rings_for(scene, name)
        area("VIEW_3D").tag_redraw()
        yield from until(lambda: live.question[:3:2] == lens and live.answer.done()
                         and live.shown is not None and live.shown[0] is live.answer.result())
        for _ in range(3):
            area("VIEW_3D").tag_redraw()
            yield 0.4


def module(name):
    """A module of the extension, or of the engine from the extension's wheel."""
    return import_module(f"{'lensfield' if name.startswith('engine') else MODULE}.{name}")


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


def place_dots(tangents, side_tangent, nearness, lean):
    """Replace the dots by squares with these middles, in tangents to the right and up, in front of a black wall. Their
    inverse depth, in scene units, rises with the tangents by `lean`: they are parallel to a plane of focus that leans.
    """
    widest = min(1e3, nearness / max(np.hypot(*lean), 1e-9))  # beyond, the plane is infinitely distant
    make_squares("Dots", np.asarray(tangents), min(side_tangent, widest), nearness, lean)
    make_squares("Wall", np.zeros((1, 2)), widest, nearness / (1 + 1e-4), lean)


def make_squares(name, tangents, side_tangent, nearness, lean):
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * side_tangent / 2
    points = (tangents[:, None] + corners).reshape(-1, 2)
    mesh = bpy.data.objects[name].data
    mesh.clear_geometry()
    mesh.from_pydata(np.c_[points, np.full(len(points), -1)] / (nearness + points @ lean)[:, None], [],
                     [range(first, first + 4) for first in range(0, len(points), 4)])
    mesh.update()


class Judge:
    """A lens of the engine on the viewport's frame."""

    def __init__(self, viewport, name, rings):
        library, self._field_map = module("engine.library"), module("engine.field.field_map").field_map
        self._live = module("addon.ui.live.live")
        self.lens = library.load_lens(name, rings, "preview", wavelengths_nm=self._live.COLOURS_NM)
        self._stretch = np.array([self.lens.squeeze, 1.0])  # of the picture, as the viewport shows it
        pitch_mm = module("engine.lens.pinhole").fitting_pitch_um(self.lens, FRAME_PX) / 1e3
        self.tangents = self._stretch * FRAME_PX[::-1] * pitch_mm / 2 / self.lens.capture_focal_length_mm
        self._viewport = viewport
        self.lean_per_mm = self.lens.focus_slope / self._stretch * self.lens.capture_focal_length_mm
        self.focus_per_mm = float(module("engine.lens.entrance_pupil").focus_nearness(self.lens))

    def place_dots(self, tangents, side_px, defocus_per_mm=0.0):
        """Place dots out of focus by this inverse depth."""
        per_unit = METRES_PER_UNIT * 1e3
        place_dots(tangents, side_px / self.view()[2], (self.focus_per_mm + defocus_per_mm) * per_unit,
                   self.lean_per_mm * per_unit)

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
        ideal_mm = np.asarray(tangents) / self._stretch * self.lens.capture_focal_length_mm
        return self.shown_px(np.stack(self._field_map(self.lens).at_wavelength(nm).landing_mm(*ideal_mm.T), axis=-1))

    def shown_px(self, place_mm):
        """Positions in the region of places on the sensor, (..., 2)."""
        return np.array(self.view()[:2]) + self._stretch * place_mm * self.px_per_mm

    def places_mm(self, position_px):
        """Places on the sensor of positions in the region, (..., 2)."""
        return (position_px - np.array(self.view()[:2])) / self._stretch / self.px_per_mm

    def illumination(self, position_px):
        return self._field_map(self.lens).at_wavelength(self._live.COLOURS_NM[1]).relative_illumination(
            *self.places_mm(position_px).T)

    def disc_px(self, tangent, depth_mm):
        """The middle and the sizes of a lamp's disc by the engine's PSF of a point at a depth, on the viewport."""
        rays, nm = module("engine.library.rays").lens_rays(self.lens), self._live.COLOURS_NM[1]
        through_focus = module("engine.bake.through_focus")
        sampling = depth_mm, 1e3 / self.px_per_mm, 2 * int(BLUR_PX) + 1
        middle_px = self.landing_px([tangent], nm)[0]
        if hasattr(self.lens, "heights_mm"):
            height_mm = float(np.hypot(*self.places_mm(middle_px)))
            psf = through_focus.psf_at_depth(rays, nm, height_mm, *sampling, quality="preview")
            return middle_px, self.sizes(self._of_lamp(psf))
        place_mm = chief_place_mm(rays.at([nm]), self.places_mm(middle_px), tangent, depth_mm)
        psf = through_focus.psf_at_place(rays, nm, tuple(place_mm), *sampling, quality="preview")
        return self.shown_px(place_mm), self.sizes(self._of_lamp(psf))

    def _of_lamp(self, psf):
        """RMS width and height of a lamp's disc, which has the lamp's square in place of the PSF's pixels."""
        return self._stretch * np.sqrt(moments(psf)[1]**2 + ((LAMP_PX / self._stretch)**2 - 1) / 12)

    def sizes(self, rms_px):
        """RMS width and height of a disc of an anamorphic lens, or the RMS radius of another one's."""
        return rms_px if self.lens.squeeze != 1 else np.hypot(*rms_px)


def chief_place_mm(rays, place_mm, tangent, depth_mm):
    """Where the chief ray of a point at a depth lands, close to this place: out of focus, the width and the height of
    an anamorphic picture have different perspectives."""
    for _ in range(5):
        step_mm = np.eye(3, 2, -1) * 1e-3
        ray = rays.rays(0, -(place_mm + step_mm).T, np.zeros((2, 1)))
        seen = (ray.entrance_mm / depth_mm - ray.direction[:2] / ray.direction[2]).T
        place_mm = place_mm - (seen[0] - tangent) / np.diag(seen[1:] - seen[0]) * 1e-3
    return place_mm


def redraw_s():
    """Processor seconds of Blender for a redraw of the main viewport."""
    begin_s = time.process_time()
    with over():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=REDRAWS)
    return (time.process_time() - begin_s) / REDRAWS


def grain(viewport, judge):
    """The standard deviation of the light in the middle of a foreground lamp's disc, relative to its mean."""
    per_nearness_px = module("engine.depth.depth_range").blur_per_nearness_px(judge.lens, 1e3 / judge.px_per_mm)
    judge.place_dots([(0.0, 0.0)], LAMP_PX, LARGE_BLUR_PX / per_nearness_px)
    yield from viewport.settled()
    part, _ = around(viewport.light[..., 1], judge.view()[:2], int(LARGE_BLUR_PX / 2))
    return float(part.std() / part.mean())


def moments(light):
    """Centroid (x, y) in pixels from the first, and RMS width and height, of a picture."""
    rows, columns = np.indices(light.shape)
    x, y = (np.average(each, weights=light) for each in (columns, rows))
    return np.array([x, y]), np.sqrt([np.average((columns - x)**2, weights=light),
                                      np.average((rows - y)**2, weights=light)])


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


def set_up(viewport, name, tilt_deg):
    """Choose a lens, and give the camera its view: its Judge."""
    scene = bpy.context.scene
    scene.camera.data.lensfield.lens, scene.camera.data.lensfield.tilt_deg = name, np.radians(tilt_deg)
    dof = scene.camera.data.dof
    facts = module("addon.scene.lens_facts").lens_facts(name)
    distance = max(LEAST_DISTANCE, 1.1 * facts.reach[2] / METRES_PER_UNIT / 1e3)
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, distance, 0.1
    judge = Judge(viewport, name, module("addon.scene.rings").rings_for(scene, name))
    scene.render.pixel_aspect_x = judge.lens.squeeze
    scene.camera.data.sensor_width, scene.camera.data.lens = 36.0, 18.0 / judge.tangents[0]
    return judge


def errors(viewport, name, tilt_deg=(0.0, 0.0)):
    """The largest errors of the live view through a lens: dict with the keys of LIMITS."""
    judge, found = set_up(viewport, name, tilt_deg), {}
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
    judge.place_dots(tangents, DOT_PX)
    yield from viewport.settled()
    tangents = drawn_tangents(viewport, judge, tangents)
    worst_px = 0.0
    for colour, nm in enumerate(module("addon.ui.live.live").COLOURS_NM):
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
    judge.place_dots([(0.0, 0.0)], np.inf)
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
    """The largest relative difference of discs' sizes from the engine's PSFs, before and behind the focus."""
    per_nearness_px = module("engine.depth.depth_range").blur_per_nearness_px(judge.lens, 1e3 / judge.px_per_mm)
    focus = judge.focus_per_mm
    clip = 1 / (bpy.context.scene.camera.data.clip_start * METRES_PER_UNIT * 1e3)
    most_px = 0.5 * (clip - focus) * per_nearness_px, 0.9 * focus * per_nearness_px
    blurs_px = [sign * min(BLUR_PX, most) for sign, most in zip((1, -1), most_px, strict=True) if most > LEAST_BLUR_PX]
    assert blurs_px
    tangents = visible(viewport, judge, np.array(LAMPS) * judge.tangents)
    worst = 0.0
    for blur_px in blurs_px:
        defocus = blur_px / per_nearness_px
        judge.place_dots(tangents, LAMP_PX, defocus)
        yield from viewport.settled()
        for tangent in tangents:
            middle_px, sizes_px = judge.disc_px(tangent, 1 / (focus + defocus + judge.lean_per_mm @ tangent))
            part, _ = around(viewport.light[..., 1], middle_px, int(BLUR_PX))
            assert part.sum() > 1
            worst = max(worst, np.abs(judge.sizes(moments(part)[1]) / sizes_px - 1).max())
    return worst
