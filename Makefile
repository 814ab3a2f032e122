# Two commands are enough: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROJECT := pyproject.toml
PACKAGES := daq fitting server sim_backends

.PHONY: demo test test-quick check bench clean
demo: $(VENV)/.use
	$(BIN)/hilfit demo

# The environments are rebuilt when the dependencies change; the package itself is installed editable.
$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.use: $(PROJECT) | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[sim]"
	touch $@

$(VENV)/.dev: $(PROJECT) | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	touch $@ $(VENV)/.use

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

test: check
	$(BIN)/pytest -n 2 --dist loadgroup

test-quick: $(VENV)/.dev
	$(BIN)/pytest -n 2 --dist loadgroup -m "not slow"

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache
