# make corridor: set up, and run the main job.   make test: set up, and check everything.
# make study: set up, and make the paper's study: frames, networks, tables and figures.
PYTHON ?= python3
BIN := .venv/bin

INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e

# What of the study is trained: all of it, reduced to what 2 cores do in two or three hours. With a GPU:
# make study STUDY='--preset paper --epochs 2 --batch 32 --bf16 --minutes 20'
STUDY ?= --preset short
OUT ?= results/study

.PHONY: setup corridor study test clean

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

# Each command goes on where it was; tables and figures are of what is trained by then.
study: setup
	$(BIN)/python -m predictor.dataset
	$(BIN)/python -m predictor.study $(STUDY) --out $(OUT); failed=$$?; [ $$failed -le 1 ] && \
	$(BIN)/python -m benchmarks.prediction --predictors none extend compact compact-logs compact-paper $(OUT) --out $(OUT)/prediction && \
	exit $$failed

test: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n 2

clean:
	rm -rf .venv results
