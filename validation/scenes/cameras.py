"""Cameras: sensors, shifts, clipping, constraints, markers, borders, and those that Lensfield refuses."""

from math import radians

import bpy

from .kit import keyed, look_at, ordinary


@ordinary()
def camera_shift(stage):
    """Shift X and Shift Y"""
    stage.camera.data.shift_x, stage.camera.data.shift_y = 0.12, -0.07


@ordinary()
def portrait(stage):
    """An upright picture"""
    render = stage.scene.render
    render.resolution_x, render.resolution_y = render.resolution_y, render.resolution_x
    stage.camera.data.lens = 36


@ordinary()
def sensor_fit_vertical(stage):
    """Sensor Fit: Vertical, with a Super 35 sensor"""
    camera = stage.camera.data
    camera.sensor_fit, camera.sensor_width, camera.sensor_height, camera.lens = "VERTICAL", 24.9, 18.7, 32


@ordinary()
def sensor_fit_horizontal_portrait(stage):
    """Sensor Fit: Horizontal, in an upright picture"""
    render = stage.scene.render
    render.resolution_x, render.resolution_y = render.resolution_y, render.resolution_x
    stage.camera.data.sensor_fit, stage.camera.data.lens = "HORIZONTAL", 30


@ordinary()
def field_of_view_unit(stage):
    """A camera by its field of view, in degrees"""
    stage.camera.data.lens_unit, stage.camera.data.angle = "FOV", radians(52)


@ordinary()
def clipping(stage):
    """Clip Start and Clip End within the scene"""
    stage.camera.data.clip_start, stage.camera.data.clip_end = 1.15, 1.62


@ordinary()
def tracking_camera(stage):
    """A camera with Track To, Limit Distance and a parent"""
    track = stage.camera.constraints.new("TRACK_TO")
    track.target, track.track_axis, track.up_axis = stage.ball, "TRACK_NEGATIVE_Z", "UP_Y"
    limit = stage.camera.constraints.new("LIMIT_DISTANCE")
    limit.target, limit.distance = stage.cube, 1.1
    rig = stage.link("Rig", None, (0.1, 0, 0))
    rig.rotation_euler.z = radians(-8)
    stage.camera.parent = rig


@ordinary()
def scaled_camera(stage):
    """A camera whose parent is scaled and turned"""
    rig = stage.link("Rig", None)
    rig.scale, rig.rotation_euler.y = (0.8, 0.8, 0.8), radians(5)
    stage.camera.parent = rig


@ordinary()
def rolled_camera(stage):
    """A camera rolled by thirty degrees"""
    stage.camera.rotation_euler.rotate_axis("Z", radians(30))


@ordinary()
def moving_camera(stage):
    """A camera that moves during the exposure, with motion blur"""
    keyed(stage.camera, "location", {1: 0.07, 3: 0.19}, 0)
    stage.scene.render.use_motion_blur = True
    stage.scene.frame_set(2)


@ordinary(differs="Motion Blur")
def zooming_camera(stage):
    """A zoom during the exposure, with motion blur"""
    keyed(stage.camera.data, "lens", {1: 38, 3: 50})
    stage.scene.render.use_motion_blur = True
    stage.scene.render.motion_blur_shutter = 1.0
    stage.scene.frame_set(2)


@ordinary()
def marker_camera(stage):
    """A camera that a marker binds to the frame"""
    second = stage.link("Second", bpy.data.cameras.new("Second"), (-0.5, -1.1, 0.5))
    look_at(second, (0, 0, 0.12))
    second.data.lens, second.data.dof.focus_distance = 38, 1.25
    for frame, camera in ((1, stage.camera), (10, second)):
        stage.scene.timeline_markers.new(camera.name, frame=frame).camera = camera
    stage.scene.frame_set(12)


@ordinary()
def subframe(stage):
    """A scene at frame 3.5"""
    keyed(stage.cube, "location", {1: -0.1, 6: 0.4}, 0)
    stage.scene.frame_set(3, subframe=0.5)


@ordinary()
def render_region(stage):
    """A render region"""
    render = stage.scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.25, 0.875


@ordinary(remark="Crop to Render Region")
def cropped_region(stage):
    """A render region with Crop, which keeps its size"""
    render_region(stage)
    stage.scene.render.use_crop_to_border = True


@ordinary()
def percentage(stage):
    """A resolution of 50 %"""
    render = stage.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = (
        2 * render.resolution_x, 2 * render.resolution_y, 50)


@ordinary()
def focus_object(stage):
    """A camera focused on an object, with its depth of field on"""
    dof = stage.camera.data.dof
    dof.use_dof, dof.focus_object = True, stage.cube


@ordinary()
def background_image(stage):
    """A reference picture behind the camera's view, which is not rendered"""
    stage.camera.data.show_background_images = True
    stage.camera.data.background_images.new().image = bpy.data.images.new("Reference", 8, 8)


@ordinary(remark="Stereoscopy")
def stereoscopy(stage):
    """Stereoscopy, which is ignored"""
    stage.scene.render.use_multiview = True


@ordinary(refused="camera")
def orthographic(stage):
    """An orthographic camera"""
    stage.camera.data.type, stage.camera.data.ortho_scale = "ORTHO", 1.2


@ordinary(refused="camera")
def panoramic(stage):
    """An equirectangular camera"""
    stage.camera.data.type, stage.camera.data.panorama_type = "PANO", "EQUIRECTANGULAR"


@ordinary(refused="pixel aspect")
def squeezed_pixels(stage):
    """Pixels that are not square"""
    stage.scene.render.pixel_aspect_x = 2


@ordinary(refused="camera")
def no_camera(stage):
    """A scene without a camera"""
    stage.remove(stage.camera)
