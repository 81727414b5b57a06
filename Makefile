# Targets for people: `make demo`, `make test` and `make docs`. Each sets up what it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
export PATH := $(CURDIR)/$(BIN):$(PATH)

.PHONY: help demo test coverage docs format lint types layers tests gl chromium clean

help:
	@echo "make demo   renders, trains, evaluates and writes demo/report.html (under 8 minutes on two cores)"
	@echo "make test   formatter, linter, types, layer contracts, tests (some 20 minutes on two old cores)"
	@echo "make coverage  the tests, and which lines they run (a third longer)"
	@echo "make docs   builds the documentation into build/docs (open build/docs/index.html)"
	@echo "make format rewrites the code in the project's format"
	@echo "make clean  removes the virtual environment and everything that the targets made"

demo: $(INSTALLED) gl
	$(BIN)/python scripts/demo.py --out demo

test: lint types layers tests

lint: $(INSTALLED)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(INSTALLED)
	$(BIN)/mypy

layers: $(INSTALLED)
	$(BIN)/lint-imports

# Two test processes on two cores: threads of linear algebra inside them would only wait for each other. They and all
# programs that they start compile the project once, and not each anew.
tests coverage: export OPENBLAS_NUM_THREADS ?= 1
tests coverage: export OMP_NUM_THREADS ?= 1
tests coverage: $(INSTALLED) gl chromium
	env -u PYTHONDONTWRITEBYTECODE $(BIN)/pytest -n 2 --dist loadgroup --durations 10 $(COVERAGE)

coverage: COVERAGE := --cov --cov-report term

docs: $(INSTALLED)
	$(BIN)/sphinx-build -W --keep-going -n -q -b html docs build/docs

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

gl:
	@sh scripts/install_gl.sh

chromium:
	@sh scripts/install_chromium.sh

# Python compiles what it imports. To compile everything takes nearly as long as to install it.
$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "expected Python 3.11 or newer, found $$($(PYTHON) --version); say PYTHON=... to make" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@echo "installing the package and what it needs into $(VENV): some minutes without a word"
	$(BIN)/pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) build demo out .coverage* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
