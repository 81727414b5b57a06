"""How signatures are checked under pytest: an int may stand for a float, as everywhere in Python's type system.

``--jaxtyping-packages`` decorates each function with ``jaxtyping.jaxtyped``. This binds the arguments to the signature,
checks them, calls the function, and checks them once more with what it returned, which took a third of the time of
tests that compute. So ``jaxtyped`` is replaced here. What takes its place checks each argument and what is returned
once, in one context of jaxtyping: an axis of one name has one size in all of them.
"""

import functools
import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from types import FunctionType, SimpleNamespace
from typing import Any, get_type_hints

import jaxtyping
from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True, violation_type=jaxtyping.TypeCheckError))
_by_jaxtyping: Callable[..., Any] = jaxtyping.jaxtyped


def jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    """Decorates functions and dataclasses. The import hook calls it; the type checker is always ``check``."""

    def decorated(target: Any) -> Any:
        if inspect.isclass(target):
            init = vars(target).get("__init__")
            if is_dataclass(target) and inspect.isfunction(init) and not hasattr(init, "__wrapped__"):
                target.__init__ = _checked(init)
            return target
        if inspect.isfunction(target) and not inspect.isgeneratorfunction(target):
            return _checked(target)
        return _by_jaxtyping(target, typechecker=typechecker)

    return decorated


def _checked(function: FunctionType) -> Callable[..., Any]:
    checked: Callable[..., Any] | None = None

    @functools.wraps(function)
    def in_context(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        nonlocal checked
        if checked is None:  # most of what a test imports it never calls, and this takes milliseconds
            checked = _with_checks(function)
        with _by_jaxtyping("context"):
            return checked(*args, **kwargs)

    return in_context


def _with_checks(function: FunctionType) -> Callable[..., Any]:
    twin = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    functools.update_wrapper(twin, function)
    del twin.__wrapped__
    twin.__kwdefaults__ = function.__kwdefaults__
    twin.__annotations__ = {name: _resolved(hint, function) for name, hint in function.__annotations__.items()}
    return check(twin)


def _resolved(hint: Any, function: FunctionType) -> Any:
    """The hint, or ``Any`` if it names what is not defined at run time, as jaxtyping does."""
    holder = SimpleNamespace(__annotations__={"hint": hint})
    try:
        return get_type_hints(holder, function.__globals__, include_extras=True)["hint"]
    except (NameError, TypeError):
        return Any


jaxtyping.jaxtyped = jaxtyped
