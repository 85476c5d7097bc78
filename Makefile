# make demo and make test are all the set-up there is: each makes .venv and installs what it needs.

PYTHON ?= python3
BIN := .venv/bin
TAXELFLOW := $(BIN)/taxelflow
READY := .venv/ready

.PHONY: setup demo test check format bench golden constraints clean
.DELETE_ON_ERROR:

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@if command -v uv >/dev/null 2>&1; then \
	  uv venv --allow-existing --quiet --python $(PYTHON) .venv && \
	  uv pip install --quiet --python .venv --constraint constraints.txt --editable '.[plot,dev]'; \
	else \
	  { test -x $(BIN)/python || $(PYTHON) -m venv .venv; } && \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[plot,dev]'; \
	fi
	@touch $@

test: $(READY)
	$(BIN)/pytest

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv demo .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
