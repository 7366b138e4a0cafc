# Every target does its own set-up: Python >= 3.11, make and git are enough.
#   make demo    compare culling pipelines on the built-in city; ends with a table and a report
#   make test    the test suite (PYTEST_ARGS adds options: make test PYTEST_ARGS=--run-slow)
#   make lint    style, types, import rules
#   make docs    the documentation, warnings are errors
#   make bench   the benchmarks: ratios measured in one run
#   make clean   remove everything that these targets made, .venv too

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && echo $$p && break; done)
BIN := .venv/bin
DEMO := build/demo
PYTEST_ARGS ?=

# Two threads on a small product cost more than they save, and make timings jump.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test lint docs bench clean

demo: .venv/installed-core
	$(BIN)/python .ci/bootstrap.py gl
	$(BIN)/scenegraph compare city --quick --out $(DEMO)

test: .venv/installed-dev
	$(BIN)/python .ci/bootstrap.py gl
	$(BIN)/python -m pytest -n auto $(PYTEST_ARGS)

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: .venv/installed-docs
	$(BIN)/python .ci/bootstrap.py gl
	$(BIN)/python -m sphinx -W --keep-going -b html -d build/doctrees docs build/docs
	@echo "The documentation is build/docs/index.html"

bench: .venv/installed-dev
	$(BIN)/python .ci/bootstrap.py gl
	$(BIN)/python -m pytest tests/bench -o python_files='bench_*.py' -q -s -rN --benchmark-columns=median,iqr,rounds $(PYTEST_ARGS)

clean:
	rm -rf .venv build dist docs/gallery docs/sg_execution_times.rst .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/installed-%: pyproject.toml .ci/bootstrap.py
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed; none was found. Install it, or say make PYTHON=/path/to/python3" >&2; exit 2; }
	$(PYTHON) .ci/bootstrap.py venv $(filter-out core,$*)
