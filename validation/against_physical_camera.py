"""Rays through the camera shader of physical-camera, a Blender extension, against rays through the same lens file here.

    python validation/against_physical_camera.py CHECKOUT

with a CHECKOUT of https://github.com/sidp/physical-camera, of February 2026 (db6f9ae). Its shader runs unchanged in
Cycles with its two anamorphic lenses, at one wavelength, focused at infinity, and with bare surfaces. Two walls show
where its rays leave the lens, and in which direction. `trace_both_ways` traces them back to the sensor: they must land
in the middle of their pixels, within the clear apertures, with the throughput of their angles and reflections. The
irradiance across the frame must be that of `GridRayTable`.

The shader aims at an ellipse of estimated size, and does not weight rays by its area. Irradiance is therefore compared
with a copy of the file, which makes the stop a diaphragm and marks an opening behind the lens as the stop. The
irradiance of the original file is reported without a limit. The exit status is 1 if another figure exceeds its limit.
"""

import argparse
import importlib
import json
import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

import truth_scenes
from lensfield import addon
from lensfield.addon.scene.traced_camera import use_shader
from lensfield.addon.scene.undo import Journal
from lensfield.commands.terminal import quiet
from lensfield.engine.prescription.prescription import Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.grid_rays import grid_ray_table
from lensfield.engine.rays.trace import invariants_from_image, trace_both_ways
from lensfield.engine.runtime.files import temporary_folder

LENSES = "navarro_anamorphic_2x.toml", "neil_front_anamorphic_2x.toml"
NM = 587.6  # of the shader without chromatic aberration
SENSOR_MM = 21.0, 14.0
RAYS_PX, LIGHT_PX = (128, 192), (4, 6)  # rows and columns of single rays, and of mean light
SAMPLES = 2**16  # of light
FILTER_PX = 0.01  # Blender's narrowest: rays start within half of it from the middle of a pixel
WALLS_M = 1.0, 3.0  # from the camera, which is at the shader's last surface
BEHIND_MM, CORNERS = 1.0, 128  # of the opening to aim at: its distance from the last surface, and its corners
LIMITS = {"landing, um": 0.1, "height over aperture": 1.0001, "throughput": 1e-4, "irradiance": 0.02}


@dataclass(frozen=True, eq=False)
class LensFile:
    """A lens file of physical-camera.

    Attributes
    ----------
    lens : dict
    surfaces : list of dict
    """

    lens: dict
    surfaces: list

    @property
    def text(self):
        """The file's text."""
        tables = [("[lens]", self.lens), *(("[[surface]]", surface) for surface in self.surfaces)]
        return "".join(f"{head}\n" + "".join(f"{name} = {json.dumps(value)}\n" for name, value in table.items())
                       for head, table in tables)

    @property
    def length_mm(self):
        """From the first surface to the last, where the shader's camera is."""
        return sum(surface["thickness"] for surface in self.surfaces[:-1])

    @property
    def aim_mm2(self):
        """Area of the stop's opening, as the shader samples it."""
        radius_mm = next(surface["aperture"] for surface in self.surfaces if surface.get("type") == "stop") / 2
        return CORNERS / 2 * radius_mm**2 * np.sin(2 * np.pi / CORNERS)

    def aimed_behind(self):
        """The lens with a diaphragm in place of its stop, and an opening behind it marked as the stop."""
        *before, last = (surface | {"type": "flat"} if surface.get("type") == "stop" else surface
                         for surface in self.surfaces)
        opening = {"type": "stop", "radius": 0, "thickness": 0.0, "ior": 1.0, "abbe_v": 0.0,
                   "aperture": last["aperture"]}
        return replace(self, surfaces=[*before, last | {"thickness": BEHIND_MM}, opening])


@dataclass(frozen=True, eq=False)
class Rays:
    """The shader's rays, one for each pixel whose ray passes.

    Attributes
    ----------
    passing : bool array (row, column)
    place_mm : array (2, ray)
        The middle of the pixel on the sensor.
    entry_mm, slope : arrays (2, ray)
        Where it crosses the plane of the first vertex, and its dx/dz along the light.
    throughput : array (ray,)
    """

    passing: np.ndarray
    place_mm: np.ndarray
    entry_mm: np.ndarray
    slope: np.ndarray
    throughput: np.ndarray


def read_both(path):
    """A file as LensFile and as System, for a squeezed picture through bare surfaces, with the stop of the file."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    lens = {name: value for name, value in table["lens"].items() if name != "squeeze"} | {"coating": "none"}
    read = read_prescription(path, ReadingOptions(("image_height_mm", SENSOR_MM[0] / 2), allow_mismatch=True))
    *before, last = (replace(surface, gaps_mm=()) for surface in read.surfaces)
    stop_mm = read.surfaces[read.stop_index].semi_aperture_mm
    read = replace(read, surfaces=(*before, last), focused_at_mm=(), coating="none", aperture=("stop", stop_mm))
    last = replace(last, thickness_mm=system_of(read).image_distance_mm)  # of the height, in focus in the shader
    return LensFile(lens, table["surface"]), system_of(replace(read, surfaces=(*before, last), focus="as given"))


def shader_of(file, folder):
    """OSL source of physical-camera's shader for a lens, from the folder of its extension."""
    codegen = importlib.import_module("addon.codegen")
    with temporary_folder() as lenses:
        (lenses / "lens.toml").write_text(file.text, encoding="utf-8")
        source, _ = codegen.generate_osl(folder / "lens_camera.osl.template", lenses)
    return codegen.inject_scene_lights(source)


def photograph(shader, wall_m, frame_px, samples):
    """A wall whose red and green are x and y over its distance, plus 1, and whose blue is 1: array (3, row, column)."""
    scene = truth_scenes.empty_scene()
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * wall_m  # a larger one is less precise
    truth_scenes.add_mesh(scene, "Wall", np.column_stack([corners, np.full(4, -wall_m)]), np.arange(4)[None],
                          _glow_of_places(wall_m))
    camera, render, cycles = scene.camera.data, scene.render, scene.cycles
    use_shader(camera, shader, Journal())
    camera.cycles_custom["chromatic_aberration"], camera.dof.focus_distance = 0, 0.0  # 0 is infinity
    camera.sensor_fit, (camera.sensor_width, camera.sensor_height) = "HORIZONTAL", SENSOR_MM
    (render.resolution_y, render.resolution_x), cycles.samples = frame_px, samples
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", FILTER_PX
    image = render.image_settings
    if hasattr(image, "media_type"):  # added in 5.0
        image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGB"
    with temporary_folder() as folder, quiet(1):
        render.filepath = str(folder / "wall.exr")
        bpy.ops.render.render(write_still=True, scene=scene.name)
        with OpenEXR.File(render.filepath, separate_channels=True) as file:
            return np.stack([file.parts[0].channels[name].pixels for name in "RGB"]).astype(float)


def _glow_of_places(wall_m):
    material = truth_scenes.glow("Wall")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    geometry, scaled = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
    scaled.operation = "MULTIPLY_ADD"
    scaled.inputs[1].default_value, scaled.inputs[2].default_value = (1 / wall_m, 1 / wall_m, 0), (1, 1, 1)
    links.new(geometry.outputs["Position"], scaled.inputs[0])
    emission = next(node for node in nodes if node.bl_idname == "ShaderNodeEmission")
    links.new(scaled.outputs[0], emission.inputs["Color"])
    return material


def axes_mm(frame_px):
    """x (column,) and y (row,) of the middles of pixels on the sensor, in the image as formed by the lens."""
    rows, columns = ((np.arange(count) + 0.5) / count - 0.5 for count in frame_px)
    return -columns * SENSOR_MM[0], rows * SENSOR_MM[1]


def rays_of(shader, length_mm):
    """The shader's Rays."""
    pictures = [photograph(shader, wall_m, RAYS_PX, samples=1) for wall_m in WALLS_M]
    passing = np.all([picture[2] > 0 for picture in pictures], axis=0)
    near, far = ((picture[:2, passing] / picture[2, passing] - 1) * wall_m * 1e3
                 for picture, wall_m in zip(pictures, WALLS_M, strict=True))
    slope = (near - far) / (WALLS_M[1] - WALLS_M[0]) * 1e-3
    return Rays(passing, np.stack(np.meshgrid(*axes_mm(RAYS_PX)))[:, passing],
                near + slope * (WALLS_M[0] * 1e3 - length_mm), slope, pictures[0][2, passing])


def traced(system, rays):
    """The rays by the traces here: their places on the sensor (2, ray), largest heights over a clear aperture (ray,),
    cos^4 of their angles (ray,), and transmittances of the surfaces relative to the axis (ray,)."""
    lens = system.prescription
    in_front = Surface(stop=True)  # a plane at the first vertex
    from_plane = replace(lens, surfaces=(in_front, *(replace(surface, stop=False) for surface in lens.surfaces)))
    indices = system.indices_at([NM])
    both = trace_both_ways(from_plane, np.concatenate([indices[:1], indices])[..., None],
                           *(each[None] for each in (*rays.entry_mm, *rays.slope)))
    position, direction = both.position[:, 0], both.direction[:, 0]
    invariants = invariants_from_image(lens, indices, position, direction)[:, None]
    through, on_axis = (np.prod(1 - system.reflectances([NM], each), axis=0)[0] for each in (invariants, [0.0]))
    apertures_mm = np.array([surface.semi_aperture_mm for surface in lens.surfaces])
    height = np.sqrt(both.square_mm2[1:, 0]) / apertures_mm[:, None]
    return position[:2], height.max(axis=0), direction[2]**4, through / on_axis


def ray_errors(system, rays):
    """A dictionary like `LIMITS` of the rays' errors, and the mean transmittance of the surfaces for each pixel of the
    light, array (row, column)."""
    place_mm, height, cosines, through = traced(system, rays)
    rows, columns = LIGHT_PX
    blocks = np.full(RAYS_PX, np.nan)
    blocks[rays.passing] = through
    blocks = blocks.reshape(rows, RAYS_PX[0] // rows, columns, RAYS_PX[1] // columns)
    return {"landing, um": 1e3 * np.abs(place_mm - rays.place_mm).max(), "height over aperture": height.max(),
            "throughput": np.abs(rays.throughput / (cosines * through) - 1).max()}, np.nanmean(blocks, axis=(1, 3))


def irradiance_of(system):
    """Irradiance of the pixels of the light, for uniform radiance and ideal coatings, in sr: array (row, column)."""
    ends_mm = [(0.0, side_mm / 2) for side_mm in SENSOR_MM[::-1]]
    table = grid_ray_table(system.prescription, *ends_mm, (True, True), [NM])
    return table.irradiance_per_radiance(*axes_mm(LIGHT_PX))[0]


def compare(path, folder):
    """Print the figures of a lens, and return whether they are within their limits."""
    file, system = read_both(path)
    behind = file.aimed_behind()
    shaders = [shader_of(each, folder) for each in (behind, file)]
    rays = [rays_of(shader, each.length_mm) for shader, each in zip(shaders, (behind, file), strict=True)]
    (errors, through), (errors_as_is, through_as_is) = (ray_errors(system, each) for each in rays)
    irradiance = irradiance_of(system)
    light, light_as_is = (photograph(shader, WALLS_M[0], LIGHT_PX, SAMPLES)[2] for shader in shaders)
    away_mm = system.image_distance_mm - BEHIND_MM
    errors["irradiance"] = np.abs(light * behind.aim_mm2 / away_mm**2 / (irradiance * through) - 1).max()
    print(f"{path.stem}, squeeze {system.squeeze:.3f}, {sum(each.place_mm.shape[1] for each in rays)} rays")
    worst = {name: max(value, errors_as_is.get(name, 0)) for name, value in errors.items()}
    print(*(f"  {name}: {value:.2g}, at most {LIMITS[name]:g}" for name, value in worst.items()), sep="\n")
    print(f"  irradiance of the corners over the middle: {_corners(irradiance * through):.3f} here, "
          f"{_corners(light_as_is):.3f} by the shader for the file as it is, whose rays reach "
          f"{errors_as_is['height over aperture']:.3f} of a clear aperture")
    return all(value <= LIMITS[name] for name, value in worst.items())


def _corners(light):
    middle = light[1:3, 2:4]
    return np.mean(light[[0, 0, -1, -1], [0, -1, 0, -1]]) / middle.mean()


def main(arguments=None):
    """Compare the lenses, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path, metavar="CHECKOUT")
    checkout = parser.parse_args(arguments).checkout.resolve()
    folder = checkout / "addon"
    lenses = [folder / "lenses" / name for name in LENSES]
    for path in (folder / "codegen.py", *lenses):
        if not path.is_file():
            parser.error(f"{path} is missing: expected a checkout of https://github.com/sidp/physical-camera")
    sys.path.insert(0, str(checkout))
    addon.register()
    return int(not all([compare(path, folder) for path in lenses]))


if __name__ == "__main__":
    sys.exit(main())
