"""A user's actions, step by step. Each step runs in a separate Blender; the first installs the extension for all."""

import functools
import itertools
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import live_figures
import numpy as np
from hands import (
    DRAW_S,
    FOLDER,
    MODULE,
    PACKAGE,
    SAMPLE,
    Box,
    adjust,
    alike,
    alive,
    area,
    at_rest,
    blenders_log,
    child,
    choose_petzval,
    click,
    click_apply,
    close_other_windows,
    confirm,
    drag,
    drawn,
    find,
    fit_to_all_files,
    frame_as_drawn,
    frame_width_px,
    in_a_pass,
    lens_image_path,
    lens_request,
    link_output,
    main_window,
    newest_window,
    node_label,
    notice,
    open_sample,
    open_section,
    over,
    over_region,
    pixels,
    place_on_sheet,
    point,
    press,
    press_at,
    preview_columns_px,
    preview_is_fresh,
    preview_under_way,
    raise_vase,
    region,
    render,
    render_in_blender,
    render_window,
    rendering,
    report,
    scroll_to,
    scroll_up,
    seen_distance,
    served,
    session,
    shoot,
    show_preferences,
    show_section,
    show_tab,
    stalls,
    start,
    start_endless,
    top_right,
    trust,
    turn,
    type_number,
    uninstall,
    until,
    write,
    write_flat_fields,
)

LIVE_LENSES = ("olympus-fisheye-8mm", "muller-fisheye-25mm", "zeiss-hologon-15mm", "zeiss-flektogon-20mm",
               "nikkor-28mm", "edmund-54852", "tessar-50mm", "nikkor-58mm-f1.4", "canon-50mm-f0.95",
               "kodak-petzval-100mm", "nikkor-z-135mm-plena", "canon-fd-500mm-f4.5", "cooke-42mm-2x")
LIVE_TILTED, LIVE_TILT_DEG = "zeiss-biotar-50mm", (1.5, -1.0)
FAST_LENS = "angenieux-50mm"
COMPARED_LENSES = "edmund-54852", "zeiss-biotar-50mm"
PICTURE_PX = 100  # from the lens's name up to its picture
STAR = MARK = 0.83  # of the panel's width
TOOLTIP_S = 2
PIECE, TOWN = (0.469, 0.36), (0.45, 0.5)  # a chess piece and a house in the viewport, in fractions of it
SECOND_LENS = 0.175, 0.655  # its title in the dialog that compares lenses, in fractions of the window
ZIP_NAME = "lensfield-0.1.0-linux-x64-blender5.1.zip"
INSTALL_SCALE, INSTALL_SHARE = 1.5, 0.64  # of Blender's interface; of the window's width for the preferences
SETTINGS_ARROW, REPOSITORIES = (30, 27), (100, 27)  # px from the upper right corner of the preferences, at this scale
PLUS, ADD_REMOTE = (43, 88), (157, 120)  # in the list of repositories, and in the menu of its button
CHECK_FOR_UPDATES = 372, 168  # in the dialog of this menu
DOT_LENS = """# A Cooke triplet, without its field
name: Triplet 50mm f/5
focal_length: 50.00
surfaces:
# radius    thickness    ior     abbe   semi_ap  coating
  22.01359  3.25895583   1.62041 60.32  19.0     1
  -435.7604 6.0075511    1.00000 0.00   19.0     1
  -22.21328 0.999974567  1.62004 36.37  10.0     1
  20.29192  2.3752       1.00000 0.00   10.0     1
  stop      2.37520893   1.00000 0.00   8.0      0
  79.6836   2.95207564   1.62041 60.32  15.0     1
  -18.39533 42.2077801   1.00000 0.00   15.0     1
"""
CALIBRATION = """image_width: 640
image_height: 480
camera_name: webcam
camera_matrix: {rows: 3, cols: 3, data: [438.8, 0.0, 305.6, 0.0, 437.3, 243.7, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.362, 0.1105, 0.001, 0.0005, 0.0]}
"""


def install():
    """Install from disk with Blender's operator, and save the preferences."""
    assert bpy.ops.extensions.package_install_files(
        filepath=PACKAGE, repo="user_default", enable_on_install=True) == {"FINISHED"}
    assert Path(sys.modules[MODULE].__file__).is_relative_to(os.environ["BLENDER_USER_RESOURCES"])
    bpy.ops.wm.save_userpref()
    yield from show_tab()
    yield 1
    assert region(area("VIEW_3D"), "UI").active_panel_category == "Lensfield"


def default_scene():
    """An unsaved scene, rendered with one click: the picture is in the compositor, and its folder is reported."""
    yield from show_tab()
    bpy.context.scene.cycles.samples, bpy.context.scene.render.resolution_percentage = 4, 25
    bpy.ops.ed.undo_push(message="Make Small")
    yield 1
    shoot("untouched")
    yield from start()
    shoot("under-way")
    yield from until(lambda: not rendering())
    yield 0.5
    assert node_label() == "Lensfield: lens image", notice()
    assert not bpy.data.filepath


def sample_scene():
    """The sample scene opens in the camera's view and renders; the result is in the compositor and in F12's picture."""
    yield from open_sample()
    assert area("VIEW_3D").spaces.active.region_3d.view_perspective == "CAMERA"
    shoot("opened")
    lens_image = yield from render()
    assert lens_image.mean() > 1e-3
    yield 0.5
    shoot("rendered")
    assert alike((yield from render_in_blender()), lens_image)


def guide_pictures():
    """Screenshots for the guide: the panel at first, with rings, searching, during a render, and after it; the preview,
    the live view, and the dialog of a lens file."""
    yield from open_sample(samples=64, percentage=100)
    bpy.context.preferences.view.render_display_type = "NONE"  # no window in front of the viewport
    view = area("VIEW_3D")
    panel = region(view, "UI")
    yield from until(lambda: lens_request().lens)
    yield 3  # for the plan
    shoot("panel", panel)
    turn(f_stop=4, distance=0.3)
    yield from until(lambda: lens_request().lens)
    yield 1
    shoot("rings", panel)
    yield from point(panel, 0.5, 0.72)
    with over_region(view, panel):
        bpy.ops.lensfield.search_lens("INVOKE_DEFAULT")
    yield DRAW_S
    for letter in "portrait":
        main_window().event_simulate(type=letter.upper(), value="PRESS", unicode=letter)
        main_window().event_simulate(type=letter.upper(), value="RELEASE")
        yield 0.1
    yield 1
    shoot("find")
    yield from press("ESC", panel)
    yield from start("preview")
    yield from until(lambda: preview_is_fresh() and not preview_under_way().at_work)  # its finest picture
    yield from point(view, 0.2, 0.9)  # without a tooltip
    yield 1
    shoot("preview", region(view))
    yield from start("preview")
    yield from start()
    yield from until(lambda: rendering().picture.is_file())
    yield 1
    shoot("under_way", panel)
    yield from until(lambda: not rendering())
    yield 1
    shoot("last", panel)
    choose_petzval()
    turn(f_stop=2.2, distance=0.25)
    view.spaces.active.shading.type = "MATERIAL"
    yield from start("live")
    yield from until(lambda: lens_request().lens)
    yield from at_rest("live", region(view))  # Blender has compiled its shaders
    yield from start("live")
    view.spaces.active.shading.type = "SOLID"
    path = FOLDER / "triplet.lens"
    path.write_text(DOT_LENS)
    yield from point(view, 0.1, 0.9)
    with over():
        bpy.ops.lensfield.open_lens("INVOKE_DEFAULT", filepath=str(path))
    yield 2  # for the drawing
    shoot("dialog")
    yield from press("ESC", view)


def another_lens():
    """Another lens is applied to the stored light without a render; one undo reverts it."""
    yield from open_sample()
    first = yield from render()
    choose_petzval()
    bpy.ops.ed.undo_push(message="Choose Lens")
    start_s = time.monotonic()
    second = yield from render("apply_lens")
    print(f"applied within {time.monotonic() - start_s:.1f} s")
    shoot("applied")
    assert second.shape == first.shape and not alike(first, second)
    assert alike((yield from render_in_blender()), second)


def compare():
    """The dialog ticks lenses; a click on a picture of the contact sheet chooses its lens and f-stop, and one undo
    reverts it."""
    yield from open_sample()
    bpy.context.preferences.view.render_display_type = "SCREEN"
    with over():
        bpy.ops.lensfield.compare("INVOKE_DEFAULT")
    yield 1
    shoot("dialog")
    yield from press("ESC", area("VIEW_3D"))
    lenses = [{"name": name, "ticked": True} for name in COMPARED_LENSES]
    with over():
        assert bpy.ops.lensfield.compare("EXEC_DEFAULT", lenses=lenses, f_stops={"2.8", "5.6"}, side_px=160,
                                         samples=4) == {"FINISHED"}
    yield from until(lambda: not rendering())
    yield 1
    sheet = session().last_sheet
    editor = area("IMAGE_EDITOR")
    assert bpy.path.abspath(editor.spaces.active.image.filepath) == str(sheet.path) and len(sheet.lenses) == 4
    place, compared = region(editor), sheet.lenses[2]
    across, up = place_on_sheet(compared, place)
    before = bpy.context.scene.camera.data.lensfield.lens
    yield from press("LEFTMOUSE", place, across=across, up=up)
    yield 0.5
    shoot("chosen")
    scene = bpy.context.scene
    assert scene.camera.data.lensfield.lens == compared.lens == COMPARED_LENSES[1] != before
    assert abs(scene.camera.data.dof.aperture_fstop / compared.f_number - 1) < 1e-6
    yield from press("Z", place, ctrl=True)
    assert bpy.context.scene.camera.data.lensfield.lens == before


def own_lens():
    """A file with a lens that does not state its field opens a dialog; its answers are stored with the lens, and the
    panel and the preview use it."""
    yield from open_sample()
    path = FOLDER / "own_lens.lens"
    path.write_text(DOT_LENS)
    with over():
        bpy.ops.lensfield.open_lens("INVOKE_DEFAULT", filepath=str(path))
    yield 2  # for the drawing
    shoot("dialog")
    yield from press("RET", area("VIEW_3D"))
    settings = bpy.context.scene.camera.data.lensfield
    assert (settings.lens, settings.lens_file) == ("FILE", "//lenses/own_lens.toml")
    yield from until(lambda: lens_request().facts)
    assert abs(lens_request().facts.efl_mm - 50) < 1
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("preview")
    yield from start("preview")


def open_calibration():
    """A calibration of another program, from the file browser, becomes the camera's lens. The panel says what was
    measured, and the preview shows it."""
    yield from open_sample()
    scene, panel = bpy.context.scene, region(area("VIEW_3D"), "UI")
    settings, path = scene.camera.data.lensfield, FOLDER / "webcam.yaml"
    path.write_text(CALIBRATION)
    settings.lens = "FILE"
    yield DRAW_S
    yield from click("lensfield.open_measured", panel)
    yield from until(lambda: area("FILE_BROWSER", newest_window()))
    yield DRAW_S
    shoot("browser")
    with over("FILE_BROWSER", newest_window()):
        parameters = bpy.context.space_data.params
        parameters.directory, parameters.filename = os.fsencode(FOLDER), path.name
        bpy.context.space_data.active_operator.sensor_mm = 4.8, 3.6
        bpy.ops.file.execute()
    yield from until(lambda: settings.lens_file == "//lenses/webcam.npz")
    yield from until(lambda: lens_request().facts)
    yield DRAW_S
    shoot("opened")
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("preview")
    yield from start("preview")


def fit_lens():
    """A lens of the library is marked as compared with photographs. Fitted to raw pictures from the file browser, it
    becomes a lens of the user's own, whose sheet shows a picture next to its light. Esc ends a fit."""
    yield from open_sample()
    turn(f_stop=2, distance=5)
    lens_of, name = (lambda: bpy.context.scene.camera.data.lensfield), "helios-44-2-58mm"
    lens_of().lens = name
    bpy.ops.ed.undo_push(message="Choose Lens")
    write_flat_fields(name, [FOLDER / f"{f_number}.dng" for f_number in (2.0, 2.8, 4.0, 8.0)])
    panel = region(area("VIEW_3D"), "UI")
    yield from until(lambda: lens_request().lens)
    mark = yield from find("lensfield.show_sheet", panel, across=MARK)
    yield from point(panel, MARK, mark - 1 / panel.height, wait_s=TOOLTIP_S)
    shoot("mark")
    yield from open_section("sheet", panel)
    yield from scroll_to("lensfield.fit_lens", panel)
    reader = sys.modules[f"{MODULE}.addon.ui.fit_lens"]
    read = reader.read_flat_fields
    reader.read_flat_fields = lambda *given: itertools.repeat(next(read(*given)))  # for ever
    yield from fit_to_all_files(panel)
    yield from until(lambda: main_window().modal_operators)
    yield DRAW_S
    shoot("under-way")
    yield from press("ESC", area("VIEW_3D"))
    yield from until(lambda: not main_window().modal_operators)
    assert lens_of().lens == name
    reader.read_flat_fields = read
    yield from fit_to_all_files(panel)
    yield from until(lambda: lens_of().lens == "FILE")
    assert lens_of().lens_file == f"//lenses/{name}-fitted.toml"
    yield from until(lambda: lens_request().lens)
    assert [curve.f_number for curve in lens_request().facts.photographs.light] == [2]
    yield 5  # for the sheet
    shoot("fitted")
    yield from scroll_up(panel)
    shoot("own")
    yield from click("lensfield.show_sheet", panel, across=MARK)
    yield 2
    shoot("page")
    close_other_windows()
    with over():
        bpy.ops.ed.undo()
    assert lens_of().lens == name


def sensors():
    """The lens in front of other sensors, in the panel, after Match Camera to Lens, and in renders."""
    yield from open_sample()
    scene = bpy.context.scene
    scene.camera.data.lensfield.lens, shares = "tessar-50mm", {}
    for view in ("LENS", "MFT", "FILM66", "SENSOR"):
        scene.camera.data.lensfield.view, scene.camera.data.lensfield.sensor_mm = view, (18, 12)
        yield from until(lambda: lens_request().lens)
        with over():
            assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
        yield DRAW_S
        shoot(view.lower())
        shares[view] = scene.camera.data.lens / scene.camera.data.sensor_width
    assert abs(shares["SENSOR"] / shares["LENS"] - 2) < 1e-3  # of 36 x 24 mm
    image = yield from render()
    assert image.mean() > 1e-3


def camera():
    """A camera behind the lens: its section of the panel, its developed picture in the compositor, and its raw file."""
    yield from open_sample()
    adjust(lens="apple-phone-4mm", view="LENS")
    light = yield from render()
    adjust(body="generic-phone", iso=200, dng=True)
    yield from until(lambda: lens_request().lens)
    shown = show_section("_draw_body")
    yield DRAW_S
    shoot("section")
    photo = yield from render()
    shown()
    yield DRAW_S
    shoot("developed")
    raw = lens_image_path().with_name(lens_image_path().name.replace("lens_image.exr", "raw.dng"))
    assert raw.is_file() and "ISO 200" in "".join(session().last_render.lines)
    assert not alike(light, photo) and 0.02 < photo[..., :3].mean() < 0.5
    adjust(body="NONE")
    again = yield from render()
    assert alike(light, again) and not raw.exists()


def stray():
    """Stray light from its section of the panel: in the lens image, and from the socket of the compositor's node."""
    yield from open_sample()
    settings = bpy.context.scene.lensfield
    adjust(lens="cooke-triplet-50mm", coating="NONE")
    settings.stray_light = "OFF"
    without = yield from render()
    settings.stray_light, settings.stray_parts, settings.cleanliness = "PARTS", {"GHOSTS", "VEIL", "STAR"}, "DUSTY"
    shown = show_section("_draw_stray")
    yield DRAW_S
    shoot("section")
    lens_image = yield from render()
    shown()
    shoot("rendered")
    assert "strongest ghosts" in "".join(session().last_render.lines)
    stray = pixels(lens_image_path().with_name(lens_image_path().name.replace("lens_image", "stray_light")))
    lens_alone = (lens_image - stray)[..., :3]
    remaining = lens_alone.sum() / without[..., :3].sum()
    assert 0.9 < remaining < 1 and np.allclose(lens_alone, remaining * without[..., :3], rtol=0.01, atol=1e-3)
    assert 0.02 < stray[..., :3].sum() / lens_alone.sum() < 0.3
    link_output("Stray Light")
    assert alike((yield from render_in_blender()), stray)
    shoot("graded")


def preview():
    """The preview soon shows the camera's view, follows lens and scene, and leaves nothing behind."""
    yield from open_sample(samples=64, percentage=100)
    yield from start("preview")
    pictures = []
    for name, change in (("first", lambda: None), ("lens", choose_petzval), ("scene", raise_vase)):
        change()
        start_s = time.monotonic()
        yield 0.2  # for Blender to process the change
        if preview_under_way().slow:  # copying is slow here, so the preview waits for a click
            yield from start("refresh_preview")
        yield from until(preview_is_fresh)
        print(f"{name}: {time.monotonic() - start_s:.1f} s")
        yield 0.5
        shoot(name)
        image = bpy.data.images["Lensfield Preview"]
        pictures.append(pixels(bpy.path.abspath(image.filepath)))
        assert pictures[-1].mean() > 1e-3
    assert not alike(pictures[0], pictures[1]) and not alike(pictures[1], pictures[2])
    number, folder = preview_under_way().child._process.pid, preview_under_way().folder.name
    yield from start("preview")
    assert "Lensfield Preview" not in bpy.data.images
    return [number, folder]


def preview_grows():
    """A coarse picture is refined; it stays while a ring turns, and disappears when the scene changes."""
    yield from open_sample(samples=64, percentage=100)
    choose_petzval()
    turn(f_stop=2.8, distance=0.2)
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("coarse")
    yield from until(lambda: preview_under_way().child.status.get("samples", 0) > 4)
    yield DRAW_S
    shoot("fine")
    for distance in (0.22, 0.25, 0.34):
        turn(f_stop=2.8, distance=distance)
        yield DRAW_S
        assert preview_under_way().same_scene
    shoot("turning")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("turned")
    raise_vase()
    yield DRAW_S
    assert not preview_under_way().same_scene
    shoot("changed")
    yield from start("preview")


def preview_from_any_view():
    """One click on Preview turns the viewport to the camera, unless the user prefers the picture in the panel."""
    yield from open_sample(samples=64, percentage=100)
    view = area("VIEW_3D").spaces.active
    view.region_3d.view_perspective, view.overlay.show_overlays = "PERSP", False
    yield from start("preview")
    assert view.region_3d.view_perspective == "CAMERA" and view.overlay.show_overlays
    yield from until(lambda: preview_under_way().child.status.get("label"))
    yield DRAW_S
    shoot("waiting")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("arrived")
    yield from start("preview")
    preferences = bpy.context.preferences.addons[MODULE].preferences
    view.region_3d.view_perspective, preferences.preview_place = "PERSP", "PANEL"
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("in-the-panel")
    assert view.region_3d.view_perspective == "PERSP"
    preferences.preview_place = "CAMERA"  # Blender saves the preferences on exit, for the next steps


def no_stalls():
    """With a lens that takes long to bake, neither a copy, nor tilt, nor a matched camera, nor a render, applied or
    not, bakes it in the window's thread. The log states how long Lensfield used that thread's processor, and how long
    the window stood still before and then, as it also does for its own drawing."""
    yield from open_sample(samples=1, lens="zeiss-planar-80mm")
    bpy.context.preferences.view.render_display_type = "NONE"
    view, settings = area("VIEW_3D"), bpy.context.scene.camera.data.lensfield
    panel = region(view, "UI")
    yield from until(lambda: lens_request().lens)
    with stalls() as idle:
        yield 3
    print(f"nothing pressed: the window stands still for up to {max(idle['gaps_s']):.3f} s", flush=True)
    for name, action in (("copy", lambda: setattr(settings, "copy", 7)),
                         ("tilt", lambda: setattr(settings, "tilt_deg", (0.0, math.radians(2)))),
                         ("match_camera", None), ("render", None), ("apply_lens", None), ("preview", None)):
        if name not in ("copy", "tilt"):
            up = yield from find(f"lensfield.{name}", panel, 0.3)
            action = functools.partial(press, "LEFTMOUSE", panel, across=0.3, up=up)
        with stalls() as noted:
            yield from action() or ()
            yield 3
            yield from until(lambda: not rendering())
            yield 1
        shoot(name)
        assert not noted["bakes"], (name, noted["bakes"])
        used = ", ".join(f"{function} {used_s:.3f} s" for function, used_s in noted["own_s"].items() if used_s > 0.01)
        print(f"{name}: the window stands still for up to {max(noted['gaps_s']):.3f} s; the longest uses of its thread "
              f"by Lensfield: {used or 'below 0.01 s'}", flush=True)
    yield from start("preview")


def one_look():
    """The window's picture, its PNG and the contact sheet have the look of the scene."""
    yield from open_sample(samples=8, percentage=50)
    view = bpy.context.scene.view_settings
    view.view_transform, view.look, view.exposure = "AgX", "AgX - Punchy", 0.5
    bpy.context.preferences.view.render_display_type = "AREA"
    yield from render()
    yield 1
    shoot("rendered")
    image = area("IMAGE_EDITOR").spaces.active.image
    assert image.use_view_as_render and bpy.path.abspath(image.filepath) == str(lens_image_path())
    shown, saved = FOLDER / "shown.png", lens_image_path().with_name(
        lens_image_path().name.replace("lens_image.exr", "after.png"))
    light = bpy.data.images.load(str(lens_image_path()))
    light.colorspace_settings.name = "Linear Rec.709"
    light.save_render(str(shown), scene=bpy.context.scene)
    assert np.abs(pixels(shown) - pixels(saved))[..., :3].max() < 1.5 / 255
    with over("IMAGE_EDITOR"):
        assert bpy.ops.lensfield.compare("EXEC_DEFAULT", lenses=[{"name": name, "ticked": True} for name in
                                                                 (COMPARED_LENSES[0], "cooke-42mm-2x")],
                                         side_px=320, samples=8) == {"FINISHED"}
    yield from until(lambda: not rendering())
    yield 1
    shoot("compared")
    assert session().last_sheet and len(session().last_sheet.lenses) == 2, notice()


def two_files():
    """Two files in one folder have pictures of their own; a render survives Save As and a new name of its scene."""
    yield from open_sample(samples=1)
    images = {"one": (yield from render())}
    bpy.context.scene.name = "Renamed"
    yield from render("apply_lens")
    assert alike(pixels(lens_image_path()), images["one"]) and node_label() == "Lensfield: lens image"
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "two.blend"))
    yield from render("apply_lens")
    assert alike(pixels(lens_image_path()), images["one"]) and node_label() == "Lensfield: lens image"
    raise_vase()
    bpy.ops.ed.undo_push(message="Raise Vase")
    yield DRAW_S
    yield from render("apply_lens")
    assert node_label() == "Lensfield: plain render, the scene has changed since"
    images["two"] = yield from render()
    shoot("two")
    assert node_label() == "Lensfield: lens image" and not alike(*images.values())
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / SAMPLE.name))
    yield 1
    assert alike(pixels(lens_image_path()), images["one"])
    yield from render("apply_lens")
    shoot("one")
    assert alike(pixels(lens_image_path()), images["one"]) and node_label() == "Lensfield: lens image"


def opens_as_f12():
    """A finished render opens where the preferences let Blender show its own, or nowhere."""
    yield from open_sample(samples=1)
    window_manager, lens_image = bpy.context.window_manager, sys.modules[f"{MODULE}.addon.scene.compositor"].lens_image
    for place, windows in (("NONE", 1), ("AREA", 1), ("SCREEN", 1), ("WINDOW", 2)):
        bpy.context.preferences.view.render_display_type = place
        yield from render()
        yield 1
        shoot(place.lower())
        images = [each.spaces.active.image for window in window_manager.windows for each in window.screen.areas
                  if each.type == "IMAGE_EDITOR"]
        assert len(window_manager.windows) == windows
        assert (lens_image(bpy.context.scene) in images) == (place != "NONE"), (place, images)
        if place in ("AREA", "SCREEN"):
            with over("IMAGE_EDITOR"):
                bpy.ops.render.view_cancel()  # as Esc does
        yield DRAW_S
    close_other_windows()


def live_lamps():
    """The live view shows a lamp in the foreground, at f/1.1, as an even disc without squares and without a lattice."""
    yield from live_figures.make_scene()
    bpy.context.scene.camera.data.lensfield.view = "LENS"
    viewport = live_figures.Viewport()
    grain = yield from live_figures.grain(viewport, live_figures.set_up(viewport, FAST_LENS, (0.0, 0.0)))
    shoot("lamp")
    print(f"grain {grain:.3f} of {live_figures.GRAIN_LIMIT}", flush=True)
    assert grain <= live_figures.GRAIN_LIMIT, grain


def live():
    """The live view through thirteen lenses, from fisheye to anamorphic, and a tilted one agrees with the engine in the
    places of three colours, in illumination, and in the discs of blurred points; switched off, it leaves Blender's own
    view."""
    yield from live_figures.make_scene()
    bpy.context.scene.camera.data.lensfield.view = "LENS"
    viewport, found = live_figures.Viewport(), {}
    for name in LIVE_LENSES:
        found[name] = yield from live_figures.errors(viewport, name)
    found |= {f"{LIVE_TILTED}, tilted": (yield from live_figures.errors(viewport, LIVE_TILTED, LIVE_TILT_DEG))}
    shoot("discs")
    with_live_s = live_figures.redraw_s()
    yield from start("live")
    print(f"seconds of the processor for a redraw: {with_live_s - live_figures.redraw_s():.2f} more with the live view")
    exceeded = [f"{name}: {key} {value:.3f}" for name, values in found.items() for key, value in values.items()
                if not value <= live_figures.LIMITS[key]]
    assert not exceeded, "; ".join(exceeded)


def quick_look():
    """Quick Look shows renders of EEVEE through the lens, also after another one is chosen; an undo removes it."""
    yield from open_sample(percentage=15, view="CAMERA", lens="nikkor-28mm")
    scene = bpy.context.scene
    scene.render.engine, scene.eevee.taa_render_samples = "BLENDER_EEVEE", 1
    bpy.ops.ed.undo_push(message="Choose EEVEE")
    without = yield from render_in_blender()
    with over():
        assert bpy.ops.lensfield.quick_look("INVOKE_DEFAULT", True) == {"FINISHED"}  # with its own undo step
    assert node_label().startswith("Quick Look: Nikkor 28 mm"), node_label()
    first = yield from render_in_blender()
    choose_petzval()
    bpy.ops.ed.undo_push(message="Choose Lens")
    yield from until(lambda: "Petzval" in node_label())
    second = yield from render_in_blender()
    assert not alike(without, first) and not alike(first, second)
    relative = second[..., 1] / without[..., 1]
    (rows, columns), side = relative.shape, 10
    corner, middle = relative[:side, :side].mean(), relative[rows // 2:, columns // 2:][:side, :side].mean()
    assert corner < 0.9 * middle, (corner, middle)
    area("VIEW_3D").ui_type = "CompositorNodeTree"
    yield 1
    with over("NODE_EDITOR"):
        bpy.ops.node.view_all()
    yield 1
    shoot("nodes")
    area("NODE_EDITOR").ui_type = "VIEW_3D"
    bpy.ops.ed.undo()
    yield from until(lambda: "Nikkor" in node_label())
    bpy.ops.ed.undo()
    yield DRAW_S
    assert not node_label() and bpy.context.scene.render.engine == "BLENDER_EEVEE"


def depth():
    """Sharp and blurred: the focus overlay follows rings and tilt at once, and a render continues during an undo."""
    yield from open_sample(samples=16, percentage=100)
    scene = bpy.context.scene
    choose_petzval()
    scene.camera.data.dof.aperture_blades, scene.camera.data.lensfield.iris_roundness = 5, 0.2
    turn(f_stop=2.8, distance=0.2)
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield from start("focus_overlay")
    yield DRAW_S
    shoot("near")
    for distance in (0.22, 0.25, 0.34):
        turn(f_stop=2.8, distance=distance)
        yield DRAW_S
        assert preview_under_way().same_scene
    shoot("dragged")
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("far")
    for degrees in (8, -8, 0):
        scene.camera.data.lensfield.tilt_deg = 0.0, math.radians(degrees)
        yield DRAW_S
        assert preview_under_way().same_scene
        shoot(f"tilted {degrees}")
    yield from start("preview")
    scene.render.resolution_percentage = 25
    bpy.ops.ed.undo_push(message="Make Small")
    turn(f_stop=2.8, distance=0.3)
    yield from start()
    yield from until(in_a_pass)
    yield from press("Z", region(area("VIEW_3D")), across=0.3, ctrl=True)
    assert abs(bpy.context.scene.camera.data.dof.focus_distance - 0.34) < 1e-6 and rendering()
    yield from until(lambda: not rendering())
    yield 0.5
    shoot("rendered")
    blurred = pixels(lens_image_path())
    bpy.context.scene.lensfield.depth = "OFF"
    turn(f_stop=2.8, distance=0.3)
    yield DRAW_S
    sharp = yield from render()
    assert not alike(blurred, sharp)
    shoot("off")
    assert alike((yield from render_in_blender()), sharp)


def rings():
    """Turned rings are reported immediately.

    Their lens is baked while the user works on, undoes, saves and opens another file.
    """
    yield from open_sample()
    turn(f_stop=8, distance=0.9)
    yield DRAW_S
    assert lens_request().facts.f_number == 8
    shoot("turned")
    yield from until(lambda: lens_request().lens)
    yield DRAW_S
    shoot("baked")
    turn(f_stop=0.5, distance=0.05)
    yield from until(lambda: lens_request().facts)
    assert len(lens_request().facts.words) == 2
    yield DRAW_S
    shoot("words")
    yield from press("Z", region(area("VIEW_3D")), across=0.3, ctrl=True)
    yield from until(lambda: lens_request().lens)
    assert lens_request().facts.f_number == 8 and not lens_request().facts.words
    turn(f_stop=11, distance=1.3)
    yield from until(lambda: lens_request().fraction or lens_request().lens)
    yield from press("S", region(area("VIEW_3D")), across=0.3, ctrl=True)
    yield from until(lambda: not bpy.data.is_dirty)
    turn(f_stop=11, distance=1.4)
    yield from until(lambda: lens_request().fraction or lens_request().lens)
    before = lens_request()
    bpy.ops.wm.revert_mainfile()
    yield 1
    yield from until(lambda: lens_request().lens)
    assert abs(lens_request().facts.focus_mm - 1300) < 1 and lens_request() is not before


def animation():
    """Three frames have different pictures; after a cancellation, the render resumes where it stopped."""
    yield from open_sample(samples=32, percentage=50)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    for frame, z in ((1, 0.0), (3, 0.03)):
        bpy.data.objects["Vase"].location.z = z
        bpy.data.objects["Vase"].keyframe_insert("location", index=2, frame=frame)
    bpy.ops.ed.undo_push(message="Animate")
    bpy.ops.wm.save_mainfile()
    yield from start("render_animation")
    yield from until(lens_image_path().is_file)
    rendered_s = lens_image_path().stat().st_mtime
    shoot("amid")
    yield from press("ESC", area("PROPERTIES"))
    assert not rendering()
    yield from render("render_animation")
    shoot("rendered")
    assert lens_image_path().stat().st_mtime == rendered_s
    pictures = []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        pictures.append(pixels(lens_image_path()))
    assert not alike(pictures[0], pictures[1]) and not alike(pictures[1], pictures[2])


def escape():
    """Esc stops the render over the sidebar and the properties editor, and does nothing over the 3D view."""
    yield from start_endless()
    view = area("VIEW_3D")
    yield from press("ESC", region(view), across=0.3)
    yield 0.5
    assert rendering()
    for place in (region(view, "UI"), area("PROPERTIES")):
        if not rendering():
            yield from start()
            yield from until(in_a_pass)
        shoot("under-way")
        number, folder = child(), rendering().folder.name
        yield from press("ESC", place, up=0.9)
        start_s = time.monotonic()
        yield from until(lambda number=number: not alive(number))
        print(f"gone {time.monotonic() - start_s:.2f} s after Esc")
        assert not rendering() and notice().startswith("Cancelled")  # and names the cached data
        assert not os.path.exists(folder) and not list(Path(FOLDER, "lensfield").glob("[!.]*"))


def edit_undo_save():
    """In the main window, editing, undo and save work during a render as they do without one."""
    yield from start_endless()
    view, scene = area("VIEW_3D"), bpy.context.scene
    settings = scene.render.engine, scene.render.resolution_percentage, scene.camera.name, scene.render.filepath
    with over():
        bpy.ops.mesh.primitive_cube_add(size=0.05)
    bpy.context.object.name = "Edited"
    bpy.ops.ed.undo_push(message="Add Cube")
    yield from press("Z", region(view), across=0.3, ctrl=True)
    assert "Edited" not in bpy.data.objects and rendering()
    yield from press("Z", region(view), across=0.3, ctrl=True, shift=True)
    assert "Edited" in bpy.data.objects and rendering()
    yield from press("S", region(view), across=0.3, ctrl=True)
    yield from until(lambda: not bpy.data.is_dirty)
    assert rendering()
    shoot("saved")
    bpy.ops.wm.revert_mainfile()
    yield 1
    scene = bpy.context.scene
    assert settings == (scene.render.engine, scene.render.resolution_percentage, scene.camera.name,
                        scene.render.filepath)
    assert "Edited" in bpy.data.objects and rendering()


def other_windows():
    """Undo and save in a second window and in Blender's own render window, while both render."""
    yield from start_endless()
    bpy.context.scene.name = "Renamed"
    bpy.ops.ed.undo_push(message="Rename")
    with over():
        bpy.ops.wm.window_new()
    yield 1
    window = newest_window()
    place = max(window.screen.areas, key=lambda area: area.width * area.height)
    yield from press("Z", place, window, ctrl=True)
    assert bpy.context.scene.name == "Scene" and rendering()
    yield from press("S", place, window, ctrl=True)
    yield from until(lambda: not bpy.data.is_dirty)
    assert rendering()
    shoot("second")
    close_other_windows()
    window = yield from render_window()
    place = area("IMAGE_EDITOR", window)
    yield from press("S", place, window, ctrl=True)
    yield from press("Z", place, window, ctrl=True)  # ends Blender's own render
    assert rendering() and bpy.context.scene.render.engine == "CYCLES"
    shoot("render-window")
    close_other_windows()
    window = yield from render_window()
    yield from press("ESC", area("IMAGE_EDITOR", window), window)
    yield 1
    assert rendering()  # Esc applies to Blender's own render, though Blender ignores a simulated one


def compositor():
    """The node shows the lens image if valid, otherwise the plain render; removing the node restores everything."""
    yield from open_sample()
    blender_image = yield from render_in_blender()
    lens_image = yield from render()
    scene = bpy.context.scene
    assert alike((yield from render_in_blender()), lens_image)
    scene.frame_set(2)
    assert alike((yield from render_in_blender()), blender_image) and "frame 2 has no lens image" in node_label()
    scene.frame_set(1)
    assert alike((yield from render_in_blender()), lens_image)
    bpy.data.objects["Vase"].location.x += 0.01
    bpy.ops.ed.undo_push(message="Move")
    yield 1
    shoot("changed")
    changed = yield from render_in_blender()
    assert not alike(changed, lens_image) and not alike(changed, blender_image) and "has changed since" in node_label()
    yield from press("Z", region(area("VIEW_3D")), across=0.3, ctrl=True)
    yield 1
    assert alike((yield from render_in_blender()), lens_image)
    with over():
        assert bpy.ops.lensfield.remove_from_compositor() == {"FINISHED"}
    assert alike((yield from render_in_blender()), blender_image) and node_label() is None


def what_counts():
    """The node reacts at once to an undone or redone edit, a setting without Blender updates, and a deleted file."""
    yield from open_sample(samples=1, percentage=10)
    lens_image, view = (yield from render()), region(area("VIEW_3D"))
    bpy.data.objects["Vase"].location.x += 0.02
    bpy.ops.ed.undo_push(message="Move")
    yield from until(lambda: "has changed since" in node_label())
    yield from press("Z", view, across=0.3, ctrl=True)
    yield from until(lambda: node_label() == "Lensfield: lens image")
    yield from press("Z", view, across=0.3, ctrl=True, shift=True)
    yield from until(lambda: "has changed since" in node_label())
    assert not alike((yield from render_in_blender()), lens_image)
    yield from press("Z", view, across=0.3, ctrl=True)
    yield from until(lambda: node_label() == "Lensfield: lens image")
    bpy.context.scene.cycles.samples = 2
    yield from until(lambda: "has changed since" in node_label())
    bpy.context.scene.cycles.samples = 1
    yield from until(lambda: node_label() == "Lensfield: lens image")
    lens_image_path().unlink()
    yield from until(lambda: "is missing" in node_label())
    shoot("gone")
    assert not alike((yield from render_in_blender()), lens_image)


def stale():
    """F12 after an edit, before any check of the scene.

    It shows the plain render, and after the edit is undone, the lens image. The same applies to a script's render.
    """
    yield from open_sample(samples=1, percentage=10)
    lens_image, watch = (yield from render()), sys.modules[f"{MODULE}.addon.scene.compositor_watch"]
    assert alike((yield from render_in_blender()), lens_image)
    bpy.app.timers.unregister(watch.check)  # no timer runs in between
    scene, vase = bpy.context.scene, bpy.data.objects["Vase"]
    places = np.empty(3 * len(vase.data.vertices), np.float32)
    vase.data.vertices.foreach_get("co", places)
    for name, change, before, other in (
            ("object", lambda x: setattr(vase.location, "x", x), vase.location.x, vase.location.x + 0.02),
            ("samples", lambda samples: setattr(scene.cycles, "samples", samples), 1, 2),
            ("vertices", lambda places: vase.data.vertices.foreach_set("co", places), places, 1.05 * places)):
        change(other)
        assert not alike((yield from render_in_blender()), lens_image), name
        change(before)
        assert alike((yield from render_in_blender()), lens_image), name
    vase.location.x += 0.02
    bpy.ops.render.render()
    bpy.data.images["Render Result"].save_render(str(FOLDER / "script.exr"), scene=scene)
    assert "has changed since" in node_label()
    vase.location.x += 0.01
    yield from render_in_blender()
    bpy.app.timers.register(watch.check, persistent=True)
    yield from until(lambda: "has changed since" in node_label())
    shoot("stale")


def moved_folder():
    """After the folder is moved and its file opened there, the lens image still works; a missing one is reported."""
    yield from open_sample()
    blender_image = yield from render_in_blender()
    lens_image = yield from render()
    bpy.ops.wm.save_mainfile()
    moved = FOLDER / "moved"
    moved.mkdir()
    for name in ("evening_chess.blend", "lensfield"):
        FOLDER.joinpath(name).rename(moved / name)
    bpy.ops.wm.open_mainfile(filepath=str(moved / "evening_chess.blend"))
    yield 1
    assert alike((yield from render_in_blender()), lens_image)
    shutil.rmtree(moved / "lensfield")
    bpy.ops.wm.revert_mainfile()
    yield 1
    yield from show_tab()
    shoot("deleted")
    assert alike((yield from render_in_blender()), blender_image) and "is missing" in node_label()


def renamed_folder():
    """While the folder of the open file has another name, renders are refused; after Save As into it, the last one is
    found."""
    yield from open_sample(samples=1)
    project, renamed = FOLDER / "project", FOLDER / "renamed"
    project.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "shot.blend"))
    lens_image = yield from render()
    project.rename(renamed)
    with over():
        try:
            bpy.ops.lensfield.render("INVOKE_DEFAULT")
        except RuntimeError as error:
            assert "shot.blend: folder is missing: open the .blend where it is now, or use Save As" in str(error), error
    yield 1
    shoot("refused")
    assert not rendering() and not project.exists() and "is missing" in node_label()
    bpy.ops.wm.save_as_mainfile(filepath=str(renamed / "shot.blend"), check_existing=False)
    yield 1
    assert alike((yield from render("apply_lens")), lens_image) and node_label() == "Lensfield: lens image"
    shoot("saved-as")


def cameras():
    """Each camera has its own lens: in its properties with a menu of presets, and in the sidebar once it is active."""
    yield from open_sample(samples=1)
    scene, first = bpy.context.scene, bpy.context.scene.camera
    second = first.copy()
    second.data = first.data.copy()
    scene.collection.objects.link(second)
    second.data.lensfield.lens = "kodak-petzval-100mm"
    bpy.context.view_layer.objects.active = second
    yield 1
    area("PROPERTIES").spaces.active.context = "DATA"
    shown = drawn("draw_camera_settings")
    yield from until(lambda: shown == {"PROPERTIES"})
    yield DRAW_S
    shoot("inactive")
    with over("PROPERTIES"):
        bpy.ops.wm.call_panel(name="LENSFIELD_PT_camera_presets")
    yield 1
    shoot("presets")
    yield from press("ESC", area("PROPERTIES"))
    assert lens_request().question[0] == first.data.lensfield.lens
    scene.camera = second
    yield from until(lambda: lens_request().question[0] == "kodak-petzval-100mm" and lens_request().facts)
    yield DRAW_S
    shoot("active")
    bpy.ops.ed.undo_push(message="Second Camera")
    image = yield from render()
    scene = bpy.context.scene
    scene.camera = bpy.data.objects["Camera"]
    other = yield from render()
    assert not alike(image, other)


def two_scenes():
    """Each scene of a file has its own lens, picture and compositor, whichever scene the window shows meanwhile."""
    yield from open_sample(samples=1)
    window, first = main_window(), bpy.context.scene
    with over():
        assert bpy.ops.scene.new(type="LINK_COPY") == {"FINISHED"}
    second = window.scene
    second.name, second.camera = "Second", first.camera.copy()
    second.camera.data = first.camera.data.copy()
    second.collection.objects.link(second.camera)
    choose_petzval()
    assert first.camera.data.lensfield.lens != second.camera.data.lensfield.lens
    bpy.ops.ed.undo_push(message="Second Scene")
    yield from start()
    window.scene = first
    yield from until(lambda: not rendering())
    yield 1
    shoot("first")
    assert node_label() is None, notice()
    images = {"Scene": (yield from render())}
    window.scene = second
    yield 1
    shoot("second")
    images["Second"] = pixels(lens_image_path())
    assert not alike(*images.values())
    for name, image in images.items():
        window.scene = bpy.data.scenes[name]
        yield 1
        assert node_label() == "Lensfield: lens image"
        assert alike((yield from render_in_blender()), image)
    yield from start("preview")
    yield from until(preview_is_fresh)
    shown = pixels(preview_under_way().picture)
    window.scene = first
    yield 1
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("preview")
    assert not alike(pixels(preview_under_way().picture), shown)


def linked_camera():
    """A camera from a library renders. What it lacks is refused until it has an override."""
    yield from open_sample(samples=1)
    scene, library = bpy.context.scene, FOLDER / "cameras.blend"
    scene.camera.data.type, name = "ORTHO", scene.camera.name
    bpy.data.libraries.write(str(library), {scene.camera})
    bpy.data.objects.remove(scene.camera)
    with bpy.data.libraries.load(str(library), link=True, relative=True) as (_, to):
        to.objects = [name]
    scene.camera = to.objects[0]
    scene.collection.objects.link(scene.camera)
    bpy.ops.wm.save_mainfile()
    yield 1
    with over():
        try:
            bpy.ops.lensfield.fix("INVOKE_DEFAULT", obstacle="type")
        except RuntimeError as error:
            assert "is linked from //cameras.blend" in str(error), error
    yield DRAW_S
    shoot("refused")
    assert scene.camera.data.type == "ORTHO"
    scene.camera.override_create(remap_local_usages=True).data.override_create(remap_local_usages=True)
    with over():
        assert bpy.ops.lensfield.fix("INVOKE_DEFAULT", obstacle="type") == {"FINISHED"}
    yield 1
    shoot("overridden")
    near = yield from render()
    scene.camera.data.dof.use_dof, scene.camera.data.dof.aperture_fstop = True, 22
    bpy.ops.ed.undo_push(message="Stop Down")
    yield 1
    assert not alike((yield from render()), near)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.revert_mainfile()
    yield 1
    camera = bpy.context.scene.camera.data
    assert camera.override_library and camera.type == "PERSP" and camera.dof.aperture_fstop == 22
    assert node_label() == "Lensfield: lens image"


def appended_scene():
    """A scene appended to another file renders into that file's folder, and its old lens image is not shown there."""
    yield from open_sample(samples=1)
    choose_petzval()
    bpy.ops.wm.save_mainfile()
    before = yield from render()
    bpy.ops.wm.save_mainfile()
    source = bpy.data.filepath
    bpy.ops.wm.read_homefile(app_template="")
    yield 1
    (FOLDER / "elsewhere").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "elsewhere" / "other.blend"), check_existing=False)
    with over():
        bpy.ops.wm.append(filepath="appended", directory=f"{source}/Scene/", filename="Scene")
    main_window().scene = next(scene for scene in bpy.data.scenes if "Vase" in scene.objects)
    yield from show_tab()
    yield 1
    shoot("appended")
    scene = bpy.context.scene
    assert scene.camera.data.lensfield.lens == "kodak-petzval-100mm"
    after = yield from render()
    assert lens_image_path().is_relative_to(FOLDER / "elsewhere") and alike(before, after)
    assert node_label() == "Lensfield: lens image"
    shoot("rendered")
    assert alike((yield from render_in_blender()), after)


def other_file():
    """Another file opened during a render stays as it is; the picture is in the first file's folder."""
    yield from open_sample(samples=64, percentage=50)
    path, image = bpy.data.filepath, lens_image_path()
    yield from start()
    yield from until(in_a_pass)
    bpy.ops.wm.read_homefile(app_template="")
    yield 1
    yield from show_tab()
    yield 1
    shoot("under-way")
    assert rendering()
    yield from until(lambda: not rendering())
    yield 1
    shoot("finished")
    assert image.is_file() and "no longer open" in notice(), notice()
    assert node_label() is None and not bpy.data.is_dirty and len(bpy.context.window_manager.windows) == 1
    assert not [image for image in bpy.data.images if "lens_image" in image.filepath]
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1
    yield from show_tab()
    yield 1
    yield from render()
    assert node_label() == "Lensfield: lens image"


def stranger():
    """An untrusted file names a lens elsewhere: all panels show its path.

    Trusted in one panel, the lens works in all of them, and renders.
    """
    yield from open_sample()
    shutil.copy(Path(sys.modules[MODULE].__file__).parent / "engine" / "library" / "edmund-54852.npz", FOLDER / "l.npz")
    adjust(lens="FILE", lens_file=str(FOLDER / "l.npz"))
    bpy.ops.wm.save_mainfile()
    trust().forget_trust()
    prompted, shown = drawn("draw_named_files"), drawn("_draw_lens")
    bpy.ops.wm.revert_mainfile()
    yield from until(lambda: prompted == {"PROPERTIES", "VIEW_3D"})
    yield DRAW_S
    shoot("asked")
    assert not shown
    with over():
        assert bpy.ops.lensfield.trust("INVOKE_DEFAULT") == {"FINISHED"}
    yield from until(lambda: shown == {"PROPERTIES", "VIEW_3D"})
    yield from until(lambda: lens_request().lens)
    yield DRAW_S
    shoot("trusted")
    assert (yield from render()).mean() > 1e-3


def quit():
    """Quitting Blender during a render ends the render."""
    yield from start_endless()
    return [child(), rendering().folder.name]


def killed():
    """If Blender is killed during a render, the render ends by itself."""
    yield from start_endless()
    (FOLDER.parent / "left").write_text(rendering().folder.name)
    report(status=-signal.SIGKILL, gone=[child()])
    os.kill(os.getpid(), signal.SIGKILL)


def after_a_kill():
    """The next Blender removes the files that the killed one left."""
    assert not os.path.exists((FOLDER.parent / "left").read_text())
    yield 0


def click_lens():
    """With the mouse: a lens by its picture, by its name, as a favourite, and its rings."""
    yield from open_sample()
    view = area("VIEW_3D")
    panel, camera, chosen = region(view, "UI"), bpy.context.scene.camera.data, []
    for across, up in ((0.25, 0.37), (0.6, 0.58), (0.9, 0.15)):
        name = yield from find("lensfield.search_lens", panel)
        yield from press("LEFTMOUSE", panel, up=name + PICTURE_PX / panel.height)
        yield 1  # for the pictures
        shoot(f"picker-{len(chosen)}")
        yield from press("LEFTMOUSE", main_window(), across=across, up=up)
        chosen.append(camera.lensfield.lens)
        yield from until(lambda: lens_request().facts)
        shoot(f"picked-{len(chosen)}")
    assert len({*chosen}) == 3 and "" not in chosen, chosen
    yield from click("lensfield.search_lens", panel)
    yield from write("petzval")
    yield 1
    shoot("search")
    yield from press("RET", panel)
    assert camera.lensfield.lens == "kodak-petzval-100mm", camera.lensfield.lens
    favourite_lenses = live_figures.module("addon.ui.common.favourite_lenses").favourite_lenses
    for favourites in ({"kodak-petzval-100mm"}, set()):
        yield from click("lensfield.favourite", panel, across=STAR)
        assert favourite_lenses() == favourites
        shoot(f"star-{bool(favourites)}")
    dof = camera.dof
    yield from click("dof.use_dof", panel)
    assert dof.use_dof
    before = dof.focus_distance
    yield from drag("dof.focus_distance", panel, 0.7, 0.8)
    assert dof.focus_distance != before
    yield from click("dof.aperture_fstop", panel, 0.7, "RET")  # edits the number under the mouse
    yield from press("A", panel, ctrl=True)
    yield from write("4.5")
    yield from press("RET", panel)
    assert abs(dof.aperture_fstop - 4.5) < 1e-6
    yield from until(lambda: lens_request().facts and lens_request().facts.f_number == 4.5)
    shoot("rings")


def click_pictures():
    """With the mouse: the preview, the live view, a render, another lens applied to it, and both opened."""
    yield from open_sample()
    view = area("VIEW_3D")
    panel = region(view, "UI")
    yield from click("lensfield.preview", panel, across=0.25)
    yield from until(preview_is_fresh)
    yield from until(lambda: not preview_under_way().at_work)  # its finest picture
    yield 1
    shoot("preview")
    assert np.allclose(frame_as_drawn(view), pixels(preview_under_way().picture)[..., :3].mean((0, 1)), atol=0.03)
    yield from click("lensfield.preview", panel, across=0.15)
    assert not preview_under_way()
    yield from click("lensfield.live", panel, across=0.7)
    yield from until(lambda: session().live.shown)
    yield DRAW_S
    shoot("live")
    yield from click("lensfield.live", panel, across=0.7)
    assert not session().live
    yield from click("lensfield.render", panel)
    shoot("under-way")
    yield from until(lambda: not rendering())
    yield 1
    shoot("rendered")
    close_other_windows()
    first = pixels(lens_image_path())
    settings = bpy.context.scene.camera.data.lensfield
    settings.view, settings.lens = "CAMERA", "tessar-50mm"
    yield DRAW_S
    yield from click("lensfield.apply_lens", panel)
    yield from until(lambda: not rendering())
    yield 1
    shoot("applied")
    close_other_windows()
    assert not alike(pixels(lens_image_path()), first)


def click_camera():
    """With the mouse: the section of the camera, a camera from its list, and its exposure."""
    yield from open_sample()
    panel, settings = region(area("VIEW_3D"), "UI"), bpy.context.scene.camera.data.lensfield
    yield from open_section("body", panel)
    yield from click("lensfield.body", panel, across=0.7)
    yield 0.5
    shoot("list")
    yield from press("DOWN_ARROW", panel)
    yield from press("RET", panel)
    assert settings.body not in ("", "NONE"), settings.body
    yield DRAW_S
    shoot("section")


def click_own_lens():
    """With the mouse: the dialog of a lens file."""
    yield from open_sample()
    path = FOLDER / "own_lens.lens"
    path.write_text(DOT_LENS)
    yield from point(area("VIEW_3D"), 0.3, 0.6)
    with over():
        bpy.ops.lensfield.open_lens("INVOKE_DEFAULT", filepath=str(path))
    yield 2  # for the drawing
    yield from confirm()
    settings = bpy.context.scene.camera.data.lensfield
    assert (settings.lens, settings.lens_file) == ("FILE", "//lenses/own_lens.toml")
    yield from until(lambda: lens_request().facts)
    shoot("used")


def preview_fills_frame():
    """The first preview is as fine as the camera's frame in the viewport, and finer after zooming in; a camera that a
    lens cannot replace hides it. A fisheye camera that matches its lens is not reported."""
    yield from open_sample(samples=1, percentage=100)
    view, scene = area("VIEW_3D"), bpy.context.scene
    view.spaces.active.region_3d.view_perspective = "PERSP"
    yield DRAW_S
    yield from click("lensfield.preview", region(view, "UI"), across=0.25)
    yield from until(lambda: preview_columns_px() >= 0.98 * frame_width_px(view))
    yield DRAW_S
    shoot("first")
    first = preview_columns_px()
    yield from press("WHEELUPMOUSE", region(view), across=0.3)
    yield DRAW_S
    assert frame_width_px(view) > first
    yield from until(lambda: preview_columns_px() >= 0.98 * frame_width_px(view))
    yield DRAW_S
    shoot("zoomed")
    for kind in ("ORTHO", "PANO"):
        scene.camera.data.type = kind
        yield DRAW_S
        shoot(kind.lower())
        assert not preview_under_way().up_to_date
    scene.camera.data.type = "PERSP"
    yield from until(lambda: preview_is_fresh() and preview_under_way().up_to_date)
    scene.camera.data.lensfield.lens = "olympus-fisheye-8mm"
    yield from until(lambda: lens_request().lens)
    with over():
        assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    yield DRAW_S
    assert scene.camera.data.type == "PANO"
    shoot("fisheye")
    yield from start("preview")


def click_compare():
    """With the mouse: the dialog that compares lenses, a second lens in it, and a picture of the contact sheet."""
    yield from open_sample(samples=1)
    bpy.context.preferences.view.render_display_type = "SCREEN"
    scene = bpy.context.scene
    last = bpy.context.window_manager.operator_properties_last("lensfield.compare")
    last.side_px, last.samples = 160, 4
    yield from click("lensfield.compare", region(area("VIEW_3D"), "UI"))
    yield 1
    shoot("offered")
    across, up = SECOND_LENS
    yield from press("LEFTMOUSE", main_window(), across=across, up=up)
    yield from confirm()
    yield from until(lambda: not rendering())
    yield 1
    shoot("sheet")
    lenses = session().last_sheet.lenses
    assert len(lenses) == 2, lenses
    other = next(each for each in lenses if each.lens != scene.camera.data.lensfield.lens)
    place = region(area("IMAGE_EDITOR"))
    across, up = place_on_sheet(other, place)
    yield from press("LEFTMOUSE", place, across=across, up=up)
    yield 0.5
    shoot("chosen")
    assert scene.camera.data.lensfield.lens == other.lens


def click_focus():
    """With the mouse: the button that focuses, and a click on a chess piece, in the camera's view and on the preview's
    picture, which the lens distorts; Esc changes nothing."""
    yield from open_sample(samples=1, lens="nikkor-28mm", view="CAMERA")
    view, dof = area("VIEW_3D"), bpy.context.scene.camera.data.dof
    panel = region(view, "UI")
    yield from click("lensfield.click_focus", panel)
    yield from point(region(view), *PIECE)
    shoot("asked")
    yield from press("ESC", region(view), across=PIECE[0], up=PIECE[1])
    assert not dof.use_dof
    for name, (across, up) in (("near", PIECE), ("far", TOWN)):
        yield from click("lensfield.click_focus", panel)
        yield from press("LEFTMOUSE", region(view), across=across, up=up)
        assert dof.use_dof
        assert abs(dof.focus_distance / seen_distance(view, across, up) - 1) < 0.01, (name, dof.focus_distance)
        yield from until(lambda: lens_request().facts)
        yield DRAW_S
        shoot(name)
    yield from start("preview")
    yield from until(preview_is_fresh)
    yield DRAW_S
    yield from click("lensfield.click_focus", panel)
    yield from press("LEFTMOUSE", region(view), across=PIECE[0], up=PIECE[1])
    assert abs(dof.focus_distance / seen_distance(view, *PIECE) - 1) < 0.1, dof.focus_distance
    yield from until(preview_is_fresh)
    yield DRAW_S
    shoot("preview")
    yield from press("Z", region(view), across=0.3, ctrl=True)
    yield from start("preview")


def click_tilt():
    """With the mouse: tilt and a copy of the lens in their section, each rendered."""
    yield from open_sample(lens="tessar-50mm", view="CAMERA")
    bpy.context.preferences.view.render_display_type = "NONE"
    panel, settings = region(area("VIEW_3D"), "UI"), bpy.context.scene.camera.data.lensfield
    yield from until(lambda: lens_request().lens)
    pictures = [(yield from render())]
    yield from open_section("view", panel)
    for name, text in (("tilt_deg", "3"), ("copy", "7")):
        yield from scroll_to(f"lensfield.{name}", panel)
        yield from type_number(f"lensfield.{name}", panel, text)
        shoot(name)
        yield from scroll_up(panel)
        yield from click("lensfield.render", panel)
        yield from until(lambda: not rendering())
        yield DRAW_S
        assert session().last_render.icon == "INFO", notice()
        shoot(f"{name}-rendered")
        pictures.append(pixels(lens_image_path()))
    assert abs(math.degrees(settings.tilt_deg[0]) - 3) < 1e-4 and settings.copy == 7
    assert not alike(pictures[0], pictures[1]) and not alike(pictures[1], pictures[2])


def click_names():
    """With the mouse: a render; its scene gets a new name, the file is saved under a new one in Blender's dialog, and
    the lens is applied after each. No log of Blender's shows the copies that Lensfield saves."""
    yield from open_sample(samples=1)
    bpy.context.preferences.view.render_display_type = "NONE"
    panel = region(area("VIEW_3D"), "UI")
    yield from click("lensfield.render", panel)
    yield DRAW_S
    shoot("under-way")
    yield from until(lambda: not rendering())
    first = pixels(lens_image_path())
    bpy.context.scene.name = "Evening"
    bpy.ops.ed.undo_push(message="Rename Scene")
    yield from click_apply(panel)
    assert alike(pixels(lens_image_path()), first) and node_label() == "Lensfield: lens image"
    shoot("renamed")
    yield from press("S", region(area("VIEW_3D")), across=0.3, ctrl=True, shift=True)
    yield from until(lambda: area("FILE_BROWSER", newest_window()))
    yield 1
    shoot("dialog")
    with over("FILE_BROWSER", newest_window()):
        bpy.context.space_data.params.filename = "evening.blend"
        bpy.ops.file.execute("INVOKE_DEFAULT")
    yield from until(lambda: bpy.data.filepath.endswith("evening.blend"))
    yield from show_tab()
    yield from click_apply(panel)
    assert alike(pixels(lens_image_path()), first) and node_label() == "Lensfield: lens image"
    assert "evening" in lens_image_path().name
    shoot("saved-as")
    assert "Saved copy" not in (yield from blenders_log())


def install_from_disk():
    """Installed by mouse from a zip; screenshots for the guide. One of the last steps, because Lensfield is installed
    anew."""
    view = bpy.context.preferences.view
    view.ui_scale, view.filebrowser_display_type = INSTALL_SCALE, "SCREEN"
    uninstall()
    zips = FOLDER / "zips"
    zips.mkdir()
    shutil.copy(PACKAGE, zips / ZIP_NAME)
    place = yield from show_preferences("ADDONS", share=INSTALL_SHARE)
    main = region(place)
    shoot("version", Box(main_window().width - 400, 0, 400, 80))
    yield from press_at(main, *SETTINGS_ARROW)
    shoot("menu", top_right(main, 640, 160))
    yield from press("I", main)
    yield from until(lambda: any(each.type == "FILE_BROWSER" for each in main_window().screen.areas))
    browser = area("FILE_BROWSER")
    with over("FILE_BROWSER"):
        browser.spaces.active.params.directory = os.fsencode(zips)
    yield 1
    files = region(browser)
    yield from press("LEFTMOUSE", files, across=0.1, up=1 - 55 / files.height)
    shoot("zip", Box(files.x, files.y + files.height - 110, 640, 110))
    assert browser.spaces.active.params.filename == ZIP_NAME
    with over("FILE_BROWSER"):
        bpy.ops.file.execute("INVOKE_DEFAULT")
    yield from until(lambda: MODULE in bpy.context.preferences.addons)
    bpy.context.window_manager.addon_search = "lensfield"
    yield 1
    shoot("ticked", top_right(region(area("PREFERENCES")), main.width, 120))


def install_from_repository():
    """Installed by mouse from a remote repository on this machine, where an update then appears; screenshots for the
    guide. The last step, because Lensfield is then from another repository."""
    preferences = bpy.context.preferences
    preferences.view.ui_scale = INSTALL_SCALE
    official = preferences.extensions.repos["extensions.blender.org"]
    preferences.system.use_online_access, preferences.extensions.use_online_access_handled = False, False
    official.enabled = True
    uninstall()
    zips = FOLDER / "zips"
    zips.mkdir()
    shutil.copy(PACKAGE, zips / ZIP_NAME)
    subprocess.run([bpy.app.binary_path, "--command", "extension", "server-generate", f"--repo-dir={zips}"], check=True)
    place = yield from show_preferences("EXTENSIONS", share=INSTALL_SHARE)
    main = region(place)
    yield 1
    shoot("online", top_right(main, main.width, 270))
    yield from click("extensions.userpref_allow_online", main, across=0.75)
    official.enabled = False  # no request leaves this machine
    yield 1
    yield from press_at(main, *REPOSITORIES)
    yield from press_at(main, *PLUS)
    shoot("add", top_right(main, 640, 330))
    bpy.context.window_manager.clipboard = "https://example.org/lensfield/index.json"
    yield from press_at(main, *ADD_REMOTE)
    yield from press("V", main, ctrl=True)
    yield from press("RET", main)
    yield from press_at(main, *CHECK_FOR_UPDATES)
    yield from point(main, across=1 - 300 / main.width, up=1 - 75 / main.height)  # without a tooltip
    shoot("url", top_right(main, 600, 410))
    for _ in "dialog", "list of repositories":
        yield from press("ESC", main)
    with served(zips) as address, over("PREFERENCES"):
        assert bpy.ops.preferences.extension_repo_add(name="Lensfield", remote_url=f"{address}/index.json",
                                                      type="REMOTE") == {"FINISHED"}
        bpy.ops.extensions.repo_sync_all()
        yield 3
        shoot("list", top_right(main, main.width, 160))
        yield from click("extensions.package_install", main, across=0.9)
        yield from until(lambda: "bl_ext.Lensfield.lensfield" in bpy.context.preferences.addons)
        index = json.loads((zips / "index.json").read_text(encoding="utf-8"))
        index["data"][0]["version"] = "0.2.0"
        (zips / "index.json").write_text(json.dumps(index), encoding="utf-8")
        bpy.ops.extensions.repo_sync_all()
        yield 3
        shoot("update", top_right(main, main.width, 160))
