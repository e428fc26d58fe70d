# Needs only make and Python 3.11 or newer. The first use of a target installs what it needs into .venv.

PYTHON ?= python3
VENV   := .venv
NEWEST := .venv-newest
BIN    := $(VENV)/bin

export MPLBACKEND ?= Agg

# What the processor decides: what runs in lanes, for each instruction set with fewer than the processor's, and for the
# least one more that is compiled or rounded otherwise, without rows that run no code compiled for an instruction set and
# those whose outcome is far from any rounding. `NARROW` and `ROUNDED` take about as long.
BROKEN    := tests/runs/test_interrupted_sweeps.py::test_sweeps_
LANES     := tests/lanes/test_lanes.py $(addprefix $(BROKEN),with_samples of_one_run) \
             tests/codegen/test_vector_functions.py tests/codegen/test_advance_lanes.py
TAYLOR    := a_loop_over_the_orders_gives_the_bits_of_unrolled_code \
             pairs_of_operations_give_the_bits_of_operations_one_by_one
NARROW    := $(LANES) tests/system/test_outputs.py $(addprefix $(BROKEN),with_controllers of_one_run_with_controllers) \
             $(addprefix tests/transforms/test_taylor.py::test_,$(TAYLOR)) tests/codegen/test_check_inputs.py
SINGULAR  := projected_runs_pass_through_on_their_branch projected_runs_pass_on_their_branch_or_say_that_they_cannot \
             cases_of_a_projected_sweep_do_not_change_their_branch_and_succeed \
             rows_that_vanish_do_not_lead_to_another_branch \
             runs_past_lost_ranks_that_succeed_keep_their_energy_in_all_units \
             neighbours_of_cases_that_end_there_keep_their_bits
PHASES    := tests/system/test_contact_rounding.py::test_phases_do_not_depend_on_rounding
ROUNDED   := tests/methods/test_methods.py tests/steps/test_radau.py \
             $(addprefix tests/system/test_singular.py::test_,$(SINGULAR)) \
             $(addprefix tests/system/test_,contact_rounding.py kinks.py sleigh_exact.py sphere_exact.py energy.py) \
             tests/system/test_vanishing_lengths.py::test_slow_passage \
             tests/events/test_sweep_events.py::test_zeros_at_the_very_end \
             tests/hard_cases/test_long_runs.py --deselect '$(PHASES)[opens]' --deselect '$(PHASES)[starts apart]' \
             --deselect '$(PHASES)[sides]'
OTHERS    := not numpy and not scipy and not numba and not jax
NUMERICAL := tests/codegen/test_vector_functions.py tests/codegen/test_advance_lanes.py \
             tests/codegen/test_check_inputs.py tests/codegen/test_loops.py tests/transforms/test_taylor.py \
             tests/hard_cases tests/methods tests/steps tests/lanes tests/loops tests/events tests/system \
             tests/results tests/runs/test_sweep.py tests/runs/test_interrupted_sweeps.py

# What runs with the newest releases: where the package meets them, the first test of each file for its first case. Left
# out are files of our own arithmetic, and those of traced runs by the same calls of JAX as others. All tests render
# templates, and compile for the processor. Of models on a cluster it is the test that has a cluster.
LEFT_OUT  := $(addprefix codegen/test_,advance_lanes.py c_loops.py check_inputs.py loops.py target.py templates.py) \
             store/test_stored_contacts.py \
             runs/test_controllers_with_events.py \
             $(addprefix jax_backend/test_jax_,derivatives.py feedback.py hosted_inputs.py inputs.py jumps.py lanes.py \
             results.py second.py single.py steps.py times.py)
ELSEWHERE := $(addprefix store/test_stored_programs.py::test_,another_process a_graph what_a_model)
PART      := --first 1 $(addprefix tests/,codegen jax_backend model results runs store) \
             $(addprefix --ignore tests/,$(LEFT_OUT)) $(addprefix --deselect tests/,$(ELSEWHERE))

# Processes that tests start find the bytecode of the package, whatever the environment says.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help demo docs test test-all install-newest test-newest test-targets test-browser lint bench bench-quick fuzz corpus clean

help:
	@echo "make demo         simulate the example scenes with every backend; pictures in build/demo"
	@echo "make docs         the documentation site, in build/docs (executes the gallery)"
	@echo "make test         ruff, mypy and the tests"
	@echo "make test-all     make test, more random scenes of the textbook view, and every ready scene in every formulation"
	@echo "                  by every method on the numba backend"
	@echo "make test-newest  a part of the tests with the newest releases of all dependencies on the newest Python here, in"
	@echo "                  $(NEWEST)"
	@echo "make test-targets the numerical tests for every instruction set that the processor has"
	@echo "make test-browser pages of animations in a headless Chromium (a part of make test where one is installed)"
	@echo "make lint         ruff, mypy and the check of phrases only"
	@echo "make bench        the full benchmarks"
	@echo "make bench-quick  the benchmarks, shortened"
	@echo "make fuzz         random scenes against independent references; SEEDS=0:2000 chooses them, CONTACT_SEEDS=0:200, LOOP_SEEDS=0:300"
	@echo '                  and FAMILIES="disc,plate" those with contacts'
	@echo "make corpus       recorded motions against this tree"
	@echo "make clean        remove what these wrote, except .venv and $(NEWEST)"
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
	@echo "==> prose"
	@$(BIN)/python tests/prose.py

# mypy and prose leave half of a processor idle: meanwhile what both processes of pytest need is compiled. The parts for
# other instruction sets run in two processes, which compile the few loops that they need.
test: $(VENV)/.installed-dev
	@$(BIN)/python tests/compile_once.py tests & compiling=$$!; \
	$(MAKE) --no-print-directory lint; linted=$$?; \
	wait $$compiling && exit $$linted
	@echo "==> pytest"
	@$(BIN)/python -m pytest -n 2
	@mkdir -p build; \
	($(call for-target,between,$(LANES)) && $(call for-target,least,$(NARROW))) >build/narrow.log 2>&1 & narrow=$$!; \
	$(call for-target,least,$(ROUNDED)); rounded=$$?; \
	wait $$narrow; narrow=$$?; cat build/narrow.log; exit $$((rounded | narrow))

for-target = $(BIN)/python tests/targets.py $(1) -k "$(OTHERS)" $(2)

test-all: test
	@echo "==> pytest: more random scenes, and the whole matrix of scenes"
	@$(BIN)/python -m pytest -q -n 2 --dist=load -m matrix

RELEASES := '^(dask|diffrax|jax|llvmlite|numba|numpy|scipy|sympy|xarray|zarr)='

# The newest Python that there is and starts (a shim of pyenv may not), of those that all dependencies have wheels for.
find-newest = for python in python3.13 "$${PYENV_ROOT:-$$HOME/.pyenv}"/versions/3.13.*/bin/python \
                            python3.12 "$${PYENV_ROOT:-$$HOME/.pyenv}"/versions/3.12.*/bin/python; do \
                  "$$python" -c 'import ensurepip, venv' 2>/dev/null && echo "$$python" && break; \
              done; true

# Looks for newer releases than those of an hour ago.
install-newest:
	@python=$$($(find-newest)); \
	if [ -z "$$python" ]; then \
	    rm -rf $(NEWEST); \
	else \
	    find $(NEWEST)/.installed-test -mmin +60 -delete 2>/dev/null; \
	    $(MAKE) --no-print-directory VENV=$(NEWEST) PYTHON="$$python" $(NEWEST)/.installed-test; \
	fi

test-newest: install-newest
	@if [ ! -e $(NEWEST)/.installed-test ]; then \
	    echo "==> pytest with the newest releases: skipped, there is neither python3.13 nor python3.12"; \
	else \
	    echo "==> pytest with the newest releases:" \
	         "$$($(NEWEST)/bin/python --version)" $$($(NEWEST)/bin/python -m pip freeze | grep -E $(RELEASES)) && \
	    $(NEWEST)/bin/python -m pytest -q -n 0 $(PART); \
	fi

test-browser: $(VENV)/.installed-dev
	@$(BIN)/python -m pytest -q -n 0 tests/browser

test-targets: $(VENV)/.installed-dev
	@$(BIN)/python tests/targets.py all $(NUMERICAL)

bench: $(VENV)/.installed-bench
	@$(BIN)/python benchmarks/run.py --full

bench-quick: $(VENV)/.installed-bench
	@$(BIN)/python benchmarks/run.py --quick

SEEDS ?= 0:200
CONTACT_SEEDS ?= 0:200
LOOP_SEEDS ?= 0:300
FAMILIES ?= all

fuzz: $(VENV)/.installed-dev
	@status=0; \
	PYTHONPATH=tests $(BIN)/python -m fuzz $(SEEDS) || status=1; \
	PYTHONPATH=tests $(BIN)/python -m fuzz.contacts $(CONTACT_SEEDS) --families "$(FAMILIES)" || status=1; \
	PYTHONPATH=tests $(BIN)/python -m fuzz.loops $(LOOP_SEEDS) || status=1; \
	exit $$status

corpus: $(VENV)/.installed-dev
	@PYTHONPATH=tests $(BIN)/python -m corpus

clean:
	@rm -rf build dist docs/generated .hypothesis .mypy_cache .pytest_cache .ruff_cache
	@find . -path './.venv*' -prune -o -type d -name __pycache__ -exec rm -rf {} +

$(VENV)/.installed-demo:  EXTRAS := plot,jax
$(VENV)/.installed-dev:   EXTRAS := dev
$(VENV)/.installed-bench: EXTRAS := bench
$(VENV)/.installed-test:  EXTRAS := test
$(VENV)/.installed-test:  UPGRADE := --upgrade --upgrade-strategy eager

# Python compiles what is imported. pip would compile all that it installs, in one process: half of an installation. The
# pip of older Pythons takes half as long again as a new one.
# A virtual environment whose pip does not run was cut short or lost its interpreter: it is made anew.
$(VENV)/.installed-demo $(VENV)/.installed-dev $(VENV)/.installed-bench $(VENV)/.installed-test: pyproject.toml
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { \
	    $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	        echo "error: dalembert needs Python 3.11 or newer, and PYTHON=$(PYTHON) is:" \
	             "$$($(PYTHON) --version 2>&1). Try, for example: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; \
	        exit 1; }; \
	    echo "==> creating $(VENV) with $$($(PYTHON) --version)"; \
	    $(PYTHON) -m venv --clear $(VENV) || { \
	        echo "error: '$(PYTHON) -m venv' failed (on Debian and Ubuntu: install python3-venv)" >&2; \
	        exit 1; }; \
	    $(BIN)/python -m pip install -q --no-compile --retries 1 --upgrade pip >/dev/null 2>&1 || true; }
	@echo "==> installing dalembert[$(EXTRAS)] into $(VENV) (a few minutes the first time)"
	@$(BIN)/python -m pip install --disable-pip-version-check --no-input --no-compile $(UPGRADE) \
	    -e '.[$(EXTRAS)]' >$@.log 2>&1 || { \
	    cat $@.log >&2; \
	    echo "error: installing dalembert[$(EXTRAS)] failed; the log above is in $@.log" >&2; \
	    exit 1; }
	@touch $@
