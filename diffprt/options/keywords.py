"""Functions that take the fields of an options class as keywords, so that options are listed once: in the class."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
Subject, Options, Result = TypeVar("Subject"), TypeVar("Options"), TypeVar("Result")


def takes(
    options: Callable[P, Options],
) -> Callable[[Callable[[Subject, Options], Result]], Callable[Concatenate[Subject, P], Result]]:
    """Turns f(subject, options) into f(subject, *, a keyword for every field of `options`).

    The result's signature names them all, for people (`help`) and for type checkers.
    """
    fields = inspect.signature(options).parameters.values()

    def decorate(function: Callable[[Subject, Options], Result]) -> Callable[Concatenate[Subject, P], Result]:
        own = inspect.signature(function)
        name = next(iter(own.parameters))
        signature = own.replace(parameters=[own.parameters[name], *fields])

        @functools.wraps(function)
        def called(*arguments: object, **keywords: object) -> Result:
            given = signature.bind(*arguments, **keywords).arguments
            return function(given.pop(name), options(**given))

        called.__signature__ = signature
        return called

    return decorate
