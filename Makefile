# Every target builds .venv when it is missing, with what it needs: the core for the demo
# (0.6 GB), everything for the others (3 GB). Only Python 3.11 and make are needed.
PYTHON ?= python3.11
DATA ?= ../shared/data
SOCIALTOUCH ?= $(DATA)/socialtouch
BIN := .venv/bin
CORE := .venv/.core
READY := .venv/.ready

# Without kept bytecode each of the processes that tests start compiles all modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo touches test test-fast check format docs bench results validate soak fuzz attack build publish clean

demo: $(CORE)
	$(BIN)/eskin demo

touches: $(CORE)
	$(BIN)/python examples/01_real_touches.py --data "$(SOCIALTOUCH)"

test: $(READY)
	$(BIN)/pytest

# Those that take less than half a second each, for everyday work.
test-fast: $(READY)
	$(BIN)/pytest -m "not slow and not long"

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(READY)
	$(BIN)/mkdocs build --strict

# What a step costs, beside everything else: about half an hour on one core.
bench: $(READY)
	$(BIN)/eskin bench latency
	$(BIN)/python -m lab.latency
	$(BIN)/python -m lab.scaling --picture docs/pictures/latency.png
	$(BIN)/python -m lab.sustained
	$(BIN)/python -m lab.memory
	$(BIN)/python -m lab.start

# The tables of docs/results.md, part by part: what is missing at this commit.
# PARTS="people streams" runs these alone, and a run ends after MINUTES; the next goes on.
# What was answered is kept in SETS/kept. `python -m lab.results list` shows what is done.
# FORM=short shows in two minutes that methods are trained and compared.
FORM ?= long
SETS ?= sets
PARTS ?=
MINUTES ?= 110
results: $(READY)
ifeq ($(FORM),short)
	$(BIN)/python -m lab.comparison all --form short --sets "$(SETS)"
	$(BIN)/python -m lab.paper all --form short --sets "$(SETS)"
else
	$(BIN)/python -m lab.results run $(PARTS) --sets "$(SETS)" --data "$(DATA)" \
		--minutes $(MINUTES)
endif

# What the simulated world is held to, and the weights on touches that it did not make.
validate: $(READY)
	$(BIN)/python -m lab.simulation all
	$(BIN)/python -m lab.transfer --data "$(SOCIALTOUCH)"
	$(BIN)/python -m lab.transfer --data "$(SOCIALTOUCH)" --floor 0.125

# Readers against mutated inputs: the part `fuzz` of the results, each time it is called.
fuzz: $(READY)
	$(BIN)/python -m lab.fuzz decoder --inputs 300000
	$(BIN)/python -m lab.fuzz skin --inputs 4000
	$(BIN)/python -m lab.fuzz recording --inputs 5000
	$(BIN)/python -m lab.fuzz commands --inputs 4000
	$(BIN)/python -m lab.fuzz model --inputs 2000
	$(BIN)/python -m lab.fuzz urdf --inputs 2000

# Faults, forgeries, delays and hostile files: an hour on two cores.
attack: $(READY)
	$(BIN)/python -m lab.attacks faults
	$(BIN)/python -m lab.attacks delay
	$(BIN)/python -m lab.attacks hold
	$(BIN)/python -m lab.attacks forgery
	$(BIN)/python -m lab.attacks files

# Long tests, and long runs with what breaks in them.
soak: $(READY)
	$(BIN)/pytest -m long
	$(BIN)/python -m lab.soak kill
	$(BIN)/python -m lab.soak stream
	$(BIN)/python -m lab.soak stream --real

# Wheel and sdist in dist/, each installed where nothing else is: the core, then every
# extra with a command of its own. Needs the network, and half an hour. ONLY="core ros2"
# checks these alone.
build: $(READY)
	$(BIN)/python -m lab.build $(if $(ONLY),--only $(ONLY))

# Tags and publishes what `make build` has just made and checked.
VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
publish: build
	test -z "$$(git status --porcelain)"
	grep -q "^## $(VERSION) - " CHANGELOG.md
	$(BIN)/python -m pip install --quiet twine
	$(BIN)/twine check dist/*
	git tag v$(VERSION)
	git push origin v$(VERSION)
	$(BIN)/twine upload dist/*

clean:
	rm -rf .venv site build dist

# pip says what it fetches, and how large that is, so that nobody waits in silence.
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check \
	--constraint constraints.txt

# Most modules are never imported: each gets its bytecode when it is imported first.
$(CORE): pyproject.toml constraints.txt
	@echo "installing eskin into .venv (0.6 GB), once: a minute or two"
	test -x $(BIN)/python || $(PYTHON) -m venv .venv || python3 -m venv .venv
	$(INSTALL) --no-compile --editable .
	touch $(CORE)

# torch is asked for first and pinned: an unpinned one brings gigabytes of CUDA.
$(READY): $(CORE) plugins/paper_network/pyproject.toml
	@echo "installing what tests and training need into .venv (3 GB), once"
	$(INSTALL) torch
	$(INSTALL) --editable '.[dev]'
	$(INSTALL) --no-deps --editable plugins/paper_network
	touch $(READY)
