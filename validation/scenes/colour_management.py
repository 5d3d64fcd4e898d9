"""Colour management: view transforms, which change no light, and working spaces."""

import bpy

from .kit import ordinary


@ordinary()
def agx(stage):
    """AgX with a look, exposure and gamma"""
    view = stage.scene.view_settings
    view.view_transform = "AgX"
    view.look, view.exposure, view.gamma = "AgX - Punchy", 1.5, 1.2


@ordinary()
def filmic(stage):
    """Filmic, with curves"""
    view = stage.scene.view_settings
    view.view_transform, view.use_curve_mapping = "Filmic", True


@ordinary()
def false_colour(stage):
    """False Color, with white balance"""
    view = stage.scene.view_settings
    view.view_transform = "False Color"
    if hasattr(view, "use_white_balance"):
        view.use_white_balance, view.white_balance_temperature = True, 4000


@ordinary()
def display_of_another_kind(stage):
    """A wide display, and dithering"""
    stage.scene.display_settings.display_device = "Display P3"
    stage.scene.render.dither_intensity = 2.0


@ordinary()
def acescg(stage):
    """ACEScg as the working space, with colours within Rec. 709"""
    _work_in(stage, "ACEScg")


@ordinary()
def rec2020(stage):
    """Rec. 2020 as the working space"""
    _work_in(stage, "Linear Rec.2020")


def _work_in(stage, name):
    if hasattr(bpy.data, "colorspace"):  # added in 5.0
        bpy.ops.wm.set_working_color_space(working_space=name)
    stage.scene.view_settings.view_transform = "Standard"
