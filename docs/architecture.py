"""The picture of docs/architecture.md: both flows, and the floors that tests/test_architecture.py holds.

    python docs/architecture.py docs/architecture.png

Rooms, what they may use and what they are for are read from that test and from the rooms' own docstrings.
"""

import ast
import hashlib
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle
from matplotlib.textpath import TextPath
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from scipy.ndimage import rotate

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from lensfield.engine import Lens  # noqa: E402
from lensfield.engine.lens.curves import distortion_grid, field_of  # noqa: E402
from lensfield.engine.library import BUNDLED  # noqa: E402
from lensfield.engine.sheet.psf_map import tile  # noqa: E402
from lensfield.engine.sheet.white_light import wavelength_colours, white_psfs  # noqa: E402
from lensfield.engine.spectral.colour import encode_srgb  # noqa: E402
from lensfield.engine.spectral.spectra import load_spectrum  # noqa: E402
from test_architecture import FLOORS, FOUNDATION, MODULES  # noqa: E402

LENS = "edmund-54852"
RENDERED_NM = (405, 435, 450, 480, 510, 540, 565, 580, 595, 610, 630, 680)  # of the sample scene, by Check Scene
WIDTH, HEIGHT, DPI = 1240, 1730, 100
SHARPNESS, COLOURS = 1.6, 256  # of the file: pixels for each of these, and colours of its palette
MARGIN, CARD_W, CARD_H, PICTURE_H = 30, 212, 248, 140
INK, PALE, LINE, PAPER = "#2b2b33", "#6b6b76", "#c9c9d2", "#ffffff"
BLENDER, ENGINE, BESIDE, COMMAND, GROUND = "#c8702a", "#2f6b9a", "#4b8a5f", "#7a5a9a", "#77777f"


class Sheet:
    """One drawing in units of a pixel, y downwards."""

    def __init__(self):
        self.figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=SHARPNESS * DPI, facecolor=PAPER)
        self.axes = self.figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0))
        self.axes.axis("off")

    def text(self, x, y, words, size=8.5, colour=INK, **style):
        self.axes.text(x, y, words, fontsize=size, color=colour, zorder=5,
                       **({"va": "top", "linespacing": 1.25} | style))

    def heading(self, y, words, colour, remark):
        self.text(MARGIN, y, words, 14, colour, weight="bold")
        self.text(MARGIN + text_px(words, 14, weight="bold") + 16, y + 6, remark, 9.5, PALE)

    def box(self, x, y, width, height, edge, fill=PAPER, rounding=6):
        self.axes.add_patch(FancyBboxPatch((x + rounding, y + rounding), width - 2 * rounding, height - 2 * rounding,
                                           boxstyle=f"round,pad={rounding}", facecolor=fill, edgecolor=edge, lw=1.1))

    def block(self, x, y, width, height, **style):
        self.axes.add_patch(Rectangle((x, y), width, height, **({"edgecolor": "none", "zorder": 1.5} | style)))

    def line(self, xs, ys, *marker, **style):
        return self.axes.plot(xs, ys, *marker, **({"zorder": 3} | style))[0]

    def arrow(self, *points, colour=INK):
        """A line through the points with a head at its end."""
        xs, ys = zip(*points, strict=True)
        self.line(xs[:-1], ys[:-1], color=colour, lw=1.6, solid_joinstyle="round")
        self.axes.add_patch(FancyArrowPatch(points[-2], points[-1], arrowstyle="-|>", mutation_scale=13, lw=1.6,
                                            color=colour, shrinkA=0, shrinkB=0, zorder=3))

    def picture(self, x, y, width, height, pixels, layer=2.0):
        self.axes.imshow(pixels, extent=(x, x + width, y + height, y), aspect="auto", interpolation="none",
                         zorder=layer)
        self.axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0))

    def card(self, number, y, title, room, words, colour, draw):
        """A step of a flow: a picture, what it is, and the rooms that do it."""
        x = card_x(number)
        self.box(x, y, CARD_W, CARD_H, colour)
        draw(self, x + 8, y + 8, CARD_W - 16, PICTURE_H)
        self.text(x + 10, y + PICTURE_H + 15, title, 10, weight="bold")
        self.text(x + 10, y + PICTURE_H + 34, wrapped(words, CARD_W - 20, 8), 8)
        self.text(x + 10, y + CARD_H - 17, room, 7.5, colour, family="monospace")


def card_x(number):
    return MARGIN + number * (WIDTH - 2 * MARGIN - CARD_W) / 4


def text_px(words, size, **style):
    """Width of a line of words."""
    return TextPath((0, 0), words, size=size, prop=FontProperties(**style)).get_extents().width * DPI / 72


def wrapped(words, width, size):
    """Words in lines of up to this width."""
    lines = [""]
    for word in words.split():
        longer = f"{lines[-1]} {word}".strip()
        if text_px(longer, size) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return "\n".join(lines)


# What the cards show

def frame(sheet, x, y, width, height, fill="#f4f4f7"):
    sheet.block(x, y, width, height, facecolor=fill)


def photograph(side):
    def draw(sheet, x, y, width, height):
        both = Image.open(ROOT / "docs" / "before_after.jpg")
        half = both.width // 2 - 4
        left = side * (both.width - half)
        tall = round(half * height / width)
        thumbnail = both.crop((left, both.height - tall, left + half, both.height))
        sheet.picture(x, y, width, height, np.asarray(thumbnail.resize((round(1.5 * width), round(1.5 * height)))))

    return draw


def nm_axis(x, width):
    return lambda nm: x + 8 + (np.asarray(nm) - 400) / 300 * (width - 16)


def choice(sheet, x, y, width, height):
    """The wavelengths that are rendered, three in each pass."""
    frame(sheet, x, y, width, height)
    at, base = nm_axis(x, width), y + height - 26
    nm = np.arange(400, 701)
    sheet.picture(at(400), base, at(700) - at(400), 10, wavelength_colours(nm)[None])
    for number in range(0, len(RENDERED_NM), 3):
        row = y + 20 + 7 * number
        trio = RENDERED_NM[number:number + 3]
        sheet.line(at(trio), [row] * 3, color=LINE, lw=1)
        for nm, colour in zip(trio, wavelength_colours(trio), strict=True):
            sheet.line([at(nm)] * 2, [row, base], color=colour, lw=0.6, alpha=0.5)
            sheet.line(at(nm), row, "o", color=colour, ms=6)
    sheet.text(at(400), base + 12, "400", 7, PALE)
    sheet.text(at(700), base + 12, "700 nm", 7, PALE, ha="right")


def spectra(sheet, x, y, width, height):
    frame(sheet, x, y, width, height)
    nm, at = np.arange(400, 701, 2), nm_axis(x, width)
    for name, colour in (("chart-15-red", "#b8352c"), ("chart-14-green", "#4b8a3f"), ("chart-13-blue", "#33509a")):
        values = load_spectrum(name).at(nm)
        sheet.line(at(nm), y + height - 12 - 56 * values / 0.7, color=colour, lw=1.8)
    lamp = load_spectrum("fluorescent-fl11").at(nm)
    top = y + 8 + 50 * (1 - lamp / lamp.max())
    sheet.axes.fill_between(at(nm), top, y + 58, color="#e2b13c", alpha=0.55, lw=0, zorder=2)
    sheet.line(at(nm), top, color="#a87d14", lw=1)


def passes(sheet, x, y, width, height):
    """The picture as red, green and blue carry it: a wavelength each."""
    frame(sheet, x, y, width, height)
    scene = np.asarray(Image.open(ROOT / "docs" / "before_after.jpg").crop((0, 0, 768, 576)).resize((256, 192))) / 255
    for number, (nm, channel) in enumerate(zip((450, 540, 610), (2, 1, 0), strict=True)):
        left, top = x + 12 + 34 * number, y + 8 + 17 * number
        tint = wavelength_colours([nm])[0]
        grey = scene[..., channel, None]
        seen = np.clip(grey * (0.25 + 0.75 * tint / tint.max()), 0, 1)
        sheet.picture(left, top, 104, 78, seen, layer=2 + number / 4)
        sheet.block(left, top, 104, 78, fill=False, edgecolor=PAPER, lw=1.5, zorder=2.1 + number / 4)
    sheet.text(x + 12, y + height - 17, "B 450   G 540   R 610 nm", 7, PALE)


def cube(sheet, x, y, width, height):
    """Planes of many wavelengths, one behind another."""
    frame(sheet, x, y, width, height)
    nm = np.linspace(430, 690, 9)[::-1]
    for number, colour in enumerate(wavelength_colours(nm)):
        shift = (8 - number)
        corner = np.array([x + 20 + 9.5 * shift, y + 50 - 5 * shift])
        plane = corner + np.array([(0, 0), (84, 0), (84, 68), (0, 68)])
        sheet.axes.add_patch(Polygon(plane, facecolor=(*colour, 0.82), edgecolor=PAPER, lw=1.2,
                                     zorder=2))
    sheet.block(x + 30, y + 60, 64, 48, fill=False, edgecolor=PAPER, lw=1, ls=(0, (3, 2)), zorder=3)
    sheet.text(x + 33, y + 63, "frame", 7, PAPER)
    sheet.text(x + 20, y + height - 18, "(wavelength, row, column)", 7, PALE)


def lens_section(sheet, x, y, width, height):
    """The glass of the lens, from its prescription."""
    frame(sheet, x, y, width, height)
    surfaces = tomllib.loads((BUNDLED / "prescriptions" / f"{LENS}.toml").read_text())["surfaces"]
    scale, middle = 11.2, y + height / 2
    edges, place = [], x + 14
    for part in surfaces:
        heights = np.linspace(-1, 1, 41) * part["semi_aperture_mm"]
        curvature = 1 / part.get("radius_mm", np.inf)
        sag = curvature * heights**2 / (1 + np.sqrt(1 - (curvature * heights) ** 2))
        edges.append(np.stack([place + scale * sag, middle + scale * heights], axis=1))
        place += scale * part["thickness_mm"]
    sheet.line([x + 4, x + width - 6], [middle] * 2, color=LINE, lw=0.8, ls=(0, (8, 3, 2, 3)))
    for first, second, part in zip(edges, edges[1:], surfaces, strict=False):
        if "glass" in part:
            sheet.axes.add_patch(Polygon(np.concatenate([first, second[::-1]]), facecolor="#cfe3f3",
                                         edgecolor=BESIDE, lw=1.2, zorder=2))
        if part.get("stop"):
            for side in (-1, 1):
                sheet.line([first[0, 0]] * 2, [middle + side * scale * part["semi_aperture_mm"],
                                                   middle + side * scale * 3.4], color=INK, lw=2)
    sheet.line([place] * 2, [middle - scale * 3, middle + scale * 3], color=INK, lw=2.4)


def trade(sheet, x, y, width, height):
    """Error against time: what is asked for, and the cheapest way to it."""
    frame(sheet, x, y, width, height)
    sheet.line([x + 24, x + 24, x + width - 10], [y + 12, y + height - 24, y + height - 24], color=PALE, lw=1)
    asked = y + 78
    sheet.line([x + 24, x + width - 10], [asked] * 2, color=ENGINE, lw=1, ls=(0, (4, 3)))
    along = np.linspace(0, 1, 40)
    for colour, start, reach, drop in (("#b0b0ba", 70, 88, 52), ("#8aa9c4", 46, 118, 84), (ENGINE, 34, 112, 96)):
        sheet.line(x + start + (reach - 20) * along, y + 18 + drop * (1 - (1 - along) ** 2), color=colour, lw=1.8)
    chosen = 1 - np.sqrt(1 - 60 / 96)
    sheet.line(x + 34 + 92 * chosen, asked, "o", color=ENGINE, ms=8)
    sheet.text(x + width - 10, asked - 14, "asked: 1 %", 7, ENGINE, ha="right")
    sheet.text(x + width - 10, y + height - 20, "seconds", 7, PALE, ha="right")
    sheet.text(x + 8, y + 14, "error", 7, PALE, rotation=90)


def grid(sheet, x, y, width, height):
    """The lens's own distortion grid, on its sensor."""
    lens = Lens.load(LENS)
    half_w, half_h = lens.sensor_mm[0] / 2, lens.sensor_mm[1] / 2
    scale = (height - 16) / lens.sensor_mm[1]
    field = field_of(lens)
    left, top = x + width / 2 - half_w * scale, y + 8
    frame(sheet, x, y, width, height)
    sheet.block(left, top, 2 * half_w * scale, 2 * half_h * scale, facecolor="#faf5e6")
    clip = Rectangle((left, top), 2 * half_w * scale, 2 * half_h * scale, transform=sheet.axes.transData)
    for lines, colour, weight in zip(distortion_grid(lens, field), (LINE, ENGINE), (0.8, 1.4), strict=True):
        for line in lines:
            drawn = sheet.line(x + width / 2 + scale * line[:, 0], y + height / 2 - scale * line[:, 1],
                                     color=colour, lw=weight)
            drawn.set_clip_path(clip)


def blur(sheet, x, y, width, height):
    """Point spread functions in white light over the field, turned as they lie, each over its own peak."""
    lens = Lens.load(LENS)
    frame(sheet, x, y, width, height, "black")
    side, half_um = 34, 26.0
    real_mm = field_of(lens).optics.real_height_mm
    for place_y in np.linspace(-1, 1, 3):
        for place_x in np.linspace(-1, 1, 5):
            height_mm = np.hypot(2.25 * place_x, 1.5 * place_y)
            index = int(np.abs(real_mm - height_mm).argmin())
            psf = white_psfs(lens, [index])[0]
            tiles = np.stack([tile(psf[..., c], lens.psf_pitch_um, half_um, 4 * side) for c in range(3)], axis=-1)
            turned = rotate(tiles, np.degrees(np.arctan2(-place_y, place_x)), reshape=False, order=1)
            sheet.picture(x + width / 2 + place_x * (width / 2 - 21) - side / 2,
                          y + height / 2 + place_y * (height / 2 - 23) - side / 2, side, side,
                          encode_srgb(np.clip(2.5 * turned / tiles.max(), 0, 1)))


# The floors

def purpose(room):
    """The first sentence of a room's docstring."""
    words = ast.get_docstring(ast.parse(MODULES[room].read_text(encoding="utf-8"))).split("\n\n")[0]
    return " ".join(words.split()).split(". ")[0].rstrip(".")


def levels():
    """The floor of each room: above all that it uses, but for the version, which the package holds."""
    floor = {}
    while len(floor) < len(FLOORS):
        for room, used in FLOORS.items():
            below = used - {"", room}
            if room not in floor and below <= set(floor):
                floor[room] = 1 + max((floor[other] for other in below), default=-1)
    return floor


def label(room, user):
    """A room as its user names it. The command takes the version from the package above it, and nothing else."""
    return (room.split(".")[-1] or "lensfield") + " (version)" * (FLOOR[room] > FLOOR[user])


def draw_room(sheet, room, x, y, width, colour):
    uses = sorted(FLOORS[room] - FOUNDATION, key=lambda other: (-FLOOR[other], other))
    sheet.box(x, y, width, ROOM_H, colour)
    sheet.block(x + 1, y + 8, 4, ROOM_H - 16, facecolor=colour)
    sheet.text(x + 14, y + 7, room or "lensfield", 9.5, colour, weight="bold", family="monospace")
    sheet.text(x + 14, y + 24, wrapped(purpose(room), width - 24, 8), 8)
    if uses:
        sheet.text(x + 14, y + ROOM_H - 15, "may use " + ", ".join(label(other, room) for other in uses), 7, PALE)


FLOOR = levels()
FIRST_FLOOR = FLOOR["engine.spectral"]  # of the engine's rooms above its foundation
ROW, ROOM_H, SLAB_H, SLAB_ROWS = 92, 84, 164, 2
TOWER, WING, HOUSE = (42, 374), (424, 402), (866, 332)  # left end and width


def draw_flows(sheet):
    upper, lower = 58, 400
    sheet.heading(24, "1   Scene → radiance", BLENDER, "in Blender; addon/job/render.py goes through it step by step")
    for number, (title, room, words, draw) in enumerate((
            ("The scene", "addon/scene", "A .blend, whose camera takes the lens's view, with overscan. It is left as "
             "it was.", photograph(0)),
            ("Wavelengths", "engine/spectral, addon/job", "As few as tell all others, by the scene's own colours and "
             "lamps. The linter judges each node.", choice),
            ("Spectra", "addon/shading", "Measured, or upsampled from colours, on stand-ins. A light group for "
             "each lamp's spectrum.", spectra),
            ("Cycles passes", "addon/job", "Red, green and blue carry a wavelength each; one alone where glass "
             "disperses.", passes),
            ("Spectral radiance", "engine/image", "W m⁻² sr⁻¹ nm⁻¹: passes × lamps × weights. Or from a file, of any "
             "renderer.", cube))):
        sheet.card(number, upper, title, room, words, BLENDER, draw)
    sheet.heading(366, "2   Lens + radiance → irradiance", ENGINE, "engine/simulate.py, without Blender")
    for number, (title, room, words, colour, draw) in enumerate((
            ("Lens data", "engine/lens, engine/bake", "Distortion, illumination and PSFs over heights and wavelengths: "
             "exported, or traced.", BESIDE, lens_section),
            ("The plan", "engine/plan", "From the accuracy asked for: the quickest method and knobs, and the bound "
             "that they keep.", ENGINE, trade),
            ("Ideal image", "engine/field, engine/image", "Light where distortion puts it, averaged over each pixel's "
             "footprint; E = π T L R / 4N².", ENGINE, grid),
            ("Blur", "engine/blur", "Every point spreads by the PSF of its own place. A module for each way to do it.",
             ENGINE, blur),
            ("Spectral irradiance", "engine/simulate.py", "W m⁻² nm⁻¹ at the sensor: to a file, to a picture, into "
             "the compositor.", ENGINE, photograph(1)))):
        sheet.card(number, lower, title, room, words, colour, draw)
    for number in range(4):
        for row in (upper, lower):
            sheet.arrow((card_x(number) + CARD_W + 3, row + 78), (card_x(number + 1) - 3, row + 78))
    turn, entry = upper + CARD_H + 26, card_x(2) + 0.8 * CARD_W
    sheet.arrow((card_x(4) + CARD_W / 2, turn - 23), (card_x(4) + CARD_W / 2, turn), (entry, turn), (entry, lower - 3))
    left, right, rail = card_x(2), card_x(3) + CARD_W, lower + CARD_H + 8
    sheet.line([left, left, right, right], [rail, rail + 6, rail + 6, rail], color=ENGINE, lw=1.2)
    sheet.text((left + right) / 2, rail + 10, "for each wavelength: engine/channel.py", 8, ENGINE, ha="center")


def draw_floors(sheet, top):
    """The rooms, each above those that it may use."""
    sheet.heading(top - 56, "The floors", INK, "every room uses those that it names, which are below it, and nothing "
                  "else: tests/test_architecture.py reads the imports")
    ground = top + 8 * ROW
    wide = WING[0] + WING[1] - TOWER[0]
    for x, width, fill in ((TOWER[0], wide, "#eef3f8"), (*HOUSE, "#faf3ec")):
        sheet.box(x - 12, top - 20, width + 24, ground - top + SLAB_H + 32, fill, fill=fill)
    places = {room: place(room) for room in FLOORS if room not in FOUNDATION}
    assert len({(x, row) for x, _, row, _ in places.values()}) == len(places), "two rooms in one place"
    for room, (x, width, row, colour) in places.items():
        draw_room(sheet, room, x, ground - (row + 1) * ROW, width, colour)
    sheet.box(TOWER[0], ground, wide, SLAB_H, GROUND, fill="#f4f4f6")
    in_row = -(-len(FOUNDATION) // SLAB_ROWS)
    for number, room in enumerate(sorted(FOUNDATION)):
        row, column = divmod(number, in_row)
        x, y, width = TOWER[0] + 14 + column * wide / in_row, ground + 8 + row * SLAB_H / SLAB_ROWS, wide / in_row
        sheet.text(x, y, room.removeprefix("engine."), 9, GROUND, weight="bold", family="monospace")
        sheet.text(x, y + 17, wrapped(purpose(room), width - 20, 8), 8)
    sheet.box(HOUSE[0], ground, HOUSE[1], SLAB_H, ENGINE, fill="#e3edf6")
    sheet.text(HOUSE[0] + 14, ground + 8, "engine", 9.5, ENGINE, weight="bold", family="monospace")
    sheet.text(HOUSE[0] + 14, ground + 25, "Any of its rooms. None of them knows Blender.", 8)
    sheet.text(WING[0] + 14, ground - 2.4 * ROW, "Of the engine, all rooms may use the foundation below.\n"
               "channel.py and kept.py are on the floor of simulate.py.", 8.5, PALE, linespacing=1.6)


def place(room):
    """Where a room is drawn: left end, width, row and colour."""
    if not room.startswith("engine"):
        return *HOUSE, FLOOR[room] - FLOOR["addon.scene"], BLENDER if room.startswith("addon") else COMMAND
    row = FLOOR[room] - FIRST_FLOOR
    if room in ("engine.sheet", "engine.bake", "engine.library"):
        half = (WING[1] - 10) / 2
        return WING[0] + (half + 10) * (room != "engine.sheet"), half, row, BESIDE
    if room in ("engine", "engine.lens"):
        return *WING, row, BESIDE if room == "engine.lens" else ENGINE
    if room in ("engine.blur", "engine.depth"):
        half = (TOWER[1] - 10) / 2
        return TOWER[0] + (half + 10) * (room == "engine.depth"), half, row, ENGINE
    return *TOWER, row, ENGINE


def main(path):
    with rc_context({"font.family": "DejaVu Sans"}):
        sheet = Sheet()
        draw_flows(sheet)
        draw_floors(sheet, 786)
        FigureCanvasAgg(sheet.figure).draw()
    drawn = Image.fromarray(np.asarray(sheet.figure.canvas.buffer_rgba())).convert("RGB")
    told = PngInfo()
    told.add_text("floors", floors_digest())
    drawn.quantize(COLOURS, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True, pnginfo=told)


def floors_digest():
    """What the picture says of the rooms, in a few letters: a test sees by it that it is of today."""
    told = {room: (sorted(used), purpose(room)) for room, used in FLOORS.items()}
    return hashlib.sha256(json.dumps(told).encode()).hexdigest()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
