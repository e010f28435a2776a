# Only Python 3.11, pip and make are needed; everything else goes into .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.polaropt-installed
PLAIN := $(VENV)/.polaropt-without-extras
DOCS_STAMP := $(VENV)/.docs-installed
DOCS := docs/_build/html
PEERS := .venv-peers
# Bytecode is made of what is imported, when it is: here at least, also where it is not wanted, as in many containers.
unexport PYTHONDONTWRITEBYTECODE
INSTALL := $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt
COMPILE := $(BIN)/python -c "from polaropt.kernels import compile_kernels; compile_kernels()"
# Tests run side by side in so many processes.
WORKERS ?= 2
MINUTES ?= 10
KILLS ?= 30
N ?= 60

.DEFAULT_GOAL := help
.PHONY: help setup demo test fuzz crash mutants lint package docs linkcheck peers clean

help:
	@echo "make demo   set up, separate an example and name the pictures to look at"
	@echo "make test   set up and run the tests"
	@echo "make fuzz   attack it with damaged files and random command lines on fresh seeds, for MINUTES=10"
	@echo "make crash  kill commands at random moments, each KILLS=30 times (ONLY=train: one of them), and look at what is left"
	@echo "make mutants  break N=60 lines one by one and see whether the tests of their modules catch it"
	@echo "make lint   set up and run ruff and mypy"
	@echo "make package  build wheel and source distribution, and try them on every Python there is"
	@echo "make docs   set up and build the documentation: $(DOCS)/index.html"
	@echo "make linkcheck  ask the network whether the documentation's links lead somewhere"
	@echo "make peers  build $(PEERS), the environment of a peer in studies.peers"
	@echo "make setup  only set up ($(VENV) in this folder)"
	@echo "make clean  remove everything that the above made"

setup: $(STAMP)

# Touched last, so that an interrupted installation starts again.
$(STAMP): pyproject.toml constraints.txt
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable ".[app,batch,casadi,dev,heif,plot,raw,sequence,studies,torch]"
	touch $@ $(PLAIN)

# What a separation needs, and nothing else.
$(PLAIN): pyproject.toml constraints.txt
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable .
	touch $@

demo: $(PLAIN)
	$(BIN)/polaropt demo --output demo-output

# Kernels first, once, on all cores: side by side the processes of tests would all compile the same.
test: setup
	$(COMPILE)
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal $(PYTEST_OPTIONS)

fuzz: setup
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES) --keep fuzz-output $(if $(OUT),-o $(OUT))

crash: setup
	$(BIN)/python -m tests.crash --kills $(KILLS) $(if $(ONLY),--only $(ONLY)) $(if $(OUT),-o $(OUT))

# With OUT=studies/results this and the two above keep what came out. Beside a sample that is always the same, SEED=1 and so on break other lines.
mutants: setup
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[mutants]"
	$(BIN)/python -m tests.mutants --number $(N) --seed $(or $(SEED),0) $(if $(OUT),-o $(OUT))

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

package:
	PYTHON=$(PYTHON) .ci/package

$(DOCS_STAMP): $(STAMP) pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[docs]"
	touch $@

# The gallery's scripts run when it is built; those that did not change are not run again.
docs: $(DOCS_STAMP)
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet docs $(DOCS)
	$(BIN)/python docs/check_links.py $(DOCS)

linkcheck: $(DOCS_STAMP)
	$(BIN)/python -m sphinx --builder linkcheck --quiet -D plot_gallery=0 docs docs/_build/linkcheck

# It needs an older numpy than polaropt does.
peers: $(PEERS)/.installed

$(PEERS)/.installed: studies/peers/requirements.txt
	test -x $(PEERS)/bin/pip || $(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --requirement $<
	touch $@

clean:
	rm -rf $(VENV) $(PEERS) demo-output fuzz-output build dist docs/_build docs/auto_gallery docs/api/generated .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
