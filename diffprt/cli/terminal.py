"""What reaches a terminal: plain text, whatever names files hold; and standard output, where a report asks for it."""

from __future__ import annotations

import builtins
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

# Controls, what turns the direction of text or hides in it, and bytes of file names that are no UTF-8.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)
_BREAK = re.compile("[\t\n]")
_LONG = re.compile(r"\S{400,}")
_KEPT = 200


def neutral(text: str) -> str:
    """`text` in one line, with escapes in place of characters that steer a terminal."""
    return _BREAK.sub(_escaped, _CONTROL.sub(_escaped, text))


def one_line(message: str) -> str:
    """A message as one line; names of hundreds of characters are cut in their middle."""
    return _LONG.sub(lambda found: f"{found[0][:_KEPT]}...{found[0][-80:]}", neutral(" ".join(message.split())))


def _escaped(found: re.Match[str]) -> str:
    code = ord(found[0])
    if 0xDC80 <= code <= 0xDCFF:
        return f"\\x{code - 0xDC00:02x}"
    return found[0].encode("unicode_escape", "surrogatepass").decode("ascii")


class Neutral:
    """A stream that writes no character which steers a terminal; lines stay lines.

    Attributes:
        beneath: the stream that it writes to, for what draws on a terminal itself.
    """

    def __init__(self, beneath: TextIO) -> None:
        self.beneath = beneath

    def write(self, text: str) -> int:
        plain = _CONTROL.sub(_escaped, text)
        try:
            self.beneath.write(plain)
        except UnicodeEncodeError:
            encoding = self.beneath.encoding or "ascii"
            self.beneath.write(plain.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.beneath, name)


class _Document:
    """Standard output while it is kept for one document."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.written = stream, False


_reserved: list[_Document] = []


@contextmanager
def streams(*, document: bool = False) -> Iterator[None]:
    """Standard output and error are neutral inside; with `document` what people read goes to standard error, and
    standard output takes what `write_document` is given."""
    out, err, formatted = sys.stdout, sys.stderr, warnings.formatwarning
    sys.stderr = Neutral(err)
    sys.stdout = sys.stderr if document else Neutral(out)
    warnings.formatwarning = lambda message, *place, **rest: f"note: {one_line(str(message))}\n"
    if document:
        _reserved.append(_Document(out))
    try:
        yield
    finally:
        sys.stdout, sys.stderr, warnings.formatwarning = out, err, formatted
        if document:
            _reserved.pop()


def write_document(text: str) -> None:
    """Writes a whole document to standard output."""
    target = _reserved[-1] if _reserved else _Document(sys.stdout)
    target.stream.write(text)
    target.stream.flush()
    target.written = True


def awaits_document() -> bool:
    """Whether standard output is kept for a document that was not written yet."""
    return bool(_reserved) and not _reserved[-1].written


def beneath(stream: Any) -> TextIO:
    """The stream that draws on a terminal: what is drawn must be neutral itself."""
    return getattr(stream, "beneath", stream)


def print(*values: object, file: Any = None, flush: bool = False) -> None:
    """Prints one line, as the built-in function does; a line break in a name is shown, not followed."""
    builtins.print(neutral(" ".join(map(str, values))), file=file, flush=flush)
