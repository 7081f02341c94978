# `make demo` and `make test` do everything on a machine with git, make and Python 3.11.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
QUICK := not long and not readers and not browser

.PHONY: env demo test lint types contracts unit wheel test-long test-readers test-browser test-other-python test-hardware-in-vm schemas golden clean

env: $(VENV)/.up-to-date

$(VENV)/.up-to-date: pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "viewsep needs Python 3.11 (pybullet has no wheels for newer ones): install it or set PYTHON=..."; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

demo: env
	$(BIN)/viewsep demo

test: env
	$(MAKE) --jobs 2 --output-sync lint types contracts wheel
	$(MAKE) unit

lint: env
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: env
	$(BIN)/mypy

contracts: env
	$(BIN)/lint-imports

unit: env
	$(BIN)/python -m pytest -m "not alone and $(QUICK)" --numprocesses auto --dist loadfile
	$(BIN)/python -m pytest -m "alone and $(QUICK)"

# Whole tasks, learning on the rig, the quickstart and the contract of motion on more rigs: about ten minutes.
test-long: env
	$(BIN)/python -m pytest -m long

# Recordings in readers that are not ours: @mcap/core for JavaScript (needs node and npm, loads it) and Rerun's.
test-readers: env
	$(BIN)/python -m pip install --quiet --editable '.[dev,readers]'
	$(BIN)/python -m pytest -m readers

# The report's page in headless Chromium; says so where there is none (apt-get install --no-install-recommends chromium).
test-browser: env
	$(BIN)/python -m pytest -m browser tests/browser

# The golden recordings' decisions on another Python (3.12 unless OTHER says which), where the simulation is not installed.
test-other-python:
	$(PYTHON) tests/other_python.py $(or $(OTHER),python3.12)

wheel: env
	$(BIN)/python tests/wheel_install.py

# Slow: the kernel's own USB serial driver in a virtual machine (QEMU), emulated servos on its USB; not part of `make test`.
test-hardware-in-vm: env
	$(BIN)/python tests/hardware_in_vm/run.py

# Records the golden recording of the present layout again; look at the difference before it is committed.
golden: env
	$(BIN)/python tests/golden/make.py

# Regenerates recordings/schemas/*_pb2.py after a .proto file was changed.
schemas: env
	$(BIN)/python -m grpc_tools.protoc -Irecordings/schemas --python_out=recordings/schemas --pyi_out=recordings/schemas recordings/schemas/viewsep.proto

clean:
	rm -rf $(VENV) build *.egg-info demo .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
