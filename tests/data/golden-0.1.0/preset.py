import bpy

camera = getattr(bpy.context, "camera", None) or bpy.context.scene.camera.data
settings = camera.lensfield

settings.lens = 'nikkor-28mm'
settings.view = 'SENSOR'
settings.sensor_mm = (36.125, 24.125)
settings.copy = 1
settings.copy_grade = 'DROPPED'
settings.coating = 'IDEAL'
settings.focused_wide_open = True
settings.iris_roundness = 0.125
settings.body = 'nikon-d850'
camera.dof.aperture_blades = 0
