# Every target sets up .venv by itself; any Python >= 3.11 with pip will do.
# To choose one: make demo PYTHON=/path/to/python3.12

SHELL := /bin/sh
.DEFAULT_GOAL := help

# Matrices are small: threads of BLAS would only wait for each other where several tests run.
export OPENBLAS_NUM_THREADS ?= 1
# Tests begin hundreds of processes: each would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

# One more than there are processors, as tests wait for programs and browsers, but four at most.
WORKERS := $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); [ $$n -ge 3 ] && echo 4 || echo $$((n + 1)))

VENV := .venv
RUN := $(VENV)/bin/python
PIP := $(RUN) -m pip --disable-pip-version-check --no-input -q -q install
CORE := $(VENV)/.bozzini-core
DEV := $(VENV)/.bozzini-dev
DOCS := $(VENV)/.bozzini-docs
READ := $(VENV)/.bozzini-read

# Exit code 1 is an honest answer about the scope ("through the wall"), not a failure of the demo.
DEMO = touch $(VENV)/.demo-begins; $(RUN) -m bozzini demo --out bozzini-demo --force \
  || { [ $$? -eq 1 ] && [ bozzini-demo/summary.json -nt $(VENV)/.demo-begins ]; }

# The stamps hold the path of this checkout: an environment that was moved, or whose Python has
# gone, is set up anew.
SOUND := $(shell [ "$$(cat $(CORE) 2>/dev/null)" = "$$(pwd)" ] && $(RUN) -c "" 2>/dev/null && echo yes)
ifneq ($(SOUND),yes)
$(shell rm -f $(CORE) $(DEV) $(DOCS) $(READ))
endif

RIG_TOOLS := $(RUN) -c 'from bozzini.rig.firmware import find_missing_tools as f; print(*f().values())'

.PHONY: help demo test test-all compiled read kernels rig opencv oldest fuzz bench validate dist docs docs-bare check format picture figures gallery thesis clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "make %-9s %s\n", $$1, $$2}' Makefile

demo: $(CORE) ## Plan a scope through a phantom tract; report in bozzini-demo/
	@$(DEMO)

test: compiled read ## Run the tests
	@BOZZINI_COMPILED=yes $(RUN) -m pytest -m "not slow" -n $(WORKERS) --dist worksteal

# Files without slow tests need not be read.
SLOW_TESTS = $(sort $(shell grep -rl --include='test_*.py' 'mark\.slow' tests))

test-all: test opencv ## Run all tests, those that take minutes too
	@$(RUN) -m pytest -m slow -n $(WORKERS) --dist worksteal $(SLOW_TESTS)

compiled: $(DEV)
	@$(RUN) -m bozzini doctor --compile --quiet >$(VENV)/doctor.log || { cat $(VENV)/doctor.log >&2; exit 1; }

# Pytest rewrites all tests once and keeps that: several processes would each do it at the same time.
read: $(READ)

$(READ): | $(DEV)
	@$(RUN) -m pytest --collect-only -qq >/dev/null && touch $@

rig: $(DEV) ## Build the firmware and run the tests of the rig (installs nothing)
	@missing="$$($(RIG_TOOLS))" && if [ -n "$$missing" ]; then \
	  echo "make: the firmware needs these, which are missing; on Debian: apt-get install $$missing" >&2; exit 1; fi
	@$(MAKE) --no-print-directory -C firmware BUILD=../build/firmware avr native emulator size
	@$(RUN) -m pytest -n $(WORKERS) --dist worksteal tests/rig

# The modules that call OpenCV, and its commands; what else reads pictures goes through these.
CV_TESTS := $(patsubst %,tests/vision/test_%.py,board calibrate camera commands length pictures shape)

opencv: $(DEV) ## Run the tests of what calls OpenCV with the oldest one, too
	@$(PIP) --no-deps --upgrade --target build/opencv 'opencv-python-headless==4.10.*'
	@PYTHONPATH=build/opencv $(RUN) -c 'import cv2; assert cv2.__version__.startswith("4.10."), cv2.__version__'
	@PYTHONPATH=build/opencv $(RUN) -m pytest -m "not slow" -n $(WORKERS) --dist loadfile $(CV_TESTS)

kernels: $(DEV) ## Record which kernels are called with what types, by all tests
	@rm -rf build/signatures && mkdir -p build/signatures
	@BOZZINI_SIGNATURES=$(CURDIR)/build/signatures $(RUN) -m pytest -n $(WORKERS) --dist worksteal
	@$(RUN) -m tests.compiled build/signatures

oldest: $(DEV) ## Run the tests with the lowest versions declared, in .venv-oldest
	@$(PIP) uv
	@$(RUN) -m uv venv --quiet --clear --python $(RUN) .venv-oldest
	@$(RUN) -m uv pip install --quiet --python .venv-oldest/bin/python --resolution lowest-direct --editable '.[dev]'
	@.venv-oldest/bin/python -m pytest -m "not slow" -n $(WORKERS) --dist loadfile

fuzz: $(DEV) ## Run all commands on damaged files (COUNT=500 SEED=0, CASE= repeats one)
	@$(RUN) -m tests.fuzz --count $(or $(COUNT),500) --seed $(or $(SEED),0) $(if $(CASE),--case $(CASE))

bench: $(DEV) ## Run the benchmarks
	@$(RUN) -m pytest -o addopts= -q -p no:xdist --benchmark-only benchmarks

validate: $(DEV) ## Compare with measured data that are present (SET=festo10 for one of them)
	@$(RUN) validation/report.py $(SET)

check: $(DEV) ## Check style and types
	@$(RUN) -m ruff check --quiet --output-format concise .
	@$(RUN) -m ruff format --quiet --check .
	@$(RUN) -m mypy --no-error-summary
	@$(RUN) -m mypy --no-error-summary validation
	@echo "style and types are clean"

format: $(DEV) ## Put the code into the project's format
	@$(RUN) -m ruff check --quiet --fix-only .
	@$(RUN) -m ruff format --quiet .

dist: $(CORE) ## Build the wheel and the source archive into dist/
	@$(PIP) 'hatchling>=1.24'
	@rm -rf dist
	@$(RUN) -m hatchling build --directory dist >/dev/null
	@ls dist

docs: $(DOCS) ## Build the documentation into site/
	@mkdir -p build/docs # where the tutorials write their files
	@cd build/docs && NO_MKDOCS_2_WARNING=1 $(CURDIR)/$(RUN) -m mkdocs build --strict -f $(CURDIR)/mkdocs.yml \
	  >$(CURDIR)/$(VENV)/docs.log 2>&1 || { cat $(CURDIR)/$(VENV)/docs.log >&2; exit 1; }
	@echo "documentation: site/index.html"

docs-bare: $(DEV) ## Build it without running the tutorials, in an environment of its extra alone
	@$(PIP) uv && rm -rf build/docs-env
	@$(MAKE) --no-print-directory docs VENV=build/docs-env TUTORIALS=false \
	  PIP='$(RUN) -m uv pip install --quiet --python build/docs-env/bin/python'

picture: $(CORE) ## Make the README's picture anew from the project's own demo
	@$(DEMO)
	@mkdir -p docs/images && cp bozzini-demo/picture.png docs/images/demo.png
	@$(RUN) -m bozzini record bozzini-demo/plan.npz --style x-ray --duration 6s --rate 8 \
	  --out docs/images/demo.gif --force

gallery: $(DEV) ## Make the gallery of the documentation anew
	@$(RUN) docs/make_gallery.py

thesis: $(DEV) ## Draw the figures of the thesis anew
	@$(RUN) docs/make_thesis.py

figures: $(CORE) ## Make the figures of the guide anew from the examples
	@mkdir -p docs/images
	@$(RUN) examples/breathing.py --out docs/images/breathing.png
	@$(RUN) examples/bicycle_chain.py --out docs/images/bicycle_chain.png
	@$(RUN) examples/duct_family.py --out docs/images/duct_family.png
	@$(RUN) examples/fabricate.py --out docs/images/fabricate.png
	@echo "figures: docs/images/"

clean: ## Remove what was built (not .venv)
	@rm -rf bozzini-demo bozzini-plan fuzz-failures site dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	@find src tests benchmarks docs -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

$(RUN):
	@chosen=; noted=; \
	for python in $${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11 python}; do \
	  "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || continue; \
	  "$$python" -c 'import ensurepip, venv' 2>/dev/null || { noted="$$python"; continue; }; \
	  chosen="$$python"; break; \
	done; \
	if [ -z "$$chosen" ] && [ -n "$$noted" ]; then \
	  echo "make: $$noted has no 'venv' with pip (Debian, Ubuntu: apt install python3-venv)" >&2; exit 1; \
	elif [ -z "$$chosen" ]; then \
	  echo "make: needs Python 3.11 or newer, found none among: $${PYTHON:-python3, python3.11 to python3.14, python}" >&2; exit 1; \
	fi; \
	"$$chosen" -m venv --clear $(VENV)

$(CORE): pyproject.toml | $(RUN)
	@$(RUN) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && $(RUN) -m pip --version >/dev/null 2>&1 \
	  || { rm -rf $(VENV); $(MAKE) --no-print-directory $(RUN); }
	@echo "setting up $(VENV) (once, about a minute) ..." >&2
	@$(PIP) --editable . || { echo "make: could not install the dependencies, see above" >&2; exit 1; }
	@pwd > $@

$(DEV): $(CORE)
	@echo "adding what the tests and checks need ..." >&2
	@$(PIP) --editable '.[dev]' || { echo "make: could not install the dependencies, see above" >&2; exit 1; }
	@touch $@

$(DOCS): $(CORE)
	@echo "adding what the documentation needs ..." >&2
	@$(PIP) --editable '.[docs]' || { echo "make: could not install the dependencies, see above" >&2; exit 1; }
	@touch $@
