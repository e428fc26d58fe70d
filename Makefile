# Needs only make and Python 3.11 or newer. The first use of a target installs what it needs into .venv.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

export MPLBACKEND ?= Agg

# What compiled code decides: all of it, and the part that `make test` runs for a second instruction set.
SUBSET    := tests/integrators/test_lanes.py tests/integrators/test_methods.py tests/integrators/test_radau.py \
             tests/system/test_singular.py tests/system/test_contact_rounding.py tests/system/test_kinks.py \
             tests/system/test_sleigh_exact.py tests/system/test_sphere_exact.py tests/system/test_energy.py \
             tests/hard_cases/test_long_runs.py tests/transforms/test_taylor.py tests/codegen/test_vector_functions.py \
             tests/codegen/test_loops.py tests/codegen/test_advance_lanes.py tests/codegen/test_check_inputs.py
NUMERICAL := $(SUBSET) tests/hard_cases tests/integrators tests/system tests/runtime/test_sweep.py \
             tests/runtime/test_events.py tests/runtime/test_reductions.py tests/runtime/test_sweep_events.py

.DEFAULT_GOAL := help
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help demo docs test test-all test-targets test-browser lint bench bench-quick fuzz corpus clean

help:
	@echo "make demo         simulate the example scenes with every backend; pictures in build/demo"
	@echo "make docs         the documentation site, in build/docs (executes the gallery)"
	@echo "make test         ruff, mypy and the tests"
	@echo "make test-all     make test, and every ready scene in every formulation by every method on the numba backend"
	@echo "make test-targets the numerical tests for every instruction set that the processor has"
	@echo "make test-browser pages of animations in a headless Chromium (a part of make test where one is installed)"
	@echo "make lint         ruff and mypy only"
	@echo "make bench        the full benchmarks"
	@echo "make bench-quick  the benchmarks, shortened"
	@echo "make fuzz         random scenes against independent references; SEEDS=0:2000 chooses them, CONTACT_SEEDS=0:200"
	@echo '                  and FAMILIES="disc,plate" those with contacts'
	@echo "make corpus       recorded motions against this tree"
	@echo "make clean        remove what these wrote, except .venv"
	@echo "PYTHON=...        the interpreter that .venv is made with (now: $(PYTHON))"

demo: $(VENV)/.installed-demo
	@$(BIN)/python benchmarks/demo.py

docs: $(VENV)/.installed-dev
	@$(BIN)/python -m sphinx -b html -W --keep-going -q docs build/docs
	@echo "site: build/docs/index.html"

lint: $(VENV)/.installed-dev
	@echo "==> ruff check"
	@$(BIN)/ruff check .
	@echo "==> ruff format --check"
	@$(BIN)/ruff format --check .
	@echo "==> mypy"
	@MYPY_NUM_WORKERS=2 $(BIN)/mypy

test: lint
	@echo "==> pytest"
	@$(BIN)/python -m pytest -n 2
	@for target in $$($(BIN)/python tests/targets.py second); do \
	    echo "==> pytest: numerical tests for $$target"; \
	    DALEMBERT_TARGET=$$target $(BIN)/python -m pytest -q -n 2 $(SUBSET) || exit 1; \
	done

test-all: test
	@echo "==> pytest: the whole matrix of scenes"
	@$(BIN)/python -m pytest -q -n 2 --dist=load -m matrix

test-browser: $(VENV)/.installed-dev
	@$(BIN)/python -m pytest -q -n 0 tests/browser

test-targets: $(VENV)/.installed-dev
	@for target in $$($(BIN)/python tests/targets.py all); do \
	    echo "==> pytest: numerical tests for $$target"; \
	    DALEMBERT_TARGET=$$target $(BIN)/python -m pytest -q -n 2 $(NUMERICAL) || exit 1; \
	done

bench: $(VENV)/.installed-bench
	@$(BIN)/python benchmarks/run.py --full

bench-quick: $(VENV)/.installed-bench
	@$(BIN)/python benchmarks/run.py --quick

SEEDS ?= 0:200
CONTACT_SEEDS ?= 0:200
FAMILIES ?= all

fuzz: $(VENV)/.installed-dev
	@status=0; \
	PYTHONPATH=tests $(BIN)/python -m fuzz $(SEEDS) || status=1; \
	PYTHONPATH=tests $(BIN)/python -m fuzz.contacts $(CONTACT_SEEDS) --families "$(FAMILIES)" || status=1; \
	exit $$status

corpus: $(VENV)/.installed-dev
	@PYTHONPATH=tests $(BIN)/python -m corpus

clean:
	@rm -rf build dist docs/generated .hypothesis .mypy_cache .pytest_cache .ruff_cache
	@find . -path ./$(VENV) -prune -o -type d -name __pycache__ -exec rm -rf {} +

$(VENV)/.installed-demo:  EXTRAS := plot,jax
$(VENV)/.installed-dev:   EXTRAS := dev
$(VENV)/.installed-bench: EXTRAS := bench

# A virtual environment whose pip does not run was cut short or lost its interpreter: it is made anew.
$(VENV)/.installed-demo $(VENV)/.installed-dev $(VENV)/.installed-bench: pyproject.toml
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { \
	    $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	        echo "error: dalembert needs Python 3.11 or newer, and PYTHON=$(PYTHON) is:" \
	             "$$($(PYTHON) --version 2>&1). Try, for example: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; \
	        exit 1; }; \
	    echo "==> creating $(VENV) with $$($(PYTHON) --version)"; \
	    $(PYTHON) -m venv --clear $(VENV) || { \
	        echo "error: '$(PYTHON) -m venv' failed (on Debian and Ubuntu: install python3-venv)" >&2; \
	        exit 1; }; }
	@echo "==> installing dalembert[$(EXTRAS)] into $(VENV) (a few minutes the first time)"
	@$(BIN)/python -m pip install --disable-pip-version-check --no-input -e '.[$(EXTRAS)]' >$@.log 2>&1 || { \
	    cat $@.log >&2; \
	    echo "error: installing dalembert[$(EXTRAS)] failed; the log above is in $@.log" >&2; \
	    exit 1; }
	@touch $@
