"""`lensfield tradeoff`: error against time and memory, measured with a lens on test pictures."""

from pathlib import Path

from lensfield.engine import ImageError

from .arguments import LENSES, add_lens_settings, check_outputs, chosen_lens, resolution
from .terminal import progress_bar, quiet, say


def add_options(tradeoff):
    tradeoff.add_argument("--lens", required=True, metavar="NAME|FILE", help=LENSES)
    tradeoff.add_argument("--image", type=Path, metavar="RADIANCE.exr",
                          help="measure on this picture (default: points, a checkerboard and a colour chart)")
    tradeoff.add_argument("--size", metavar="WIDTHxHEIGHT",
                          help="size in pixels (default: 384x288, or the complete image): the exact operator takes "
                               "half a minute for each wavelength of 384x288, and proportionally longer for more")
    tradeoff.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor (default: as in the image, or the "
                                                         "pitch at which the size spans the lens's sensor width)")
    tradeoff.add_argument("--quick", action="store_true", help="measure fewer settings, each timed once")
    tradeoff.add_argument("--output", type=Path, required=True, metavar="DIR",
                          help="folder for tradeoff.csv and tradeoff.png")
    add_lens_settings(tradeoff)
    tradeoff.set_defaults(run=_tradeoff)


def _tradeoff(options):
    from lensfield.engine.inspection.tradeoff import description, measure, write_table
    from lensfield.engine.inspection.tradeoff_plot import write_plot

    table, plot = (options.output / f"tradeoff.{kind}" for kind in ("csv", "png"))
    lens = chosen_lens(options)
    pictures, spectral = _tradeoff_pictures(options, lens)
    check_outputs([(table, ".csv"), (plot, ".png")], filter(None, (options.lens, options.image)))
    try:
        with progress_bar() as on_progress:
            rows = measure(lens, pictures, spectral, quick=options.quick, progress=on_progress)
    except ImageError as error:
        raise error.at(options.image or error.where) from None
    write_table(rows, table)
    write_plot(rows, plot, description(lens, pictures))
    say(table, plot)


def _tradeoff_pictures(options, lens):
    """The test pictures by name, and one of them by its number of wavelengths."""
    from lensfield.engine.inspection.tradeoff import DEFAULT_SHAPE_PX, cropped_frame, standard_pictures, thinned
    from lensfield.engine.pictures.spectral_exr import read_exr

    shape_px = resolution(options.size, "--size")[::-1] if options.size else None
    if not options.image:
        return standard_pictures(lens, shape_px or DEFAULT_SHAPE_PX, options.pitch_um)
    with quiet(1, 2):
        radiance = read_exr(options.image, options.pitch_um)
    if shape_px:
        radiance = cropped_frame(radiance, lens, shape_px)
    return {options.image.stem: radiance}, thinned(options.image.stem, radiance)
