"""Small valid files of every kind that `read_measured` reads."""

import json
from dataclasses import replace

import numpy as np

from lensfield.engine.calibration.fit import Calibration
from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.calibration.models import DOUBLE_SPHERE, KANNALA_BRANDT, RADTAN, RATIONAL
from lensfield.engine.calibration.views import View
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.measured.files import KINDS
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.pictures.spectral_exr import write_rgb_exr

COLUMNS, ROWS, FOCAL_PX = 48, 31, 40.0
OPTIONS = MeasuredOptions(focal_mm=30.0, sensor_mm=(36.0, 24.0))
PLACES_PX = np.array([[23.5, 15.0], [0.0, 0.0], [47.5, 30.5], [10.0, 25.0]])
LENSFUN = """<?xml version="1.0"?>
<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">
<lensdatabase version="1">
  <camera><maker>Optik</maker><model>Body</model><mount>Generic</mount><cropfactor>1.5</cropfactor></camera>
  <lens>
    <maker>Optik</maker><model>Zoom 20-40mm</model><model lang="en">Zoom</model><mount>Generic</mount>
    <cropfactor>1.5</cropfactor><aspect-ratio>4:3</aspect-ratio><type>stereographic</type>
    <calibration>
      <distortion model="ptlens" focal="20" a="0.01" b="-0.03" c="0.02"/>
      <distortion model="ptlens" focal="40" a="0" b="-0.01" c="0"/>
      <tca model="poly3" focal="20" br="0.0001" vr="1.0002" bb="-0.0001" vb="0.9998"/>
      <vignetting model="pa" focal="20" aperture="8" distance="1000" k1="-0.5" k2="0.1" k3="0"/>
      <vignetting model="pa" focal="40" aperture="8" distance="10" k1="-0.3" k2="0" k3="0"/>
    </calibration>
  </lens>
</lensdatabase>
"""
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<calibration_Time>"today"</calibration_Time>
<image_Width>48</image_Width>
<image_Height>31</image_Height>
<Camera_Matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>40. 0. 22. 0. 40. 16. 0. 0. 1.</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
<data>-0.2 0.05 1e-3 -2e-3 0.01</data></Distortion_Coefficients>
</opencv_storage>
"""


def options_for(kind):
    """OPTIONS, without those that a kind of file does not take."""
    return OPTIONS if "focal_mm" in KINDS[kind].takes else replace(OPTIONS, focal_mm=None)


def calibration_of(model, coefficients):
    return Calibration(model, PixelGrid((ROWS, COLUMNS), 10.0), (40.0, 41.0), (22.0, 16.0), coefficients, 0.0, 0.0, 1.0,
                       "a lens", np.inf, 2.8, 550.0, 40.0, (0.6, 0.4, 0.6, 0.4), 2.8, 0.0)


def measured_files(folder):
    """{kind: (name, bytes)}; EXRs are written to a folder first."""
    radtan, fisheye, rational, sphere = (View(calibration_of(*each)) for each in (
        (RADTAN, (-0.2, 0.05, 1e-3, -2e-3)), (KANNALA_BRANDT, (0.03, -0.01, 0.004, -0.001)),
        (RATIONAL, (0.2, 0.06, 0.003, 0.002, 0.01, 0.4, 0.1, 0.02)), (DOUBLE_SPHERE, (-0.1, 0.57))))
    texts = {
        "opencv": ("c.yml", FORMATS["opencv"].text([rational])), "opencv-fisheye": ("c.yml", FORMATS["opencv"].text(
            [fisheye])), "colmap": ("cameras.txt", FORMATS["colmap"].text([radtan])),
        "nerfstudio": ("transforms.json", FORMATS["nerfstudio"].text([radtan])),
        "kalibr": ("camchain.yaml", FORMATS["kalibr"].text([sphere])),
        "ros": ("camera_info.yaml", FORMATS["ros"].text([fisheye])),
        "gyroflow": ("profile.json", FORMATS["gyroflow"].text([fisheye])),
        "lensfun": ("lens.xml", LENSFUN)}
    files = {kind: (name, text.encode()) for kind, (name, text) in texts.items()}
    for kind in ("stmap-distort", "stmap-undistort"):
        path = folder / f"{kind}.exr"
        write_rgb_exr(foreign_map(-0.1 if kind == "stmap-distort" else 0.1), path)
        files[kind] = path.name, path.read_bytes()
    return files


def foreign_map(strength, columns=COLUMNS, rows=ROWS, overscan=1.0):
    """An STMap with the places x (1 + strength (x^2 + y^2)), in half widths from the middle, by plain loops."""
    places, (width, height) = np.zeros((rows, columns, 3)), (round(side * overscan) for side in (columns, rows))
    for row in range(rows):
        for column in range(columns):
            x, y = (column + 0.5 - columns / 2) / (columns / 2), (rows / 2 - row - 0.5) / (columns / 2)
            scale = 1 + strength * (x * x + y * y)
            places[row, column] = 0.5 + scale * x * columns / 2 / width, 0.5 + scale * y * columns / 2 / height, 0
    return places


def as_json(text, **changes):
    """The text of JSON with other fields; None removes one."""
    fields = json.loads(text) | changes
    return json.dumps({name: value for name, value in fields.items() if value is not None})
