"""Cache of plans, in the process and on disk: choosing a plan takes as long as filtering a small picture."""

import json
from dataclasses import asdict

from ..blur import METHODS, OnePsf
from ..image.sampling import Sampling
from ..lens.lens import Lens
from ..runtime import cache
from ..runtime.values import check_types, digest_of
from .choose import make_plan, priced
from .options import Options
from .plan import Plan

KIND, MOST_BYTES, MOST_IN_PROCESS = "plans", 2**20, 64
_plans: dict[bytes, Plan] = {}


def cached_plan(options: Options, lens: Lens, sampling: Sampling, known: int = 1) -> Plan:
    """The result of `make_plan`, cached for each sampling; its seconds are always predicted anew."""
    if cache.is_off():
        return make_plan(options, lens, sampling, known)
    key = digest_of((options, lens.digest.hex(), sampling.grid, sampling.wavelengths_nm, known))
    cached = _plans.get(key)
    plan = priced(cached, lens, sampling) if cached else cache.load(
        KIND, key, lambda content: priced(_from_text(content), lens, sampling))
    if plan is None:
        plan = make_plan(options, lens, sampling, known)
        cache.store(KIND, key, _as_text(plan), MOST_BYTES)
    _plans[key] = plan
    for oldest in list(_plans)[:-MOST_IN_PROCESS]:
        _plans.pop(oldest, None)  # another thread may have removed it
    return plan


def _as_text(plan):
    return json.dumps(asdict(plan) | {"method": plan.method.name, "knobs": asdict(plan.method)}, indent=1,
                      default=lambda number: number.item()).encode()


def _from_text(content):
    facts = json.loads(content)
    kind = next(each for each in (*METHODS.values(), OnePsf) if each.name == facts["method"])
    plan = Plan(**facts | {"method": kind(**facts.pop("knobs"))})
    for value in (plan, plan.method):
        check_types(value)
    return plan
