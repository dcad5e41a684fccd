# The two commands of the README are `make demo` and `make test`; each sets up what it needs.
# PYTHON=/path/to/python3.12 chooses the interpreter; otherwise the first suitable one is taken.

VENV := .venv
BIN := $(VENV)/bin
suitable = import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python; do \
            $$p -c "$(suitable)" >/dev/null 2>&1 && { echo $$p; break; }; done)
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test test-all bench docs lint lowest clean
.DELETE_ON_ERROR:

demo: $(VENV)/.run
	$(BIN)/socwise compare

test: $(VENV)/.test
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-all: $(VENV)/.test
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "slow or not slow"

bench: $(VENV)/.test
	$(BIN)/python -m benchmarks

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/.docs
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html
	$(BIN)/python tools/check_links.py docs/_build/html

# The lower bounds in pyproject.toml, tried: a second environment with the oldest versions they allow.
lowest: $(VENV)/.run
	$(BIN)/python tools/lowest.py > build-lowest.txt
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check -e '.[test]' -c build-lowest.txt
	.venv-lowest/bin/python -m pytest -n 2 --dist worksteal

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "socwise needs Python 3.11, 3.12 or 3.13 and found none;" \
	  "install one, or name it: make PYTHON=/path/to/python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP_INSTALL) --editable .
	@touch $@

$(VENV)/.%: $(VENV)/.run
	$(PIP_INSTALL) --editable '.[$*]'
	@touch $@

clean:
	rm -rf $(VENV) .venv-lowest build-lowest.txt build dist docs/_build
