# SPDX-License-Identifier: Apache-2.0
# Everything runs from .venv, which the first verb that needs it makes (scripts/set_up.sh; pinned in constraints.txt).
.DEFAULT_GOAL := help
SHELL := /bin/sh
PY := .venv/bin/python
ARGS ?=

# Nothing here talks to another host's ROS unless asked to.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.PHONY: help setup setup-dev demo test bench bench-long lint format model gap-check fuzz mutate soak clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup:  ## make .venv for the commands (once; demo does it too)
	@scripts/set_up.sh run

setup-dev:  ## make .venv for tests, benchmarks and training (once; test does it too)
	@scripts/set_up.sh dev

demo: setup  ## set up, then a virtual session: label, diagnose, correct, inspect, simulate: out/demo/
	@.venv/bin/toftwin demo $(ARGS)

# Tests start many processes: modules are compiled for the first of them alone, also where an image sets PYTHONDONTWRITEBYTECODE.
test: setup-dev  ## set up, run the tests (ARGS="-k preproc"), then lint
	@PYTHONDONTWRITEBYTECODE= $(PY) -m pytest -n 2 --dist loadfile --no-loadscope-reorder --durations=25 $(ARGS)
	@$(MAKE) --no-print-directory lint

bench: setup-dev  ## print the figures and their bars, at most 20 minutes (ARGS="--only NAME --write")
	@$(PY) -m benchmarks $(ARGS)

bench-long: setup-dev  ## the figures that take longer
	@$(PY) -m benchmarks --long $(ARGS)

lint: setup-dev  ## ruff, mypy --strict, import contracts, spelling
	@.venv/bin/ruff check . && .venv/bin/ruff format --check . && .venv/bin/mypy && .venv/bin/lint-imports --no-logo && .venv/bin/codespell

format: setup-dev  ## let ruff format and repair what it can
	@.venv/bin/ruff check --fix-only . && .venv/bin/ruff format .

model: setup-dev  ## train the network that the package carries, from virtual sessions (hours on few cores; goes on where it stopped)
	@$(PY) -m benchmarks.make_model $(ARGS)

gap-check: setup-dev  ## withheld effects: how often the gap report names the right one
	@$(PY) -m benchmarks.gap_check $(ARGS)

fuzz: setup-dev  ## coverage-guided fuzzing of all that reads foreign bytes, hours (ARGS="--target scene --seconds 600")
	@$(PY) -m pip install -q --disable-pip-version-check -c constraints.txt 'atheris>=3.0' && $(PY) -m tests.fuzz.run $(ARGS)

mutate: setup-dev  ## faults put into the deciding functions of each room: how many do the tests find (ARGS="--room limits")
	@$(ONE_THREAD) $(PY) -m benchmarks.mutate $(ARGS)

soak: setup-dev  ## the graph for a long time: frames lost, memory, latency
	@$(PY) -m benchmarks.soak $(ARGS)

clean:  ## remove what was made here, .venv included
	rm -rf .venv out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache src/*.egg-info
	find src tests benchmarks scripts -name __pycache__ -prune -exec rm -rf {} +
