"""Outputs have the bytes that were recorded: see `outputs.py`."""

import json

import outputs
import pytest

RECORDED = json.loads(outputs.PINS.read_text())


def _pins(exact: bool) -> dict[str, str]:
    pins = {name: pin for name, pin in RECORDED["pins"].items() if name.startswith(outputs.EXACT) == exact}
    assert pins
    return pins


def test_texts_and_file_formats_are_as_recorded():
    assert outputs.differences(outputs.exact_outputs(), _pins(exact=True)) == []


def test_all_else_is_as_recorded_on_the_same_machine():
    here, there = outputs.machine(), RECORDED["machine"]
    other = [f"{name} is {here.get(name)}, was {there[name]}" for name in there if here.get(name) != there[name]]
    if other:
        pytest.skip(f"bytes of dense linear algebra hold for one machine: {'; '.join(other)}")
    assert outputs.differences(outputs.computed_outputs(), _pins(exact=False)) == []
