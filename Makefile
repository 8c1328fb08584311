# Two commands: `make reproduce` and `make test`. Both need only python3 (3.11 or newer) and make.
# `make test-device` runs the tracker on MicroPython and in C, and needs node, npm and compilers;
# `make test-site` looks at the pages in a browser and needs Chromium.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PIP := $(if $(shell command -v uv 2>/dev/null),uv pip install --python $(BIN)/python,$(BIN)/python -m pip install)

VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
RELEASE = inertial-compendium-$(VERSION)

.PHONY: help install reproduce findings site article test test-article test-device test-machines \
	test-mutants test-site lint \
	format lock release clean

help:
	@echo "make reproduce  run every notebook in order and redraw figures/"
	@echo "make test       lint, check types, run the tests, re-execute every notebook and compare"
	@echo "make test-device  run the tracker on MicroPython and, in C, on a Cortex-M4F, and compare (says what it needs)"
	@echo "make test-machines  the same numbers as if on other processors, and with the oldest and newest"
	@echo "                    packages: all, or SETTING=zen; of it ONLY=tests/test_allan.py or ONLY=22"
	@echo "make test-mutants  change the pure modules and see whether the tests notice (N=100 SEED=1)"
	@echo "make findings   those of simulations under another seed (SEED=7): prints what was and what is"
	@echo "make site       build the notebooks, figures and claims as pages into site/"
	@echo "make article    build the replication article, build/article.pdf"
	@echo "make test-article  build the article and check its numbers and its pages"
	@echo "make test-site  build the site and check it in a browser (needs Chromium)"
	@echo "make install    make .venv and install into it; the two do so by themselves"
	@echo "make format     format the code and the notebooks"
	@echo "make lock       pin requirements.lock anew from pyproject.toml (needs uv)"
	@echo "make release    dist/: the archive of this commit (see RELEASING.md)"

# uv installs in seconds where a machine has it; venv and pip do the same elsewhere.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	rm -rf $(VENV)
	if command -v uv >/dev/null 2>&1; then \
		uv venv --quiet --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" $(VENV); \
	else \
		$(PYTHON) -m venv $(VENV); \
	fi
	$(PIP) --quiet --require-hashes -r requirements.lock
	$(PIP) --quiet --no-deps --no-build-isolation -e .
	touch $@

install: $(READY)

reproduce: $(READY)
	$(BIN)/python -m analysis reproduce

# Two workers; each takes whole files, so that a notebook's cells stay in order.
test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# MicroPython's WebAssembly port, 2 MB, pinned with its hash. For C two compilers and an emulator.
FOR_C = gcc libc6-dev gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
test-device: $(READY)
	@command -v node >/dev/null 2>&1 && command -v npm >/dev/null 2>&1 || \
		{ echo "node 18 or newer and npm are needed, for example: apt-get install nodejs npm"; exit 1; }
	@command -v gcc >/dev/null 2>&1 && command -v arm-none-eabi-gcc >/dev/null 2>&1 && \
		command -v qemu-system-arm >/dev/null 2>&1 || \
		{ echo "compilers and an emulator are needed, for example: apt-get install $(FOR_C)"; exit 1; }
	npm ci --prefix tests/device --no-audit --no-fund --loglevel=error
	$(BIN)/python -m pytest tests/device

# The findings of simulated laps and stops again, with all studies behind them: prints
# what was and what is. Three quarters of an hour on two cores, and the raw logs (COMPENDIUM_DATA).
SEED ?= 7
AGAIN = "$(CURDIR)/scratch/findings-$(SEED)"
OTHER = COMPENDIUM_SEED=$(SEED) COMPENDIUM_DERIVED=$(AGAIN)/derived $(BIN)/python -m analysis
findings: $(READY)
	rm -rf $(AGAIN) && mkdir -p $(AGAIN) && cp -r data/derived $(AGAIN)/derived
	$(OTHER) data --rebuild --write real-laps inverse-design terrain-verdicts tracker-stops tracker-outages
	$(OTHER) readings --compiled --readings 64 --best 1 --out $(AGAIN)/derived/readings
	$(OTHER) reproduce --scratch $(AGAIN)/out -p SEED=$(SEED) 21 23 24 32

# Nothing is written but scratch/ and, for the packages, an environment for each; see the script.
test-machines: $(READY)
	$(BIN)/python tests/machines.py $(if $(SETTING),--setting $(SETTING)) $(if $(ONLY),--only $(ONLY))

# One processor for up to an hour; what is known, in tests/mutants.csv, is not tried again.
N ?= 100
test-mutants: SEED = 1
test-mutants: $(READY)
	$(BIN)/python -u tests/mutants.py -n $(N) --seed $(SEED)

# From the executed notebooks and figures/; no cell runs and nothing is fetched.
site: $(READY)
	$(BIN)/python docs/pages.py build/pages
	rm -rf build/html site
	$(BIN)/python -m sphinx -q -E -j 2 -c docs -d build/doctrees build/pages build/html
	mv build/html site

# A driver of browsers, with its own node, is 165 MB: only this target installs it.
test-site: site
	@command -v chromium >/dev/null 2>&1 || command -v chromium-browser >/dev/null 2>&1 || \
		command -v google-chrome >/dev/null 2>&1 || \
		{ echo "Chromium is needed, for example: apt-get install chromium"; exit 1; }
	$(PIP) --quiet --require-hashes -r tests/site/requirements.lock
	$(BIN)/python -m pytest tests/site

# The text with the numbers of the ledger. Typst is one wheel of 20 MB, without system fonts.
article: $(READY)
	$(PIP) --quiet --require-hashes -r docs/article/requirements.lock
	$(BIN)/python docs/article.py

test-article: article
	$(BIN)/python -m pytest tests/article

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
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header \
		--no-emit-index-url --no-emit-find-links tests/site/requirements.in -o tests/site/requirements.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header \
		--no-emit-index-url --no-emit-find-links docs/article/requirements.in \
		-o docs/article/requirements.lock

# What git holds at HEAD, what describes it, and the article.
release: article
	@test -z "$$(git status --porcelain)" || { echo "commit first: the archive is of HEAD"; exit 1; }
	rm -rf dist
	mkdir dist
	git archive --prefix=$(RELEASE)/ -o dist/$(RELEASE).zip HEAD
	cp build/article.pdf dist/$(RELEASE)-article.pdf
	cd dist && sha256sum $(RELEASE).zip | tee $(RELEASE).zip.sha256

clean:
	rm -rf $(VENV) .venv-oldest .venv-newest build dist site *.egg-info
