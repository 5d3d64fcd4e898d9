"""The Cornell box by Mitsuba 3.

    python validation/cornell_mitsuba.py tests/data/cornell_mitsuba.npz

writes the reference figures for tests/addon/job/test_cornell_box.py (half a minute on two cores).
"""

import sys

import mitsuba
import numpy as np

import cornell_box as box

TEST_WAVELENGTHS_NM = (420.0, 480.0, 520.0, 580.0, 620.0, 680.0)
TEST_SIDE_PX, TEST_SAMPLES, TEST_BLOCKS = 32, 4096, 4

mitsuba.set_variant("scalar_rgb")  # works without LLVM, and treats its three channels as numbers, not colours


def render(wavelengths_nm, side_px, samples, seed):
    """Spectral radiance of the box, three wavelengths at a time as red, green and blue of raw values.

    Returns
    -------
    float32 array (wavelength, row, column), W m^-2 sr^-1 nm^-1
    """
    bands = np.array_split(wavelengths_nm, -(-len(wavelengths_nm) // 3))
    planes = []
    for index, band in enumerate(bands):
        scene = mitsuba.load_dict(_scene(np.resize(band, 3), side_px, samples))
        picture = np.array(mitsuba.render(scene, seed=seed * len(bands) + index))
        planes.extend(np.moveaxis(picture, -1, 0)[:len(band)])
    return np.stack(planes)


def _scene(band, side_px, samples):
    shapes = {name: _shape(name, triangles, band) for name, triangles in box.triangles_mm().items()}
    every_path = {"type": "path", "max_depth": -1}
    return {"type": "scene", "integrator": every_path, "camera": _camera(side_px, samples), **shapes}


def _camera(side_px, samples):
    x, y, z = box.CAMERA_MM
    look = mitsuba.ScalarTransform4f().look_at(origin=[x, y, z], target=[x, y, z + 1], up=[0, 1, 0])
    return {"type": "perspective", "to_world": look,
            "fov": float(2 * np.degrees(np.arctan(box.SENSOR_MM / 2 / box.FOCAL_LENGTH_MM))),
            "film": {"type": "hdrfilm", "width": side_px, "height": side_px, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "multijitter", "sample_count": samples}}


def _shape(name, triangles, band):
    diffuse = {"type": "diffuse", "reflectance": _raw(box.reflectance(name, band))}
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict({"type": "twosided", "bsdf": diffuse})
    if name == "lamp":
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": _raw(box.lamp_radiance(band))})
    mesh = mitsuba.Mesh(name, vertex_count=3 * len(triangles), face_count=len(triangles), props=properties)
    parameters = mitsuba.traverse(mesh)
    parameters["vertex_positions"] = triangles.ravel().astype(np.float32)
    parameters["faces"] = np.arange(3 * len(triangles), dtype=np.uint32)
    parameters.update()
    return mesh


def _raw(values):
    return {"type": "rgb", "value": [float(value) for value in values]}


def write_test_data(path):
    """Write block means at a few wavelengths, with enough samples to make their noise negligible."""
    cube = render(TEST_WAVELENGTHS_NM, TEST_SIDE_PX, TEST_SAMPLES, seed=0)
    np.savez_compressed(path, wavelengths_nm=TEST_WAVELENGTHS_NM, radiance=box.block_means(cube, TEST_BLOCKS))


if __name__ == "__main__":
    write_test_data(sys.argv[1])
