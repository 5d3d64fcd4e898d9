"""`lensfield lens`: what lens data hold, and where they come from."""

import json

from ..engine import Lens
from ..engine.lens_files import bundled_names
from ..engine.lens_info import lens_info, lens_text


def add(commands):
    lens = commands.add_parser("lens", help="about lenses").add_subparsers(required=True, metavar="COMMAND")
    info = lens.add_parser("info", help="first-order data, distortion, relative illumination, lateral colour")
    info.add_argument("lens", metavar="NAME|FILE")
    info.add_argument("--json", action="store_true", help="as JSON")
    info.set_defaults(run=_info)
    listing = lens.add_parser("list", help="names of the bundled lenses")
    listing.set_defaults(run=lambda _: print("\n".join(bundled_names())))


def _info(options):
    info = lens_info(Lens.load(options.lens))
    print(json.dumps(info, indent=2) if options.json else lens_text(info))
