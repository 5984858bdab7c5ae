"""Each public call that takes a plan, a trajectory, movers or places has a law over draws of them."""

import inspect
import re
from contextlib import suppress

import cspace
import planners
from cspace import lanes
from tests.laws.test_any_plan import LAWS

TAKEN = re.compile(r"\b(Plan|Trajectory|Mover|PlaceLike)\b")
"""Types of parameters of which tests/helpers/any_plan.py has draws."""

OWNERS = planners.Plan, planners.Trajectory
"""Classes whose methods take one of these as their ``self``."""


def list_calls():
    """Yield the names of calls that need a law."""
    for module in (cspace, planners, lanes):
        for name in module.__all__:
            value = getattr(module, name)
            path = f"{module.__name__}.{name}"
            members = vars(value) if inspect.isclass(value) else ()
            methods = [
                each for each in members if callable(getattr(value, each)) and each[0] != "_"
            ]
            if value in OWNERS:
                yield from (f"{path}.{each}" for each in methods)
                continue
            calls = {path: value} if callable(value) else {}
            calls |= {f"{path}.{each}": getattr(value, each) for each in methods}
            for path, call in calls.items():
                with suppress(ValueError):  # classes without a signature
                    parameters = inspect.signature(call).parameters.values()
                    if any(TAKEN.search(str(each.annotation)) for each in parameters):
                        yield path


def test_each_call_that_takes_plans_or_movers_has_a_law():
    calls = set(list_calls())
    assert calls >= {"planners.plan", "planners.Plan.recheck", "cspace.lanes.time_around"}
    assert calls == LAWS.keys()
