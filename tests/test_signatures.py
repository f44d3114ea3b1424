"""What `rpctl` exports is called so that a call reads: what is an option is given by its name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from inspect import Parameter
from typing import Any

import pytest

import rpctl

MOST = 3  # arguments that a reader of a call can tell apart by their places


def callables(name: str, exported: Any) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield what is exported, and the public methods of a class; a row unpacks as it is made."""
    row = hasattr(exported, "_fields")
    if not row and exported is not rpctl.RpctlError:
        yield name, exported
    for method, member in vars(exported).items() if inspect.isclass(exported) and not row else ():
        function = getattr(member, "__func__", member)
        if inspect.isfunction(function) and not method.startswith("_"):
            yield f"{name}.{method}", function


def places(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters that may be given by their places."""
    named = (Parameter.KEYWORD_ONLY, Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL)
    every = inspect.signature(function).parameters.values()
    return [each for each in every if each.kind not in named and each.name not in ("self", "cls")]


@pytest.mark.parametrize("name", rpctl.__all__)
def test_options_are_given_by_name(name: str) -> None:
    for called, function in callables(name, getattr(rpctl, name)):
        beyond = places(function)[MOST:]
        assert not [each.name for each in beyond if each.default is not Parameter.empty], called
        # A state is (q, nu, tau): what has no default and is always given may have its place.
        assert len(beyond) <= 1, called


@pytest.mark.parametrize(
    "function", [rpctl.track, rpctl.rollout, rpctl.Controller, rpctl.derive_law]
)
def test_what_takes_laws_takes_a_config(function: Callable[..., Any]) -> None:
    assert "config" in inspect.signature(function).parameters
