"""Plans are remembered, in the process and on disk: making one takes as long as filtering a small picture."""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from .. import cache
from ..blur import METHODS, OnePsf
from ..image.spectral_image import SpectralImage
from ..values import digest_of
from .choose import make_plan, priced
from .options import Options
from .plan import Plan

if TYPE_CHECKING:
    from ..lens.lens import Lens

KIND, MOST_BYTES, MOST_IN_PROCESS = "plans", 2**20, 64
ROOMS = "blur", "field", "image", "plan"  # whose code makes plans
_plans: dict[bytes, Plan] = {}


def remembered_plan(options: Options, lens: "Lens", radiance: SpectralImage) -> Plan:
    """What `make_plan` gives, made once for pictures of the same grid and wavelengths; its seconds are always anew."""
    if cache.is_off():
        return make_plan(options, lens, radiance)
    key = digest_of((cache.code_version(*ROOMS), options, lens.digest.hex(), radiance.grid,
                     tuple(radiance.wavelengths_nm)))
    found = _plans.get(key) or _recalled(key)
    plan = priced(found, lens, radiance) if found else make_plan(options, lens, radiance)
    if not found:
        cache.remember(KIND, key, _as_text(plan), MOST_BYTES)
    _plans[key] = plan
    for oldest in list(_plans)[:-MOST_IN_PROCESS]:
        _plans.pop(oldest, None)  # which another thread may have done
    return plan


def _recalled(key):
    content = cache.recall(KIND, key)
    return None if content is None else _from_text(content)


def _as_text(plan):
    return json.dumps(asdict(plan) | {"method": plan.method.name, "knobs": asdict(plan.method)}, indent=1,
                      default=lambda number: number.item()).encode()


def _from_text(content):
    facts = json.loads(content)
    kind = next(each for each in (*METHODS.values(), OnePsf) if each.name == facts["method"])
    return Plan(**facts | {"method": kind(**facts.pop("knobs"))})
