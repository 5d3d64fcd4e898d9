"""The Cornell box as numbers, for any renderer: walls, blocks and lamp, camera, measured spectra.

Source: Cornell University Program of Computer Graphics, Cornell Box Data,
https://www.graphics.cornell.edu/online/box/data.html. Surfaces are Lambertian on both sides. Choices made here: the
four-sided walls are split into triangles, because the red wall is not planar; the ceiling has a hole for the lamp,
because both are at the same height; the lamp reflects 0.78 at all wavelengths; its emission is in W m^-2 sr^-1 nm^-1.
"""

import numpy as np

CAMERA_MM = (278.0, 273.0, -800.0)
"""Position of the pinhole. It looks along +z, with +y up, so +x is on the left of its picture."""
FOCAL_LENGTH_MM = 35.0
SENSOR_MM = 25.0

LAMP_NM = (400.0, 500.0, 600.0, 700.0)
LAMP_RADIANCE = (0.0, 8.0, 15.6, 18.4)
"""W m^-2 sr^-1 nm^-1, linear between LAMP_NM, 0 beyond."""

REFLECTANCE_NM = np.arange(400.0, 701.0, 4.0)
REFLECTANCE = {
    "white": (
        .343, .445, .551, .624, .665, .687, .708, .723, .715, .710, .745, .758, .739, .767, .777, .765, .751, .745,
        .748, .729, .745, .757, .753, .750, .746, .747, .735, .732, .739, .734, .725, .721, .733, .725, .732, .743,
        .744, .748, .728, .716, .733, .726, .713, .740, .754, .764, .752, .736, .734, .741, .740, .732, .745, .755,
        .751, .744, .731, .733, .744, .731, .712, .708, .729, .730, .727, .707, .703, .729, .750, .760, .751, .739,
        .724, .730, .740, .737),
    "green": (
        .092, .096, .098, .097, .098, .095, .095, .097, .095, .094, .097, .098, .096, .101, .103, .104, .107, .109,
        .112, .115, .125, .140, .160, .187, .229, .285, .343, .390, .435, .464, .472, .476, .481, .462, .447, .441,
        .426, .406, .373, .347, .337, .314, .285, .277, .266, .250, .230, .207, .186, .171, .160, .148, .141, .136,
        .130, .126, .123, .121, .122, .119, .114, .115, .117, .117, .118, .120, .122, .128, .132, .139, .144, .146,
        .150, .152, .157, .159),
    "red": (
        .040, .046, .048, .053, .049, .050, .053, .055, .057, .056, .059, .057, .061, .061, .060, .062, .062, .062,
        .061, .062, .060, .059, .057, .058, .058, .058, .056, .055, .056, .059, .057, .055, .059, .059, .058, .059,
        .061, .061, .063, .063, .067, .068, .072, .080, .090, .099, .124, .154, .192, .255, .287, .349, .402, .443,
        .487, .513, .558, .584, .620, .606, .609, .651, .612, .610, .650, .638, .627, .620, .630, .628, .642, .639,
        .657, .639, .635, .642),
    "lamp": (.78,) * 76,
}

_LAMP = [(343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227)]
_CEILING = [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]
_FLOOR = [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]
_BACK = [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)]
_RIGHT = [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]
_LEFT = [(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]
_SHORT_BLOCK = 165, [(130, 65), (82, 225), (240, 272), (290, 114)]
_TALL_BLOCK = 330, [(423, 247), (265, 296), (314, 456), (472, 406)]


def triangles_mm():
    """The scene's triangles by material: {"white", "green", "red", "lamp": float64 array (triangle, corner, xyz), mm}.

    The lamp's triangles face down, into the box.
    """
    white = [_FLOOR, _BACK, *_frame(_CEILING, _LAMP), *_block(*_SHORT_BLOCK), *_block(*_TALL_BLOCK)]
    quads = {"white": white, "green": [_RIGHT], "red": [_LEFT], "lamp": [_LAMP]}
    return {material: np.array([[quad[corner] for corner in half] for quad in of_material
                                for half in ((0, 1, 2), (0, 2, 3))], dtype=float)
            for material, of_material in quads.items()}


def _frame(outer, inner):
    """The four quads between two rectangles whose corners correspond."""
    return [[outer[i], outer[i - 3], inner[i - 3], inner[i]] for i in range(4)]


def _block(height_mm, base_xz):
    """The top and the sides of a block on the floor."""
    base = [(x, 0, z) for x, z in base_xz]
    top = [(x, height_mm, z) for x, z in base_xz]
    return [top] + [[base[i - 1], top[i - 1], top[i], base[i]] for i in range(4)]


def reflectance(material, wavelengths_nm):
    """Reflectance of a material at these wavelengths."""
    return np.interp(wavelengths_nm, REFLECTANCE_NM, REFLECTANCE[material])


def lamp_radiance(wavelengths_nm):
    """The lamp's radiance at these wavelengths, W m^-2 sr^-1 nm^-1."""
    return np.interp(wavelengths_nm, LAMP_NM, LAMP_RADIANCE, left=0, right=0)


def block_means(cube, blocks):
    """Means of `blocks` x `blocks` square blocks: array (wavelength, block row, block column), float64."""
    waves, rows, columns = cube.shape
    squares = cube.reshape(waves, blocks, rows // blocks, blocks, columns // blocks)
    return squares.mean(axis=(2, 4), dtype=np.float64)
