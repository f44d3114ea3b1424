# Two commands for a newcomer: `make demo` and `make test`. Both set up .venv by themselves.
# Each kind of check has a quick case in `make test`; `make slow` runs in CI as well, and
# `make thorough` runs the whole grids before a release.

#
# `make versions` tests the lowest and the newest dependencies on every Python from 3.10 on that is
# installed; VERSIONS chooses, as VERSIONS='--python 3.10 --resolution lowest'.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
READY_DEV := $(VENV)/.ready-dev
# Modules are compiled when they are first imported, since most never are: Python has to keep what it compiles.
unexport PYTHONDONTWRITEBYTECODE
INSTALL = $(BIN)/python -m pip install --disable-pip-version-check --progress-bar off --no-compile

.PHONY: demo test slow thorough versions lint types bench docs pictures clean

demo: $(READY)
	@echo "TIAGo follows a figure-eight; the report goes to runs/demo/report.html"
	$(BIN)/rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1 --out runs/demo

# A worker a processor: threads of linear algebra below it would only wait for each other.
test slow thorough: export OMP_NUM_THREADS = 1

test: $(READY_DEV)
	$(BIN)/python -m pytest -n auto --dist worksteal

slow: $(READY_DEV)
	$(BIN)/python -m pytest -m slow -n auto --dist worksteal

thorough: $(READY_DEV)
	$(BIN)/python -m pytest -m thorough -n auto --dist worksteal

versions: $(READY_DEV)
	$(BIN)/python tests/versions.py $(VERSIONS)

lint: $(READY_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY_DEV)
	$(BIN)/mypy

# The table takes some minutes on a machine that does nothing else; TABLE=--quick takes one, and
# BENCH adds options of pytest, as BENCH=--benchmark-max-time=0.1 for a quick look.
bench: export OMP_NUM_THREADS = 1
bench: $(READY_DEV)
	$(BIN)/python -m tests.bench.table --out runs/bench $(TABLE)
	$(BIN)/python -m pytest tests/bench --benchmark-only --override-ini addopts= $(BENCH)

# The manual, to be read offline from docs/_build/index.html
docs: $(READY_DEV)
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build

pictures: $(READY_DEV)
	$(BIN)/python demos/pictures.py demos docs/gallery

clean:
	rm -rf $(VENV) runs docs/_build

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "rpctl needs Python 3.10 or later; $$($(PYTHON) --version) is older. Try: make PYTHON=python3.11 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
		|| { echo "This Python lacks venv. On Debian or Ubuntu: apt install python3-venv"; exit 1; }
	@echo "Setting up $(VENV), once: rpctl and the packages that it needs, about 500 MB to download"
	@$(PYTHON) -m venv $(VENV)
	@$(INSTALL) --editable .
	@touch $(READY)

$(READY_DEV): $(READY)
	@echo "Adding to $(VENV) what tests, types and benchmarks need, about 250 MB to download"
	@$(INSTALL) --editable '.[dev]'
	@touch $(READY_DEV)
