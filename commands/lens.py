"""`lensfield lens`: inspect, check, plot, bake, calibrate, fit, import and convert lens data."""

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from lensfield.engine import InputError, load_lens
from lensfield.engine.bake.through_focus import lens_at_depth
from lensfield.engine.calibration.views import overscan_line
from lensfield.engine.field.stmap import distort_map, map_overscan_px, undistort_map
from lensfield.engine.inspection.checks import check_lens
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.inspection.finding import SEVERITIES
from lensfield.engine.inspection.info import lens_info, lens_text
from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.lens.conventions import WAVELENGTHS
from lensfield.engine.lens.formats import format_mm
from lensfield.engine.lens_files import IMPORTABLE, import_lens
from lensfield.engine.lens_files.export_macro import PROGRAMS, ExportOptions, export_macro
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import (
    baked,
    bundled_names,
    find_bundled,
    has_rings,
    prescription_as_stated,
    prescription_of,
)
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from lensfield.engine.prescription.photographs import NOT_COMPARED
from lensfield.engine.rays.rings import in_metres, ring_ends, turned
from lensfield.engine.runtime import cache
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.runtime.values import json_value
from lensfield.engine.spectral.spectra import parse_wavelengths

from . import bake, calibration, fit, measured
from .arguments import (
    LENSES,
    add_iris,
    add_lens_settings,
    check_limits,
    check_outputs,
    chosen_lens,
    distance_mm,
    iris_option,
    rings_option,
    shown_iris,
)
from .cameras import add_cameras, cameras, check_cameras, sources
from .prescription_file import add_reading, lens_source, reading_options_for
from .terminal import say

MOST_ANGLE_DEG = 89.0
MACRO_SUFFIXES = {"zemax": ".zpl", "codev": ".seq", "zospy": ".py"}


def add_options(command):
    lens = command.add_subparsers(required=True, metavar="COMMAND")
    info = lens.add_parser("info", help="print first-order data, distortion, relative illumination and lateral colour")
    info.add_argument("lens", metavar="NAME|FILE", help=LENSES)
    info.add_argument("--json", action="store_true", help="print JSON")
    info.add_argument("--wavelengths", metavar="SPEC",
                      help="of a prescription's bake, in nm: first:last:number, or a list; for glasses that are known "
                           "over a part of the visible range only (default: all of it)")
    add_lens_settings(info)
    info.set_defaults(run=_info)
    listing = lens.add_parser("list", help="list the bundled lenses: names, titles and makers")
    listing.add_argument("words", nargs="*", metavar="WORD",
                         help="list only lenses that match every word: maker, year, 50mm, swirl ...")
    listing.add_argument("--compared", action="store_true",
                         help="list only lenses that were compared with photographs, and how closely they agree")
    listing.set_defaults(run=_list)
    _add_cache(lens)
    _add_check(lens)
    _add_plot(lens)
    _add_stmap(lens)
    calibration.add(lens)
    _add_import(lens)
    measured.add(lens)
    bake.add(lens)
    fit.add(lens)
    _add_export_macro(lens)


def _list(options):
    for name, lens in find_bundled(options.words).items():
        if not options.compared:
            say(f"{name:<30} {lens.title:<48} {lens.maker}")
        elif lens.photographs:
            say(f"{name:<30} {lens.photographs}")


def _add_cache(lens):
    cache = lens.add_parser("cache", help="show the cache of baked lenses: folder, number and size")
    cache.add_argument("--clear", action="store_true", help="empty the cache; lenses are baked again when needed")
    cache.set_defaults(run=_cache)


def _cache(options):
    if options.clear:
        cache.clear(baked.KIND)
    number, size = cache.size_bytes(baked.KIND)
    say(f"{cache.cache_folder() or 'no cache'}: {number} baked lenses, {size / 1e6:.1f} MB of at most "
        f"{baked.MOST_BYTES / 1e6:.0f} MB")


def _info(options):
    info = lens_info(chosen_lens(options, wavelengths_nm=_baked_nm(options)))
    prescription = prescription_of(lens_source(options, options.lens)) if has_rings(options.lens) else None
    ends = ring_ends(prescription) if prescription else ()
    if options.json:
        provenance = dict(prescription.provenance) if prescription else {}
        photographs = asdict(prescription.photographs) if prescription and prescription.photographs else None
        print(json.dumps(info | {"rings": json_value([asdict(end) for end in ends]), "provenance": provenance,
                                 "photographs": json_value(photographs)}, indent=2))
        return
    say(*lens_text(info).split("\n"))
    if prescription and prescription.passport:
        say("", f"figures                  {prescription.passport}")
    if prescription:
        say(f"photographs              {prescription.photographs or NOT_COMPARED}")
    if ends:
        far, near = ends
        say("", f"focus ring               {in_metres(far.focus_mm)} to {in_metres(near.focus_mm)}",
            f"f-stop ring              f/{far.f_number:.3g} to f/{near.f_number:.3g}")


def _baked_nm(options):
    """The wavelengths that --wavelengths requests; None without it."""
    if options.wavelengths is None:
        return None
    if not has_rings(options.lens):
        raise InputError("options", "--wavelengths", options.wavelengths,
                         "a lens package has its own: leave it out, or give the lens's prescription")
    return parse_wavelengths(options.wavelengths)


def _add_check(lens):
    check = lens.add_parser("check", help="find likely errors in lens data, or by rays through a prescription; exit "
                                          "status 1 for an error")
    check.add_argument("lens", metavar="NAME|FILE", help=LENSES)
    add_reading(check)
    check.add_argument("--json", action="store_true", help="print JSON")
    check.set_defaults(run=_check)


def _check(options):
    """Print the findings; the exit status is 1 if one of them is an error."""
    findings = _findings(options)
    counts = Counter(finding.severity for finding in findings)
    if options.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        summary = ", ".join(f"{counts[severity]} {severity}{'s' * (counts[severity] > 1)}"
                            for severity in SEVERITIES if counts[severity])
        say(*findings, summary or "no findings")
    return int(counts["error"] > 0)


def _findings(options):
    """Findings on a prescription, from its rays, or on a lens package, from its tables."""
    reading = reading_options_for(options.lens, options)
    if has_rings(options.lens):
        return check_prescription(prescription_as_stated(options.lens, reading))
    return check_lens(load_lens(options.lens))


def _add_plot(lens):
    plot = lens.add_parser("plot", help="plot a lens on one sheet: PSFs, distortion, MTF, relative illumination and "
                                        "colour")
    plot.add_argument("lens", metavar="NAME|FILE", help=LENSES)
    plot.add_argument("-o", "--output", type=Path, metavar="SHEET.png",
                      help="file to write (default: next to the lens file, with its name; for a bundled lens, NAME.png "
                           "here)")
    plot.add_argument("--frequencies", metavar="LIST",
                      help="frequencies of the MTF in cycles per mm, such as 20,50,100 (default: up to a tenth of the "
                           "diffraction limit)")
    plot.add_argument("--depth", metavar="DISTANCE",
                      help="PSFs and MTF of out-of-focus points at this distance from the camera, by diffraction: "
                           "2.5m, 80cm or inf")
    plot.add_argument("--ghosts", type=float, metavar="DEGREES",
                      help="instead, the ghosts of a point this far above the axis: their surfaces, light, places and "
                           "sizes, also as a table (default file: NAME_ghosts.png)")
    add_lens_settings(plot)
    add_iris(plot)
    plot.set_defaults(run=_plot)


def _plot(options):
    from lensfield.engine.inspection.sheet import write_lens_plot

    _check_plot(options)
    if options.ghosts is not None:
        _plot_ghosts(options)
        return
    frequencies = None if options.frequencies is None else _frequencies(options.frequencies)
    lens = chosen_lens(options)
    if options.depth is not None:
        lens = lens_at_depth(lens, lens_rays(lens), distance_mm(options.depth, "--depth"))
    path = _sheet_path(options)
    write_lens_plot(lens, path, frequencies, _photographs(options))
    say(path)


def _check_plot(options):
    """Raise an InputError for an option that this kind of plot does not show."""
    for option, value in (("--frequencies", options.frequencies), ("--depth", options.depth)):
        if options.ghosts is not None and value is not None:
            raise InputError("options", option, value, "leave it out: --ghosts plots the ghosts alone")
    if options.ghosts is None and (iris := iris_option(options)):
        raise InputError("options", "--iris-blades", iris.blades, "also give --ghosts: other plots are of a round stop")


def _photographs(options):
    """How closely the lens agrees with photographs, with their light at its focus and f-stop; None without any."""
    source = lens_source(options, options.lens)
    if not has_rings(source) or not (photographs := prescription_of(source).photographs):
        return None
    lens = turned(prescription_of(source), rings_option(options))
    return photographs.at(lens.f_number, lens.focus_mm)


def _sheet_path(options, ending=""):
    """The file of a sheet, if it may be written."""
    bundled = options.lens in bundled_names()
    stem = Path(options.lens) if bundled else Path(options.lens).with_suffix("")
    path = options.output or stem.with_name(f"{stem.name}{ending}.png")
    check_outputs([(path, ".png")], [options.lens])
    return path


def _plot_ghosts(options):
    from lensfield.engine.inspection.ghost_sheet import ghost_lines, write_ghost_sheet
    from lensfield.engine.stray.ghost_table import ghost_table

    check_limits("--ghosts", options.ghosts, (0, MOST_ANGLE_DEG))
    path, lens = _sheet_path(options, "_ghosts"), chosen_lens(options)
    table = ghost_table(lens, options.ghosts, shown_iris(options))
    write_ghost_sheet(lens, table, path)
    say(*ghost_lines(table), path)


def _frequencies(text):
    """Cycles per mm from a list such as 20,50,100."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError("options", "--frequencies", text, "expected cycles per mm such as 20,50,100") from None


def _add_stmap(lens):
    stmap = lens.add_parser("stmap", help="write the distortion as a pair of STMaps for compositors")
    stmap.add_argument("--wavelength", type=float, metavar="NM",
                       help="wavelength in nm (default: the lens's reference wavelength)")
    stmap.add_argument("--output", type=Path, required=True, metavar="DIR",
                       help="folder for LENS_distort.exr and LENS_undistort.exr; with --frames, SCENE_0001_distort.exr "
                            "and so on, for each frame with other maps than before it")
    add_cameras(stmap)
    stmap.set_defaults(run=_stmap)


def _stmap(options):
    check_cameras(options)
    known = None
    for camera in cameras(options):
        nm = reference_nm(camera.lens) if options.wavelength is None else options.wavelength
        if (camera.lens, camera.grid) != known:
            _write_stmaps(options, camera, nm)
        known = camera.lens, camera.grid


def _write_stmaps(options, camera, nm):
    """Write both maps of a camera, and print the overscan that they need."""
    number = "" if options.frames is None else f"_{camera.frame:04d}"
    stem = f"{Path(options.scene or options.lens).stem}{number}"
    paths = {name: options.output / f"{stem}_{name}.exr" for name in ("distort", "undistort")}
    check_outputs([(path, ".exr") for path in paths.values()], sources(options))
    distort = distort_map(camera.lens, camera.grid, nm)
    write_rgb_exr(distort, paths["distort"])
    write_rgb_exr(undistort_map(camera.lens, camera.grid, nm), paths["undistort"])
    say(*paths.values(), overscan_line(map_overscan_px(distort), camera.grid.shape_px[::-1]))


def _add_export_macro(lens):
    macro = lens.add_parser("export-macro", help="write a macro that exports a lens from Zemax, Code V or zospy")
    macro.add_argument("program", choices=PROGRAMS)
    macro.add_argument("-o", "--output", type=Path, metavar="FILE", help="file to write (default: standard output)")
    macro.add_argument("--heights", type=int, default=ExportOptions.heights, metavar="N",
                       help="number of field heights from the axis to the last (default: %(default)s)")
    macro.add_argument("--last-height", type=float, metavar="MM",
                       help="paraxial image height of the last field (default: the lens's outermost field)")
    macro.add_argument("--wavelengths", default=WAVELENGTHS, metavar="NM",
                       help="in nm: first:last:number, or a list (default: %(default)s)")
    macro.add_argument("--psf-samples", type=int, default=ExportOptions.psf_samples, metavar="N",
                       help="samples along each side of a PSF, a power of two (default: %(default)s)")
    macro.add_argument("--psf-pitch-um", type=float, default=ExportOptions.psf_pitch_um, metavar="UM",
                       help="distance between PSF samples (default: %(default)s)")
    macro.add_argument("--pupil-samples", type=int, default=ExportOptions.pupil_samples, metavar="N",
                       help="samples across the pupil, a power of two (default: %(default)s)")
    macro.add_argument("--sensor", metavar="WxH", help="sensor size in mm (default: 4:3, up to the last height)")
    macro.set_defaults(run=_export_macro)


def _export_macro(options):
    macro = export_macro(options.program, ExportOptions(
        options.heights, options.last_height, tuple(parse_wavelengths(options.wavelengths).tolist()),
        options.psf_samples, options.psf_pitch_um, options.pupil_samples,
        options.sensor and format_mm(options.sensor)))
    if options.output is None:
        print(macro, end="")
        return
    check_outputs([(options.output, MACRO_SUFFIXES[options.program])])
    with atomic_path(options.output) as temporary:
        temporary.write_text(macro, encoding="ascii", newline="\r\n")  # all three programs run on Windows


def _add_import(lens):
    command = lens.add_parser("import", help="convert another program's export to a lens package")
    command.add_argument("path", type=Path, metavar="PATH", help=IMPORTABLE)
    command.add_argument("-o", "--output", type=Path, required=True, metavar="X.npz", help="lens package to write")
    command.add_argument("--name", help="name of the lens (default: the name in the files)")
    command.set_defaults(run=_import)


def _import(options):
    check_outputs([(options.output, ".npz")], [options.path])
    lens = import_lens(options.path, options.name)
    write_package(lens, options.output)
    say(options.output, *filter(None, [lens.notes]))
