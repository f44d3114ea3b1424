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

.PHONY: demo test slow thorough versions lint types bench pictures clean

demo: $(READY)
	$(BIN)/rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1 --out runs/demo

# A worker a processor: threads of linear algebra below it would only wait for each other.
test slow thorough: export OMP_NUM_THREADS = 1

test: $(READY)
	$(BIN)/python -m pytest -n auto --dist worksteal

slow: $(READY)
	$(BIN)/python -m pytest -m slow -n auto --dist worksteal

thorough: $(READY)
	$(BIN)/python -m pytest -m thorough -n auto --dist worksteal

versions: $(READY)
	$(BIN)/python tests/versions.py $(VERSIONS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

# The table takes some minutes on a machine that does nothing else; TABLE=--quick takes one, and
# BENCH adds options of pytest, as BENCH=--benchmark-max-time=0.1 for a quick look.
bench: export OMP_NUM_THREADS = 1
bench: $(READY)
	$(BIN)/python -m tests.bench.table --out runs/bench $(TABLE)
	$(BIN)/python -m pytest tests/bench --benchmark-only --override-ini addopts= $(BENCH)

pictures: $(READY)
	$(BIN)/python demos/readme_picture.py demos

clean:
	rm -rf $(VENV) runs

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "rpctl needs Python 3.10 or later; $$($(PYTHON) --version) is older. Try: make PYTHON=python3.11 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
		|| { echo "This Python lacks venv. On Debian or Ubuntu: apt install python3-venv"; exit 1; }
	@echo "Setting up $(VENV) (once; a minute or two)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $(READY)
