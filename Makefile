# make corridor: set up, and run the main job.   make test: set up, and check everything.
PYTHON ?= python3
BIN := .venv/bin

INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e

.PHONY: setup corridor test clean

setup: .venv/.tools

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
	$(PYTHON) -m venv .venv
	$(INSTALL) '.[openvino]'
	touch $@

.venv/.tools: .venv/.installed
	$(INSTALL) '.[dev,dask,bags]'
	touch $@

# Driving needs no more than this.
corridor: .venv/.installed
	$(BIN)/python -m benchmarks.corridor

test: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2

clean:
	rm -rf .venv results
