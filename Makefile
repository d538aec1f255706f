# make corridor: set up, and make a first comparison.   make test: set up, and check everything.
# make study: set up, and make the paper's study: frames, networks, tables and figures.
# make beyond: the same, and what goes beyond the paper.
# make pictures: make the first comparison, and draw the pictures of the pages from it.
# make release: build the package and try it, without uploading it.
# make docs: set up, and build the documentation as a site in build/site; any warning fails.
PYTHON ?= python3
BIN := .venv/bin

# Python compiles a module when it is first imported; most of the installed ones never are.
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e

# What the paper's networks are, and how they learn: reduced to what 2 cores do in about two hours. With a GPU:
# make study NET='--preset paper --sigma 0.02 --epochs 3 --batch 8 --rate 4e-4 --bf16' STUDY='--jobs 15'
NET ?= --preset short
STUDY ?=
OUT ?= results/study

.PHONY: setup corridor pictures study beyond docs test check compiled release clean

setup: .venv/.tools

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
	$(PYTHON) -m venv .venv
	$(INSTALL) '.[openvino]'
	touch $@

.venv/.tools: .venv/.installed
	$(INSTALL) '.[dev,dask,bags,gym,rl,onnx,completion,video]'
	touch $@

# ROS 2, of which there are wheels for some systems only: elsewhere its tests are skipped.
.venv/.ros2: .venv/.tools
	$(INSTALL) '.[ros2]' || echo "the wheels of ROS 2 do not install here: tests/ros2 skips what needs them"
	touch $@

.venv/.docs: .venv/.installed
	$(INSTALL) '.[docs]'
	touch $@

# Driving needs no more than this.
corridor: .venv/.installed
	$(BIN)/python -m benchmarks.corridor --route fixed --arms known,backup,predicted,oracle --risk 0 0.02 \
	    $(addprefix --optimum ,$(wildcard docs/results/optimum-corridor.json)) --out results/first

# Episode 6 races: its time ratios are near the means of the table, and its building is small.
PICTURES = first_comparison=speed_profile.png first_trajectories=trajectories.png moment=moment.png \
    race=race-6.gif race=race-6.mp4

pictures: corridor .venv/.tools
	for format in gif mp4; do \
	    $(BIN)/python -m benchmarks.plot results/first --episode 6 --race --format $$format || exit; done
	for of in $(PICTURES); do \
	    cp results/first/$${of#*=} docs/images/$${of%=*}.$${of##*.} || exit; done

TRAIN_ALL = $(BIN)/python -m predictor.study $(NET) $(STUDY) --out $(OUT)

# Each command goes on where it was; tables and figures are of what is trained by then.
study: setup
	$(BIN)/python -m predictor.dataset
	$(TRAIN_ALL); failed=$$?; [ $$failed -le 1 ] && \
	$(BIN)/python -m benchmarks.studies.katyal2018 --predictors none extend compact $(OUT) compact-logs compact-paper --out $(OUT)/prediction && \
	exit $$failed

# Beyond the paper: the same U-Net on other data, on compact's own buildings with the crop alone and with
# all that was seen, all five in one; and compact as it grew. In data/ and results/study-beyond; an
# hour more.
CHANGED = clutter noise people all-three
BEYOND = $(OUT)-beyond
UNET = $(BIN)/python -m predictor.train --arch unet_ff --expansion 1.3 --jobs 1 $(NET)
GREW = 600:e680078 2000:7245892 2440:7d2b9ad^

# First what may fail. The epochs are such that, with --preset short, all learn from as many samples.
beyond: setup
	mkdir -p $(BEYOND)
	for of in $(GREW); do file=$(BEYOND)/$${of%:*}-drives.safetensors; \
	    [ -f $$file ] || { git show $${of#*:}:predictor/compact.safetensors > $$file.part && mv $$file.part $$file; } || { \
	    echo "the older weights of compact are in the history: git fetch --unshallow"; exit 1; }; done
	$(BIN)/python -m predictor.dataset
	$(TRAIN_ALL)
	$(BIN)/python -m predictor.dataset --clutter 0.15 --out data/clutter
	$(BIN)/python -m predictor.dataset --noise 0.03 --out data/noise
	$(BIN)/python -m predictor.dataset --people 0.03 --out data/people
	$(BIN)/python -m predictor.dataset --clutter 0.15 --noise 0.03 --people 0.03 --out data/all-three
	$(BIN)/python -m predictor.drives --simulated-logs 1 --train 75 --validation 10 --out data/few-logs
	$(BIN)/python -m predictor.drives --train 125 --validation 15 --out data/few-drives
	for of in $(CHANGED); do $(UNET) --data data/$$of --out $(BEYOND)/$$of || exit; done
	$(UNET) --sigma 0.2 --out $(BEYOND)/sigma-0.2
	$(UNET) --data data/few-logs --epochs 1.97 --out $(BEYOND)/logs
	for given in crop window; do for x in 1.3 2.0; do \
	    $(UNET) --data data/few-drives --epochs 3.7 --expansion $$x --given $$given \
	        --out $(BEYOND)/$$given/$$x || exit; done; done
	$(BIN)/python -m benchmarks.studies.katyal2018 --out $(OUT)/prediction --predictors none extend compact \
	    $(OUT) compact-logs compact-paper fused-unet=fused:$(OUT)/unet_ff \
	    $(foreach of,$(CHANGED) sigma-0.2 logs,unet-$(of)=$(BEYOND)/$(of)/unet_ff.safetensors) \
	    unet-crop=$(BEYOND)/crop unet-window=$(BEYOND)/window \
	    $(foreach of,$(GREW),$(BEYOND)/$(firstword $(subst :, ,$(of)))-drives.safetensors)

# Zensical fails for its own warnings alone: any line but its usual ones is a warning of an extension.
docs: .venv/.docs
	mkdir -p build
	$(BIN)/python -m zensical build --strict --clean 2>&1 | tee build/docs.log
	@grep -q '^Build finished' build/docs.log
	@! grep -qvE '^(Build started|No issues found|Build finished.*|)$$' build/docs.log

# Kernels are compiled beside the checks, and once, not by each of the processes of the tests.
test: setup .venv/.ros2
	$(MAKE) --jobs 2 check compiled
	$(BIN)/python -m pytest -n 2

check:
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

compiled:
	$(BIN)/foresee warm-up

release: .venv/.tools
	$(INSTALL) '.[release]'
	$(BIN)/python .ci/release.py

clean:
	rm -rf .venv .cache build results
