PYTHON ?= python3
BIN := .venv/bin

# Two or more workers; a worker that runs out of tests takes some of another's.
PARALLEL := -n logical --maxprocesses 8 --dist worksteal

.PHONY: demo test test-all lint notebooks clean

demo: .venv/installed
	$(BIN)/diffprt demo -o demo

test: .venv/installed
	$(BIN)/python -m pytest $(PARALLEL) -m "not slow"

test-all: .venv/installed
	$(BIN)/python -m pytest $(PARALLEL)

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	mkdir -p build/types/diffprt
	ln -sfn ../../../kernels build/types/diffprt/kernels
	$(BIN)/basedpyright --pythonpath $(BIN)/python

notebooks: .venv/installed
	$(BIN)/python -m pytest tests/notebooks

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -c constraints.txt -e ".[dev]"
	touch $@

clean:
	rm -rf .venv build dist *.egg-info demo out
