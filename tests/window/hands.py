"""A simulated user: mouse and keys in a window of Blender, and checks of the display.

Functions that take time are generators of the seconds to wait: `yield from` them.
"""

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections import namedtuple
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d, region_2d_to_origin_3d, region_2d_to_vector_3d

from waiting import LAST_RESORT_S

STEP, PACKAGE, FOLDER = sys.argv[sys.argv.index("--") + 1:]
FOLDER = Path(FOLDER)
"""The folder of this step."""
MODULE = "bl_ext.user_default.lensfield"
SAMPLE = Path(__file__).resolve().parents[2] / "sample_scenes" / "evening_chess.blend"
DRAW_S = 0.4  # for Blender to draw changes
REST_S, LEAST_CHANGE = 10, 0.1  # longer than a shader takes to compile; below that of the text that counts shaders
MOST_SCROLLS, SCROLLED_AT_ONCE = 10, 4  # clicks of the mouse wheel
PROBE_S, PROBE_PX = 0.02, 9  # of a search for a control, whose height is 20 px
KEYS = {letter: name for letter, name in zip("0123456789. ", (
    "ZERO", "ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE", "PERIOD", "SPACE"), strict=True)}
"""Blender's names of keys that are not letters."""


def report(wrong="", status=0, gone=()):
    """Report to the driver: the error, Blender's exit status, and the processes and paths that must disappear."""
    (FOLDER / "outcome.json").write_text(json.dumps({"wrong": wrong, "status": status, "gone": gone}), encoding="utf-8")


def main_window():
    return bpy.context.window_manager.windows[0]


def newest_window():
    return bpy.context.window_manager.windows[-1]


def area(kind, window=None):
    """The largest area of a kind in a window, by default the main window."""
    return max((area for area in (window or main_window()).screen.areas if area.type == kind),
               key=lambda area: area.width * area.height)


def region(area, kind="WINDOW"):
    return next(region for region in area.regions if region.type == kind)


@contextmanager
def over(area_type="VIEW_3D", window=None):
    """Call operators in this area's context, as a button in it would."""
    place = area(area_type, window)
    with bpy.context.temp_override(window=window or main_window(), area=place, region=region(place)):
        yield


@contextmanager
def over_region(area, region):
    """Call operators in this region's context."""
    with bpy.context.temp_override(window=main_window(), area=area, region=region):
        yield


def point(place, across=0.5, up=0.5, window=None, wait_s=DRAW_S):
    """Move the mouse over an area or region."""
    x, y = int(place.x + across * place.width), int(place.y + up * place.height)
    (window or main_window()).event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield wait_s
    return x, y


def press(key, place, window=None, across=0.5, up=0.5, **modifiers):
    """Press a key with the mouse over an area or region."""
    x, y = yield from point(place, across, up, window)
    for value in ("PRESS", "RELEASE"):
        (window or main_window()).event_simulate(type=key, value=value, x=x, y=y, **modifiers)
    yield DRAW_S


def find(control, place, across=0.5, up=0.99):
    """Move the mouse down a region until it is over a control, named by its operator or its property; returns its
    height in the region, a fraction. Blender knows the control under the mouse, but not where others are."""
    for height in range(int(up * place.height), 0, -PROBE_PX):
        yield from point(place, across, height / place.height, wait_s=PROBE_S)
        if control in _under_mouse(place):
            yield DRAW_S  # the answer may be that of the last place
            if control in _under_mouse(place):
                return height / place.height
    raise LookupError(f"{control} is not visible")


def _under_mouse(place):
    """The operator call and the property path of the control under the mouse, as text."""
    context, window_manager = bpy.context, bpy.context.window_manager
    with over_region(next(each for each in main_window().screen.areas if place in each.regions[:]), place):
        window_manager.clipboard = ""
        with suppress(RuntimeError):  # not over an operator's button
            bpy.ops.ui.copy_python_command_button()
        _, path, _ = context.property or (None, "", None)
    return window_manager.clipboard or path


def click(control, place, across=0.5, key="LEFTMOUSE"):
    """Click a control in a region, or press a key over it."""
    up = yield from find(control, place, across)
    yield from press(key, place, across=across, up=up)


def scroll_to(control, place):
    """Scroll a region down until a control is visible."""
    for _ in range(MOST_SCROLLS):
        try:
            yield from find(control, place)
            return
        except LookupError:
            for _ in range(SCROLLED_AT_ONCE):
                yield from press("WHEELDOWNMOUSE", place)
    raise LookupError(f"{control} is not visible in any part")


def scroll_up(place):
    """Scroll a region to its top."""
    for _ in range(MOST_SCROLLS * SCROLLED_AT_ONCE):
        yield from press("WHEELUPMOUSE", place)


def type_number(control, place, text, across=0.7):
    """Edit a number under the mouse."""
    yield from click(control, place, across, "RET")
    yield from press("A", place, across=across, ctrl=True)
    yield from write(text)
    yield from press("RET", place, across=across)


def drag(control, place, start, end):
    """Drag the mouse over a control in a region, from one fraction of its width to another."""
    up = yield from find(control, place, start)
    for across, value in ((start, "PRESS"), ((start + end) / 2, None), (end, None), (end, "RELEASE")):
        x, y = yield from point(place, across, up)
        if value:
            main_window().event_simulate(type="LEFTMOUSE", value=value, x=x, y=y)
            yield DRAW_S


def open_section(name, place):
    """Click the headers of the Lensfield panel's sections, from the top, until this one is open."""
    panels, opened = sys.modules[f"{MODULE}.addon.ui.panels"], set()
    panels._PARTS = [(part, title, lambda *given, part=part, draw=draw: (opened.add(part), draw(*given)))
                     for part, title, draw in panels._PARTS]
    up = yield from find("lensfield.apply_lens", place)
    while name not in opened:
        up -= PROBE_PX / place.height
        assert up > 0, f"no section {name}: {opened}"
        yield from press("LEFTMOUSE", place, up=up)
        if opened and name not in opened:
            yield from press("LEFTMOUSE", place, up=up)  # closes it
            up -= PROBE_PX / place.height
            opened.clear()


def confirm():
    """Click the highlighted button of a dialog."""
    shoot("dialog")
    path = FOLDER.parent / f"{STEP}-dialog.png"
    highlighted = np.abs(pixels(path)[..., :3] - ACCENT).max(-1) < 0.02
    for row in np.flatnonzero(highlighted.sum(1) >= LEAST_BUTTON_PX):  # from the bottom
        columns = np.flatnonzero(highlighted[row])
        if np.ptp(columns) < 1.1 * len(columns):  # one button, with gaps for its text at most
            window = main_window()
            yield from press("LEFTMOUSE", window, across=columns.mean() / window.width, up=(row + 5) / window.height)
            return
    raise LookupError("no highlighted button")


def write(text):
    """Type text."""
    for letter in text:
        key = KEYS.get(letter, letter.upper())
        main_window().event_simulate(type=key, value="PRESS", unicode=letter)
        main_window().event_simulate(type=key, value="RELEASE")
        yield 0.1


ACCENT, LEAST_BUTTON_PX = np.divide((71, 114, 179), 255), 100  # of highlighted buttons in Blender's theme


def shoot(name, place=None):
    """Take a screenshot, of an area or a region of the main window if one is given."""
    subprocess.run([*_screenshot(place), FOLDER.parent / f"{STEP}-{name}.png"], check=True)


Box = namedtuple("Box", "x y width height")
"""A rectangle of the main window, in pixels from its lower left corner."""


def top_right(place, width, height):
    """The upper right part of an area or a region, for a screenshot."""
    return Box(place.x + place.width - width, place.y + place.height - height, width, height)


def _screenshot(place):
    """A command that writes a screenshot to a file."""
    crop = [] if place is None else ["-crop", f"{place.width}x{place.height}+{place.x}+"
                                              f"{main_window().height - place.y - place.height}", "+repage"]
    return ["import", "-window", "root", *crop]


def show_preferences(section, share):
    """Show Blender's preferences on the right of the window, in this share of its width, next to the 3D view alone;
    returns their area."""
    for kind in ("PROPERTIES", "OUTLINER", "DOPESHEET_EDITOR"):
        with over(kind):
            bpy.ops.screen.area_close()
        yield DRAW_S
    with over():
        bpy.ops.screen.area_split(direction="VERTICAL", factor=1 - share)
    yield DRAW_S
    place = max(main_window().screen.areas, key=lambda area: area.x)
    place.type = "PREFERENCES"
    bpy.context.preferences.active_section = section
    yield DRAW_S
    return place


def press_at(place, from_right, from_top):
    """Click at a distance, in pixels, from the upper right corner of a region."""
    yield from press("LEFTMOUSE", place, across=1 - from_right / place.width, up=1 - from_top / place.height)
    yield DRAW_S  # a second time, for menus


def uninstall():
    """Remove the extension, if it is installed from disk."""
    repository = bpy.context.preferences.extensions.repos["User Default"]
    if (Path(repository.directory) / "lensfield").exists():
        bpy.ops.extensions.package_uninstall(repo_directory=repository.directory, pkg_id="lensfield")


@contextmanager
def served(folder):
    """The address of a web server on this machine that serves the files of a folder."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=folder))
    threading.Thread(target=server.serve_forever).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def at_rest(name, place):
    """Take a screenshot of an area or a region once REST_S change it no more than Blender's further samples do."""
    before = None
    while True:
        place.tag_redraw()
        yield REST_S
        # not read by Blender, which evaluates the scene again after it has removed an image, and begins with one sample
        read = subprocess.run([*_screenshot(place), "-depth", "8", "rgb:-"], check=True, stdout=subprocess.PIPE)
        after = np.frombuffer(read.stdout, np.uint8) / 255
        if before is not None and np.abs(after - before).max() < LEAST_CHANGE:
            break
        before = after
    shoot(name, place)


def until(condition):
    """Wait for a condition."""
    deadline = time.monotonic() + LAST_RESORT_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"waited in vain: {notice() or progress()}")
        yield 0.05


def open_sample(samples=4, percentage=25, **settings):
    """Open a copy of the sample scene, reduced in size; settings are Lensfield's."""
    path = FOLDER / SAMPLE.name
    shutil.copy(SAMPLE, path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    yield 1
    scene = bpy.context.scene
    scene.cycles.samples, scene.render.resolution_percentage = samples, percentage
    adjust(**{"tier": "PREVIEW"} | settings)
    bpy.ops.ed.undo_push(message="Make Small")
    bpy.ops.wm.save_mainfile()
    yield from show_tab()
    yield DRAW_S


def adjust(**values):
    """Set Lensfield's settings of the scene and of its camera, each by its name."""
    scene = bpy.context.scene
    of_camera = scene.camera.data.lensfield
    for name, value in values.items():
        setattr(of_camera if name in of_camera.bl_rna.properties else scene.lensfield, name, value)


def show_tab():
    """Open the Lensfield tab of the sidebar. Blender crashes if a file has been opened since the last `yield`."""
    viewport = area("VIEW_3D")
    viewport.spaces.active.show_region_ui = True
    yield DRAW_S
    region(viewport, "UI").active_panel_category = "Lensfield"


def choose_petzval():
    bpy.context.scene.camera.data.lensfield.lens = "kodak-petzval-100mm"
    bpy.context.scene.camera.data.lensfield.view = "CAMERA"


def seen_distance(view, across, up):
    """The distance, along the camera's axis, of the surface at a place of a view, in fractions of it."""
    scene, place = bpy.context.scene, region(view)
    at = across * place.width, up * place.height
    ray = (look(place, view.spaces.active.region_3d, at) for look in (region_2d_to_origin_3d, region_2d_to_vector_3d))
    hit, point_there, *_ = scene.ray_cast(bpy.context.evaluated_depsgraph_get(), *ray)
    assert hit
    return -(scene.camera.matrix_world.normalized().inverted() @ point_there).z


def turn(f_stop, distance):
    """Set focus and f-stop in the camera's Depth of Field panel."""
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, f_stop, distance
    bpy.ops.ed.undo_push(message="Turn Rings")


@contextmanager
def stalls():
    """What happens in the window's thread: a dictionary with the times between calls of a timer ("gaps_s"), Lensfield's
    longest use of the processor ("own_s", by the name of its function), and the lenses that it bakes ("bakes")."""
    noted, last = {"gaps_s": [], "own_s": {}, "bakes": []}, [time.monotonic()]
    modules = {name: sys.modules[f"{MODULE}.addon.{name}"] for name in (*OWN_FUNCTIONS, "scene.lens_cache")}
    library = modules["scene.lens_cache"].library
    before = [(library, "load_lens", library.load_lens)]
    before += [(modules[name], function, getattr(modules[name], function))
               for name, functions in OWN_FUNCTIONS.items() for function in functions]

    def bake(*given, **named):
        if threading.current_thread() is threading.main_thread():
            noted["bakes"].append(given[0])
        return before[0][2](*given, **named)

    def timed(name, call):
        def run(*given, **named):
            began_s = time.thread_time()
            try:
                return call(*given, **named)
            finally:
                noted["own_s"][name] = max(noted["own_s"].get(name, 0), time.thread_time() - began_s)
        return run

    def tick():
        last.append(time.monotonic())
        noted["gaps_s"].append(last[-1] - last[-2])
        return 0.005

    library.load_lens = bake
    for module, name, call in before[1:]:
        setattr(module, name, timed(f"{module.__name__.rpartition('.')[2]}.{name}", call))
    bpy.app.timers.register(tick, persistent=True)
    try:
        yield noted
    finally:
        bpy.app.timers.unregister(tick)
        for module, name, call in before:
            setattr(module, name, call)


OWN_FUNCTIONS = {"ui.window_render": ("start", "start_again", "tick"),
                 "ui.preview.preview": ("start", "tick", "on_update"),
                 "ui.operators": ("_match",), "ui.panels": ("draw_settings", "draw_camera_settings"),
                 "ui.common.background": ("_tick",)}
"""What Lensfield runs in the window's thread: the work of operators, timers and handlers, and the panels."""


def lens_request():
    """The panel's request for its lens, with the results so far."""
    return sys.modules[f"{MODULE}.addon.ui.common.lens_worker"].lens_request(bpy.context.scene)


def trust():
    return sys.modules[f"{MODULE}.addon.scene.trust"]


def drawn(part):
    """A set that collects, from now on, the kinds of area whose panels draw a part of the Lensfield panel."""
    panels, kinds = sys.modules[f"{MODULE}.addon.ui.panels"], set()
    draw = getattr(panels, part)
    setattr(panels, part, lambda *given: (kinds.add(bpy.context.area.type), draw(*given)))
    return kinds


def show_section(draw):
    """Draw a section of the Lensfield panel in place of the lens; returns a function that ends that."""
    panels = sys.modules[f"{MODULE}.addon.ui.panels"]
    lens = panels._draw_lens
    panels._draw_lens = lambda layout, scene, camera: getattr(panels, draw)(layout, scene)
    return lambda: setattr(panels, "_draw_lens", lens)


def raise_vase():
    bpy.data.objects["Vase"].location.z += 0.02


def preview_under_way():
    """The active preview, or None."""
    return session().preview


def preview_columns_px():
    """The width of the preview's picture; 0 without one."""
    shown = preview_under_way().shown
    return shown.columns_px if shown else 0


def preview_is_fresh():
    """Whether the preview shows the current scene through the chosen lens; it may still be refined."""
    preview = preview_under_way()
    assert preview and not preview.error, preview and preview.error
    key = sys.modules[f"{MODULE}.addon.ui.preview.preview"].lens_key(bpy.context.scene)
    return preview.picture.is_file() and preview.fresh and preview.number > 0 and preview.lens == key


def frame_width_px(view):
    """The width of the camera's frame in a viewport, or of the picture, if that is smaller."""
    scene, place = bpy.context.scene, region(view)
    matrix = scene.camera.matrix_world.normalized()
    across = [location_3d_to_region_2d(place, view.spaces.active.region_3d, matrix @ corner).x
              for corner in scene.camera.data.view_frame(scene=scene)]
    return round(min(max(across) - min(across), scene.render.resolution_x * scene.render.resolution_percentage // 100))


def frame_as_drawn(view):
    """The mean colour of the camera's frame in a viewport, as the screen shows it, without the part under the sidebar.
    """
    scene, place = bpy.context.scene, region(view)
    matrix = scene.camera.matrix_world.normalized()
    corners = [location_3d_to_region_2d(place, view.spaces.active.region_3d, matrix @ corner)
               for corner in scene.camera.data.view_frame(scene=scene)]
    left, right = (round(side(corner.x for corner in corners)) for side in (min, max))
    bottom, top = (round(side(corner.y for corner in corners)) for side in (min, max))
    shoot("frame", place)
    return pixels(FOLDER.parent / f"{STEP}-frame.png")[bottom:top, left:right, :3].mean((0, 1))


def session():
    return sys.modules[f"{MODULE}.addon.ui.common.session"].session


def rendering():
    """The active lens render, or None."""
    return session().render


def progress():
    return rendering().label if rendering() else ""


def notice():
    return "\n".join(session().last_render.lines)


def in_a_pass():
    assert rendering(), notice()
    return progress().startswith(("Pass", "Layer")) and rendering().fraction > 0


def child():
    """The process id of the render."""
    return rendering().child._process.pid


def alive(number):
    """Whether a process is running."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def start(operator="render"):
    """Press one of Lensfield's buttons, by default Render through Lens."""
    with over():
        assert getattr(bpy.ops.lensfield, operator)("INVOKE_DEFAULT") == {"FINISHED"}
    yield DRAW_S


def start_endless():
    """Start a render that takes longer than a step, and wait until it is running."""
    yield from open_sample(samples=1 << 16, percentage=100)
    yield from start()
    yield from until(in_a_pass)


def render(operator="render"):
    """Press one of Lensfield's buttons and wait; returns the current frame's lens image, float array (row, column, 4).
    """
    yield from start(operator)
    yield from until(lambda: not rendering())
    assert session().last_render.icon == "INFO", notice()
    yield DRAW_S
    return pixels(lens_image_path())


def click_apply(panel):
    """Click Apply to Last Render, and wait."""
    yield from click("lensfield.apply_lens", panel)
    yield from until(lambda: not rendering())
    yield 1
    assert session().last_render.icon == "INFO", notice()


def blenders_log():
    """The lines that an Info editor shows, and hence the status bar."""
    place = area("PROPERTIES")
    place.type = "INFO"
    yield DRAW_S
    with over("INFO"):
        bpy.ops.info.select_all(action="SELECT")
        bpy.ops.info.report_copy()
    place.type = "PROPERTIES"
    return bpy.context.window_manager.clipboard


def lens_image_path():
    scene = bpy.context.scene
    folder = Path(bpy.path.abspath(scene.lensfield.output_folder))
    name = f"{Path(bpy.data.filepath).stem or 'unsaved'}_{scene.name}"
    return folder / f"{bpy.path.clean_name(name)}_{scene.frame_current:04d}_lens_image.exr"


def place_on_sheet(compared, place):
    """The middle of a picture on the contact sheet that a region of an Image Editor shows, in fractions of it."""
    left, top, right, bottom = compared.box
    width, height = area("IMAGE_EDITOR").spaces.active.image.size
    across, up = place.view2d.view_to_region((left + right) / 2 / width, 1 - (top + bottom) / 2 / height, clip=False)
    return across / place.width, up / place.height


def render_window():
    """Press F12; returns the window that Blender opens while its render is running."""
    yield from press("F12", region(area("VIEW_3D")), across=0.3)
    yield from until(lambda: bpy.app.is_job_running("RENDER") and newest_window() != main_window())
    yield 1
    return newest_window()


def render_in_blender():
    """Press F12; returns the displayed picture, float array (row, column, 4), in its scene's linear colours."""
    scene = bpy.context.scene
    yield from press("F12", area("VIEW_3D"))
    yield from until(lambda: bpy.app.is_job_running("RENDER") or len(bpy.context.window_manager.windows) > 1)
    yield from until(lambda: not bpy.app.is_job_running("RENDER"))
    yield DRAW_S
    path = FOLDER / "f12.exr"
    settings = scene.render.image_settings
    before = settings.file_format
    settings.file_format = "OPEN_EXR"
    bpy.data.images["Render Result"].save_render(str(path), scene=scene)
    settings.file_format = before
    shoot("f12")
    close_other_windows()
    yield DRAW_S
    return pixels(path)


def close_other_windows():
    """Close all windows except the main one."""
    for window in list(bpy.context.window_manager.windows)[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()


def pixels(path):
    """The pixels of a picture file."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    assert np.isfinite(values).all()
    return values


def alike(one, other):
    """Whether two pictures are equal within half precision."""
    return one.shape == other.shape and np.allclose(one[..., :3], other[..., :3], rtol=2e-3, atol=1e-4)


def node_label():
    """The label of the Lensfield node in the compositor; None without such a node."""
    labels = [node.label for node in _lensfield_nodes()]
    return labels[0] if labels else None


def link_output(name):
    """Connect an output of the Lensfield node to the compositor's picture."""
    node, = _lensfield_nodes()
    link, = node.outputs["Image"].links
    node.id_data.links.new(node.outputs[name], link.to_socket)


def _lensfield_nodes():
    scene = bpy.context.scene
    tree = scene.compositing_node_group if hasattr(scene, "compositing_node_group") else scene.node_tree
    return [node for node in tree.nodes if node.bl_idname == "CompositorNodeGroup"] if tree else []


def write_flat_fields(lens, paths):
    """Write raw pictures of an even field through a lens with narrower rims; their names are their f-numbers."""
    from flat_pictures import flat_light, mounted, write_flat
    from lensfield.engine.fitting.even_light import EvenField
    from lensfield.engine.fitting.rims import with_rims
    from lensfield.engine.library import prescription_of

    prescription = prescription_of(lens)
    narrower = with_rims(prescription, [EvenField(prescription, np.inf, np.array([0.0, 10.0, 21.6]))],
                         {2: 13.0, 10: 10.6})
    for path in paths:
        f_number = float(path.stem)
        write_flat(path, flat_light(narrower, f_number, (36.0, 24.0), (0.05, 0.02)), mounted(58.0, f_number))


def fit_to_all_files(panel):
    """Fit the lens to the raw pictures in the folder of this step, in the file browser."""
    yield from click("lensfield.fit_lens", panel)
    yield from until(lambda: area("FILE_BROWSER", newest_window()))
    yield 1
    with over("FILE_BROWSER", newest_window()):
        bpy.context.space_data.params.directory = os.fsencode(FOLDER)
    yield 1
    with over("FILE_BROWSER", newest_window()):
        bpy.ops.file.select_all(action="SELECT")
    yield DRAW_S
    shoot("browser")
    with over("FILE_BROWSER", newest_window()):
        bpy.ops.file.execute("INVOKE_DEFAULT")
    yield from until(lambda: len(bpy.context.window_manager.windows) == 1)
