# Every target sets up what it needs: a virtual environment in .venv with the package and its
# development tools, in the versions of constraints.txt. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: install demo web replay wheel site lint check quick test suite matrix clean

install: $(INSTALLED)

$(INSTALLED): setup.cfg pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

# Plan, clone and train on the first 15 s of a piece: a table, a video and a report.
demo: $(INSTALLED)
	$(BIN)/python examples/demo.py

# The page in the browser: web/dist/index.html with files beside it, and web/dist/piano.html alone.
# SITE_ADDRESS, if it is set, is that of the site whose play/ the page will be: links then show a picture.
web: web/assets/catalogue.json web/node_modules replay
	cd web && npm run check && PAGE_ADDRESS=$(if $(SITE_ADDRESS),$(SITE_ADDRESS)play/) npm run build

# Pieces are played, which takes some minutes, only when something in the package has changed.
web/assets/catalogue.json: $(INSTALLED) $(wildcard web/recordings/*) $(shell find sb3_piano -type f ! -name '*.pyc' ! -name replay.js)
	$(BIN)/sb3-piano export web web/assets --take web/recordings

web/node_modules: web/package-lock.json
	cd web && npm ci
	touch $@

# The player of `sb3-piano report RUN --3d`; wheels that are built afterwards have it, too. A wheel that
# is built without it works; `report --3d` then says how to build it.
REPLAY := sb3_piano/viewing/report/templates/replay.js

replay: $(REPLAY)

$(REPLAY): web/node_modules $(wildcard web/src/*.ts web/src/music/*.ts web/src/replay/*.ts web/src/view/*.ts web/src/page/playback.ts)
	cd web && npm run replay

wheel: $(INSTALLED) replay
	$(BIN)/python -m build --no-isolation

# The documentation in site/, with the page in the browser and notebooks that are executed; `mkdocs
# serve` shows it while it is written.
site: $(INSTALLED) web
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	if [ -d web/node_modules ]; then cd web && npm run --silent check; fi

# The tests write thousands of small files, for each of which a disk is waited for, and start hundreds
# of processes, for which they wait, too: there is one more at once than cores, and five at most, of 2 GB
# each; their files are kept in memory where there are 4 GB for them, and Python's bytecode also where the
# environment would not have it.
MEMORY := $(shell df --output=avail,target /dev/shm 2>/dev/null | awk 'NR > 1 && $$1 > 4e6 {print $$2}')
WORKERS := $(shell cores=$$(nproc 2>/dev/null || echo 2); echo $$((cores < 4 ? cores + 1 : 5)))
PYTEST := $(if $(MEMORY),PYTEST_DEBUG_TEMPROOT=$(MEMORY)) PYTHONDONTWRITEBYTECODE= \
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

# What to run while working: all but the slow tests, and the linters meanwhile.
check: $(INSTALLED)
	$(MAKE) --no-print-directory --jobs 2 lint quick

quick: $(INSTALLED)
	$(PYTEST) -m "not slow"

# Everything; `pytest` alone, in one process, is the same. `make --jobs 2 test` lints meanwhile. Slow
# tests wait more: for browsers, servers, and processes that end. The slowest are named at the end.
test: lint suite

suite: $(INSTALLED)
	$(PYTEST) -n $$(($(WORKERS) + 1)) --durations=40

# `check` with each supported Python, installed afresh. PYTHONS chooses some: make matrix PYTHONS=python3.13
matrix:
	.ci/matrix $(PYTHONS)

clean:
	rm -rf $(VENV) web/node_modules web/assets web/dist $(REPLAY) site build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
