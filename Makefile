# Two commands: `make reproduce` and `make test`. Both need only python3 (3.11 or newer) and make.
# `make test-device` runs the tracker on MicroPython and needs node and npm as well.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help install reproduce test test-device lint format lock clean

help:
	@echo "make reproduce  run every notebook in order and redraw figures/"
	@echo "make test       lint, check types, run the tests, re-execute every notebook and compare"
	@echo "make test-device  run the tracker on MicroPython and compare (needs node and npm)"
	@echo "make install    make .venv and install into it; the two do so by themselves"
	@echo "make format     format the code and the notebooks"
	@echo "make lock       pin requirements.lock anew from pyproject.toml (needs uv)"

# uv installs in seconds where a machine has it; venv and pip do the same elsewhere.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	rm -rf $(VENV)
	if command -v uv >/dev/null 2>&1; then \
		uv venv --quiet --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" $(VENV) && \
		uv pip install --quiet --python $(BIN)/python --require-hashes -r requirements.lock && \
		uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation -e . ; \
	else \
		$(PYTHON) -m venv $(VENV) && \
		$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock && \
		$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e . ; \
	fi
	touch $@

install: $(READY)

reproduce: $(READY)
	$(BIN)/python -m analysis reproduce

# Two workers; each takes whole files, so that a notebook's cells stay in order.
test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile

# MicroPython's WebAssembly port, 2 MB, pinned with its hash; everything else is here.
test-device: $(READY)
	@command -v node >/dev/null 2>&1 && command -v npm >/dev/null 2>&1 || \
		{ echo "node 18 or newer and npm are needed, for example: apt-get install nodejs npm"; exit 1; }
	npm ci --prefix tests/device --no-audit --no-fund --loglevel=error
	$(BIN)/python -m pytest tests/device

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

lock:
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header \
		--no-emit-index-url --no-emit-find-links --all-extras pyproject.toml -o requirements.lock

clean:
	rm -rf $(VENV) *.egg-info
