# The two commands to know: `make demo` and `make test`. Both set everything up first, in a venv of their own.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.installed-docs
SCENE ?= groceries
# The files in their order: those that cost most are not among the last.
PYTEST_OPTIONS ?= -n 2 --dist loadfile --no-loadscope-reorder
# On a terminal pip shows what it fetches.
QUIET := $(shell test -t 2 || echo --quiet)
PIP_OPTIONS ?=
PIP_INSTALL := $(BIN)/python -m pip install $(QUIET) --disable-pip-version-check $(PIP_OPTIONS)

.DELETE_ON_ERROR:
.PHONY: help setup demo test test-all coverage check format smoke docs lock clean

help:
	@echo "make setup   create $(VENV) and install the locked dependencies and this package into it"
	@echo "make demo    setup, then the main job on the sample scene (SCENE=... for another)"
	@echo "make test    setup, then the tests but the slow ones (PYTEST_OPTIONS=... for others)"
	@echo "make test-all  the slow tests too"
	@echo "make coverage  all tests with coverage, which takes twice as long"
	@echo "make check   setup, then ruff and pyright"
	@echo "make format  setup, then let ruff mend what it can"
	@echo "make smoke   setup, then build the sdist, from it the wheel, and run that from an empty folder"
	@echo "make docs    setup, then build the documentation into site/"
	@echo "make lock    ask the index for current versions and rewrite the lock files"
	@echo "make clean   remove what the above made, runs/ excepted"

setup: $(STAMP)

# A Debian without python3-venv has no ensurepip: then the system's pip fills the venv.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "make: $(PYTHON) is missing or older than Python 3.11 ($$($(PYTHON) --version 2>&1));" \
			"install Python 3.11 or later, or name one: make setup PYTHON=python3.12" >&2; exit 1; }
	@echo "make: creating $(VENV)"
	@if $(PYTHON) -c 'import ensurepip' 2>/dev/null; then \
		$(PYTHON) -m venv --clear $(VENV); \
	else \
		$(PYTHON) -m venv --clear --without-pip $(VENV) && \
		$(PYTHON) -m pip --quiet --python $(BIN)/python install pip || { rm -rf $(VENV); \
			echo "make: $(PYTHON) has neither ensurepip nor a pip that can fill a venv;" \
				"on Debian: apt-get install python3-venv" >&2; exit 1; }; \
	fi

# The pip that comes with Python 3.11 takes twice the CPU time of a current one.
$(STAMP): pyproject.toml requirements.lock | $(BIN)/python
	@echo "make: installing the locked dependencies"
	@$(PIP_INSTALL) --upgrade 'pip>=26'
	@$(PIP_INSTALL) --requirement requirements.lock
	@$(PIP_INSTALL) --constraint requirements.lock --no-build-isolation --editable .
	@touch $@

$(DOCS_STAMP): requirements-docs.lock $(STAMP)
	@$(PIP_INSTALL) --requirement requirements-docs.lock
	@touch $@

demo: setup
	$(BIN)/grs run $(SCENE)

# The matrices are small and the cores are taken: threads of its own would have linear algebra wait for itself.
test test-all coverage smoke: export OPENBLAS_NUM_THREADS := 1

test: setup
	$(BIN)/python -m pytest $(PYTEST_OPTIONS) -m "not slow"

test-all: setup
	$(BIN)/python -m pytest $(PYTEST_OPTIONS)

coverage: setup
	$(BIN)/python -m pytest $(PYTEST_OPTIONS) --cov --cov-report=term

# Pyright fills the memory that node has for young objects by default many times a second.
check: export NODE_OPTIONS := --max-semi-space-size=128 --max-old-space-size=8192

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

smoke: setup
	$(BIN)/python scripts/smoke.py

docs: $(DOCS_STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

lock: setup
	$(BIN)/python scripts/lock.py

clean:
	rm -rf $(VENV) dist build site .pytest_cache .ruff_cache .hypothesis .coverage .coverage.*
