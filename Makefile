# Each of make episode, make paper, make test and make check sets up .venv first. `make help` lists all targets.

SCENARIO ?= liver
PLANNER ?= expected-improvement
STEPS ?= 30
SEED ?= 0
ARM ?= default
FRAMES ?= each
OUT ?=
ARGS ?=
JOBS ?= 2
TESTS ?=

.PHONY: help setup setup-dev episode paper doctor test check format docs clean

help:
	@echo "make episode   set up what is missing, run one episode, and tell its folder and results"
	@echo "               SCENARIO=liver|sphere|spheres|FILE.toml PLANNER=expected-improvement|find-and-outline|random|..."
	@echo "               STEPS=30 SEED=0 ARM=default|none|FILE.xml FRAMES=each|last|none OUT=folder ARGS='more options'"
	@echo "make paper     run the paper's experiments and write docs/results.md and its figures (JOBS=2 processes)"
	@echo "make doctor    say what is installed, what renders, and what to do about each red line"
	@echo "make test      set up what is missing and run the tests (TESTS='tests/planner/test_cone.py -k volume' for some)"
	@echo "make check     run the linter, the formatter and the type checker"
	@echo "make format    let the formatter and the linter rewrite the code"
	@echo "make docs      build the pages in docs/ into site/"
	@echo "make clean     remove .venv and caches; runs in renders/ stay"

setup:
	@FRAMES=$(FRAMES) sh .ci/setup

setup-dev:
	@sh .ci/setup dev

# Without OUT the command takes a new folder, so that no earlier run is replaced.
episode: setup
	@.venv/bin/sounding episode --scenario '$(SCENARIO)' --planner '$(PLANNER)' --steps $(STEPS) --seed $(SEED) \
		--arm '$(ARM)' --frames $(FRAMES) $(if $(OUT),--out '$(OUT)') $(ARGS)

# The campaign goes on where it was stopped; after a change of the code, ARGS=--overwrite begins it anew.
paper:
	@FRAMES=none sh .ci/setup
	@.venv/bin/sounding trials --study paper --jobs $(JOBS) --out renders/paper $(ARGS)
	@.venv/bin/python -m benchmarks.paper --jobs $(JOBS)

doctor:
	@FRAMES=none sh .ci/setup
	@.venv/bin/sounding doctor

# With one BLAS thread each, the pools of NumPy and SciPy do not take the cores from each other. Bytecode is kept: tests
# start some hundred processes, each of which would compile the package anew where the machine says not to keep any.
test: setup-dev
	OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= .venv/bin/python -m pytest -n auto --maxprocesses 4 $(TESTS)

check:
	@FRAMES=none sh .ci/setup lint
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyright

format:
	@FRAMES=none sh .ci/setup lint
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

docs: setup-dev
	NO_MKDOCS_2_WARNING=1 .venv/bin/python -m mkdocs build --strict

clean:
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis
	find sim planner mapping tests -name __pycache__ -type d -prune -exec rm -rf {} +
