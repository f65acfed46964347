# Everything runs in .venv, which `env` makes; no step needs anything but a Python 3.12 or newer and a C compiler.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help env demo test parts ranks verify verified every-key slow test-portable durations lint docs docs-test bench docker \
    clean pictures release

BIN := .venv/bin
# One thread per rank; Open MPI: as many ranks as asked for, as any user.
export OMP_NUM_THREADS ?= 1
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

env: ## set up .venv with DOLFINx (again at no cost when it is up to date)
	@.ci/setup
	@$(BIN)/python -m compileall -q ruptfx  # else some processes of tests compile it anew, each in 0.3 s

demo: env ## the main job on two ranks, with pictures in runs/demo/figures
	@rm -rf runs/demo
	$(BIN)/ruptfx run demos/impact.toml --ranks 2 --out runs/demo

lint: env ## style, types, import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# Options of pytest: here what all suites share, in pyproject.toml what every run of pytest has. Two processes, each with
# whole files: some need a minute for what their tests share. Reports: durations by test, which `make durations` shows.
REPORT = --junit-xml=.ci/reports/$@.xml
FILES = -n 2 --dist loadfile $(REPORT)
TESTS = -n 2 --dist load $(REPORT)
EVERY_KEY := tests/contracts/test_every_key.py

test: env ## lint, tests of parts and contracts on 1 rank, the MPI tests on 2 ranks, the demo at small size
	@$(MAKE) --no-print-directory -j 2 lint parts
	@$(MAKE) --no-print-directory ranks

parts: env
	$(BIN)/python -m pytest $(FILES) tests/unit tests/contracts tests/docs --ignore=$(EVERY_KEY)

ranks: env
	"$$($(BIN)/python -c 'from ruptfx.platform.launch import find_mpiexec; print(find_mpiexec())')" -n 2 \
	    $(BIN)/python -m pytest -p no:cacheprovider tests/mpi
	out=$$(mktemp -d) && trap 'rm -rf "$$out"' EXIT && $(BIN)/ruptfx run demos/impact.toml --ranks 2 \
	    --out "$$out/demo" --set mesh.element_size=4e-3 --set duration=20e-6

# Without the figures of benchmarks: their tests run every benchmark, which `bench` does.
# The longest tests come first: the other process would wait for them at the end.
LONGEST := tests/unit/test_design.py
SLOW = $(LONGEST) $(filter-out $(LONGEST) tests/contracts/test_bench_figures.py, \
    $(shell grep -rl 'mark\.slow\|import .*crossed' tests --include='test_*.py'))
verify: verified every-key slow test-portable ## exact solutions, other codes, kills, 1 to 3 ranks, every key, and what takes minutes

verified: env
	$(BIN)/python -m pytest $(FILES) tests/verification tests/faults tests/mpi

every-key: env
	$(BIN)/python -m pytest $(TESTS) $(EVERY_KEY)

slow: env
	$(BIN)/python -m pytest $(TESTS) -m slow $(SLOW)

# Code for other vectors, and other kernels of the BLAS, round otherwise. That reaches a result only where an error or a
# residual decides: in what iterates or chooses its steps. This runs for the oldest x86-64, whose code is farthest from that
# of this machine; code for AVX2 lies between both. Other solutions are compared with bounds far above rounding. Contracts
# run for the oldest x86-64 inside the image (tests/container).
ITERATING := $(patsubst %,tests/verification/test_%.py,condensed implicit_steps memory_implicit quasi_dynamic \
    quasi_dynamic_laws radiation_damping slow sliding_implicit)
test-portable: env ## what iterates or chooses its steps, with code for the oldest processors
	RUPTFX_MARCH=x86-64 OPENBLAS_CORETYPE=Haswell $(BIN)/python -m pytest $(FILES) $(ITERATING)

durations: ## durations of the last tests by file, in wall-clock and CPU time, and the slowest tests
	@$(BIN)/python .ci/durations

docs: env ## build the site in docs/_build/html, offline
	@echo "Building the site ..."
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "Open docs/_build/html/index.html"

# Every page runs in a directory of its own. Pages take from none to thirty seconds: a process that is done takes others over.
docs-test: env ## run the code blocks of all pages, and open every page of the site in a browser
	$(BIN)/python -m pytest -m docs -n 2 --dist worksteal $(REPORT) tests/docs

pictures: env ## renew the pictures of the site from runs of the demos, and their numbers
	$(BIN)/python docs/make_pictures.py

bench: env ## benchmarks with acceptance numbers; fails when one is missed; WITHOUT="NAME ...": but these
	$(BIN)/ruptfx bench all --jobs 2 --out runs/bench --overwrite $(addprefix --without ,$(WITHOUT))

docker: ## build the image and run the demo in it, as you, with files in ./out
	docker build -t ruptfx .
	mkdir -p out
	docker run --rm --user "$$(id -u):$$(id -g)" -v "$$PWD/out:/out" ruptfx

release: env ## wheel, source archive, SBOM, licences and checksums in dist/, tried in a fresh environment; IMAGE=1: the image, too
	.ci/release

clean: ## remove .venv, caches and runs/demo; other runs stay
	rm -rf .venv .ci/reports runs/demo docs/_build build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
