"""Which options name files that are read, and which ones that are written: no command may write over what it reads.

A command marks its options by their types, such as `output: OutputFile`; all of them are checked before it runs.
"""

from __future__ import annotations

import errno
import functools
import inspect
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

from diffprt.cli.batch import items, report_files
from diffprt.errors import InputError
from diffprt.scene.named_files import FOLDER_INPUTS, named_files
from diffprt.whole_file import check_target, keeping

_REPORT, _REMOVED = ".json", ".parts"


@dataclass(frozen=True)
class Role:
    """What a command does with the files that an option names.

    Attributes:
        writes: it writes them, else it reads them.
        folder: what is written is a folder, or may be.
        beside: endings of what else it writes, to the name of the output.
        each: ending of the file that it writes for each of its `source`, in a folder where they are several; ".json"
            for their reports.
    """

    writes: bool
    folder: bool = False
    beside: tuple[str, ...] = ()
    each: str = ""


READS = Role(False)
InputFile = Annotated[Path, READS]
InputFiles = Annotated[list[Path], READS]
# A path, or the name of what is built in; a list of them separated by commas; NAME=PATH.
InputName = Annotated[str, READS]
InputNames = Annotated[list[str], READS]
OutputFile = Annotated[Path, Role(True)]
OutputFolder = Annotated[Path, Role(True, folder=True)]
OutputAssets = Annotated[str, Role(True, each=".prt")]
AssetsWithParts = Annotated[str, Role(True, beside=(_REMOVED,), each=".prt")]
OutputReports = Annotated[Path, Role(True, each=_REPORT)]
OutputWithCheckpoint = Annotated[Path, Role(True, beside=(".checkpoint",))]


def roles_of(run: Callable[..., None]) -> dict[str, Role]:
    """The roles of a command's parameters, of those that have one."""
    found = {}
    for name, parameter in inspect.signature(run, eval_str=True).parameters.items():
        role = next((part for part in get_args(parameter.annotation) if isinstance(part, Role)), None)
        if role is not None:
            found[name] = role
    return found


def with_checked_paths(run: Callable[..., None]) -> Callable[..., None]:
    """A command that refuses, before any work, names that cannot be and outputs that are inputs or each other."""
    parameters = inspect.signature(run, eval_str=True).parameters
    roles = roles_of(run)
    labels = {name: _label(name, parameters[name].default) for name in parameters}

    @functools.wraps(run)
    def checked(**given: Any) -> None:
        for name, value in given.items():
            for text in _texts(value):
                _check_text(labels[name], text)
        inputs, outputs = [], []
        for name, role in roles.items():
            for text in _texts(given.get(name)):
                if not role.writes:
                    inputs += [(labels[name], path) for path in _paths_in(text)]
            for path in _written(role, given.get(name), given) if role.writes else ():
                beside = [path.with_name(f"{path.name}{ending}") for ending in role.beside if path.name]
                check_target(path, labels[name], folder=role.folder)
                outputs.append((labels[name], path))
                for other in beside:
                    label = f"what {labels[name]} keeps beside it,"
                    check_target(other, label, folder=True)
                    outputs.append((label, other))
        with keeping(check_paths(inputs, outputs)):
            run(**given)

    return checked


def _written(role: Role, value: Any, given: dict[str, Any]) -> list[Path]:
    """The files that an output stands for; standard output is none."""
    texts = [text for text in _texts(value) if text != "-"]
    if not role.each or not texts:
        return [Path(text) for text in texts]
    if role.each == _REPORT:
        return report_files(items(given["source"], given["output"], ".prt"), Path(texts[0]))
    return [item.target for item in items(given["source"], texts[0], role.each)]


def check_paths(inputs: list[tuple[str, Path]], outputs: list[tuple[str, Path]]) -> dict[Path, str]:
    """Refuses outputs that are inputs, or files that inputs name, or each other, by whatever names.

    Args:
        inputs, outputs: options and what they name.

    Returns:
        All that is read, with what it is; complete where outputs are there already.

    Raises:
        InputError: two of them are the same.
    """
    read = {path: f"{label} {path}" for label, path in inputs}
    if any(path.exists() for _, path in outputs):
        for label, path in inputs:
            for other in _beside(path):
                read.setdefault(other, f"a file of {label} {path}")
    own = {_identity(path): what for path, what in read.items()}
    for index, (label, path) in enumerate(outputs):
        if (what := own.get(_identity(path))) is not None:
            raise InputError(f"{label} {path} is also {what}, which is read: give another name to write to")
        for other_label, other in outputs[:index]:
            _check_pair(label, path, other_label, other)
    for folder in (path for _, path in outputs if path.name.endswith(_REMOVED)):
        for label, path in inputs:
            if _inside(path, folder):
                raise InputError(f"{label} {path} lies in {folder}, which is removed at the end: move it")
    return read


def _check_pair(label: str, path: Path, other_label: str, other: Path) -> None:
    if _identity(path) == _identity(other):
        raise InputError(f"{label} {path} is also {other_label} {other}: give two names")
    for (inner_label, inner), (outer_label, outer) in (
        ((label, path), (other_label, other)),
        ((other_label, other), (label, path)),
    ):
        # Reports may lie in a folder of results, where no result is called so.
        allowed = not outer.name.endswith(_REMOVED) and inner.suffix.lower() == _REPORT
        if _inside(inner, outer) and not (allowed and inner.name not in FOLDER_INPUTS):
            raise InputError(f"{inner_label} {inner} lies in {outer_label} {outer}: write it elsewhere")


def _label(name: str, default: Any) -> str:
    """What a parameter is called where it is given."""
    flags = [flag for flag in getattr(default, "param_decls", None) or () if flag.startswith("--")]
    if type(default).__name__ == "ArgumentInfo":
        return (default.metavar or name.upper()).strip("[].")
    return flags[0].partition("/")[0] if flags else f"--{name.replace('_', '-')}"


def _texts(value: Any) -> list[str]:
    values = value if isinstance(value, list | tuple) else [value]
    return [str(part) for part in values if isinstance(part, str | os.PathLike)]


def _check_text(label: str, text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        shown = text.encode("utf-8", "backslashreplace").decode()
        raise InputError(f"{label} {shown} is not UTF-8: rename the file, or give another text") from None


def _paths_in(text: str) -> Iterator[Path]:
    """The paths that a text may name, of those that exist."""
    for part in dict.fromkeys((text, text.partition("=")[2], *text.split(","))):
        try:
            path = Path(part.strip())
            os.stat(path)
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG and part == text and "," not in text:
                raise InputError(f"{text[:60]}... is too long for the name of a file: give a shorter one") from None
            continue
        if part.strip():
            yield path


def _beside(path: Path) -> list[Path]:
    """What is read with an input: files that a scene names, or the files of a folder of pictures or meshes."""
    try:
        return named_files(path)
    except (OSError, ValueError):
        return []


def _identity(path: Path) -> tuple:
    """The same for all names of a file: links, hard links, ".", and case where the file system ignores it."""
    resolved = Path(os.path.realpath(path))
    try:
        found = os.stat(resolved)
        return found.st_dev, found.st_ino
    except OSError:
        pass
    folder = resolved.parent
    if not folder.exists():
        return (*_identity(folder), resolved.name) if folder != resolved else (str(resolved),)
    swapped = folder.with_name(folder.name.swapcase())
    ignores_case = swapped != folder and swapped.exists() and os.path.samefile(swapped, folder)
    found = os.stat(folder)
    return found.st_dev, found.st_ino, resolved.name.casefold() if ignores_case else resolved.name


def _inside(path: Path, folder: Path) -> bool:
    wanted = _identity(folder)
    return any(_identity(parent) == wanted for parent in Path(os.path.realpath(path)).parents)
