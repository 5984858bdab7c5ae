"""Each public call takes True or False for an option that is one, and nothing else."""

import dataclasses
import inspect

import pytest

import cspace
import cspace.arms
import cspace.lanes
import cspace.plot
import cspace.reasons
import cspace.regions
import cspace.spectral
import planners
from cspace import InputError

MODULES = (
    *(cspace, planners, cspace.arms, cspace.lanes, cspace.plot),
    *(cspace.reasons, cspace.regions, cspace.spectral),
)

INNER = {"check_endpoint", "find_goals", "check_origin", "warn_if_open"}
"""Methods that the library itself calls, with what it has checked."""


def list_functions():
    """List public functions and methods by their names; constructors of records check nothing."""
    for module in MODULES:
        names = getattr(module, "__all__", [name for name in vars(module) if name[0] != "_"])
        for name, value in ((name, getattr(module, name)) for name in names):
            if not isinstance(value, type):
                yield name, value
                continue
            for inner in dir(value):
                is_maker = inner == "__init__" and not dataclasses.is_dataclass(value)
                if (is_maker or inner[0] != "_") and inner not in INNER:
                    yield f"{name}.{inner}", getattr(value, inner)


def list_flags():
    """List the options that are True or False, with the function of each, once."""
    found = {}
    for name, value in list_functions():
        if inspect.isroutine(value) and hasattr(value, "__annotations__"):
            function = getattr(value, "__func__", value)
            for option, kind in function.__annotations__.items():
                if kind == "bool" and option != "return":
                    found.setdefault((function, option), (name, value))
    return [(*found[key], key[1]) for key in found]


FLAGS = list_flags()


@pytest.mark.parametrize("name, call, flag", FLAGS, ids=[f"{n}-{flag}" for n, _, flag in FLAGS])
def test_options_that_are_true_or_false_are_nothing_else(name, call, flag):
    needed = [
        None
        for parameter in inspect.signature(call).parameters.values()
        if parameter.default is parameter.empty and parameter.kind < parameter.VAR_POSITIONAL
    ]
    with pytest.raises(InputError, match=r"must be True or False") as caught:
        call(*needed, **{flag: "no"})
    assert caught.value.argument == flag
