"""`lensfield filter`: a spectral radiance EXR, put through a lens."""

from pathlib import Path

from ..engine import ImageError, Kept, Lens, Report, simulate
from .arguments import add_engine_options, check_targets, engine_options
from .outcome import finish, plan_text
from .terminal import progress_bar, quiet


def add(commands):
    filter_ = commands.add_parser("filter", help="put a spectral radiance EXR through a lens")
    filter_.add_argument("radiance", type=Path, metavar="RADIANCE.exr")
    filter_.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor, for a file that does not tell it")
    filter_.add_argument("--output", type=Path, required=True, metavar="IRRADIANCE.exr")
    filter_.add_argument("--preview", type=Path, metavar="FILE.png", help="also write an sRGB picture")
    add_engine_options(filter_)
    filter_.set_defaults(run=_filter)


def _filter(options):
    from ..engine.colour import auto_exposure, to_rec709, write_png
    from ..engine.exr import read_exr, write_exr

    report, kept = Report(), Kept(limit_mb=0)  # there is no second picture to keep anything for
    lens = Lens.load(options.lens)
    chosen = engine_options(options)
    check_targets(options.output, options.preview, options.report)
    with report.stage("read radiance"), quiet(1, 2):  # of damage the EXR library tells at length
        radiance = read_exr(options.radiance, options.pitch_um)
    try:
        with report.stage("plan"):
            print(f"plan: {plan_text(kept.plan(chosen, lens, radiance).as_dict())}", flush=True)
        with progress_bar() as tell:
            irradiance = simulate(radiance, lens, chosen, report=report, kept=kept,
                                  progress=lambda done: tell(done, f"Through {lens.name}"))
    except ImageError as error:
        raise ImageError(options.radiance, error.field, error.value, error.remedy) from None
    with report.stage("write irradiance"):
        write_exr(irradiance, options.output)
    if options.preview:
        with report.stage("write preview"):
            picture = to_rec709(irradiance)
            write_png(picture, options.preview, auto_exposure(picture))
    finish(options, report, [path for path in (options.output, options.preview) if path])
