"""Functions that take the fields of an options class as keywords, so that options are listed once: in the class."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

P = ParamSpec("P")
# One a line: type checkers know no others in an installed package.
Subject = TypeVar("Subject")
Place = TypeVar("Place")
Result = TypeVar("Result")
Options = TypeVar("Options", contravariant=True)


class Taking(Protocol, Generic[P, Options]):
    """What `takes` returns: a decorator of functions of one or two arguments beside the options."""

    @overload
    def __call__(
        self, function: Callable[[Subject, Options], Result], /
    ) -> Callable[Concatenate[Subject, P], Result]: ...
    @overload
    def __call__(
        self, function: Callable[[Subject, Place, Options], Result], /
    ) -> Callable[Concatenate[Subject, Place, P], Result]: ...


def takes(options: Callable[P, Options]) -> Taking[P, Options]:
    """Turns f(subject, ..., options) into f(subject, ..., *, a keyword for every field of `options`).

    The result's signature and docstring name them all, for people (`help`) and for type checkers. An object of the
    class, or of one that it extends, may stand in place of the keywords, or before some that replace its own.
    """
    keywords = inspect.signature(options).parameters.values()

    def decorate(function: Callable) -> Callable:
        own = inspect.signature(function)
        *leading, _ = own.parameters.values()
        base = tuple(kind for kind in options.__mro__ if is_dataclass(kind))
        signature = own.replace(parameters=[*leading, *keywords])

        @functools.wraps(function)
        def called(*arguments: object, **named: object) -> object:
            if len(arguments) == len(leading) + 1 and isinstance(arguments[-1], base):
                *arguments, whole = arguments
                named = {**vars(whole), **named}
            given = signature.bind(*arguments, **named).arguments
            subjects = [given.pop(parameter.name) for parameter in leading]
            return function(*subjects, options(**given))

        called.__signature__ = signature
        called.__doc__ = f"{inspect.getdoc(function)}\n\nOptions:\n{_help(options)}"
        return called

    return decorate


def _help(options: Callable) -> str:
    """A line for each field."""
    return "\n".join(f"    {f.name}: {f.metadata['help']}" for f in fields(options) if "help" in f.metadata)
