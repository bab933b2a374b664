PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint notebooks clean

demo: .venv/installed
	$(BIN)/diffprt demo -o demo

test: .venv/installed
	$(BIN)/python -m pytest

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

notebooks: .venv/installed
	$(BIN)/python -m pytest tests/notebooks

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -c constraints.txt -e ".[dev]"
	touch $@

clean:
	rm -rf .venv build dist *.egg-info demo out
