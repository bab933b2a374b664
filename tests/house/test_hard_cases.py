"""Hard cases that tests and sources cite are listed in docs/hard_cases.md, which names tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CITED = re.compile(r"\bhard cases? (\d+(?:(?:, and |, | and | to )\d+)*)", re.IGNORECASE)

pytestmark = pytest.mark.checkout


def rows() -> dict[int, str]:
    page = (ROOT / "docs" / "hard_cases.md").read_text("utf-8")
    return {int(n): row for n, row in re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE)}


def test_numbers_have_no_gap():
    assert list(rows()) == list(range(1, 46))


def test_every_case_has_an_answer_and_a_test_or_says_who_brings_one():
    for number, row in rows().items():
        case, answer, tests = (part.strip() for part in row.split(" | "))
        assert case and answer, number
        named = re.findall(r"`(tests/[^`]+)`", tests)
        assert named or "not yet" in tests, number
        for name in named:
            assert (ROOT / name).is_file(), f"hard case {number} names {name}"


def test_what_is_cited_is_listed_and_names_its_test():
    cited = 0
    for folder in ("tests", "diffprt", "kernels"):
        for path in (ROOT / folder).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            if "node_modules" in name or path == Path(__file__):
                continue
            for numbers in CITED.findall(path.read_text("utf-8")):
                for number in spread(numbers):
                    cited += 1
                    assert number in rows(), f"{name} cites hard case {number}"
                    assert folder != "tests" or f"`{name}`" in rows()[number], f"hard case {number} names not {name}"
    assert cited > 60


def spread(numbers: str) -> set[int]:
    """The numbers of "1, and 26" and of "22 to 25, 28"."""
    found = {int(n) for n in re.findall(r"\d+", numbers)}
    for first, last in re.findall(r"(\d+) to (\d+)", numbers):
        found |= set(range(int(first), int(last) + 1))
    return found
