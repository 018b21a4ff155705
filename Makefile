# Two commands do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := windmark-demo
# Two processes halve the wait on two cores. Each takes whole files, so that what the tests of one share is made once;
# in the order of their names: whole jobs (tests/app) come early, and no long file is left to one process at the end.
TEST_PROCESSES ?= 2
PYTEST := $(BIN)/pytest --numprocesses $(TEST_PROCESSES) --dist loadfile --no-loadscope-reorder

# Hundreds of commands are started: compiled once, not by each of them, whatever the machine has set.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all test-costs lint docs pictures wheel bench paper-map clean

demo: $(VENV)/.installed
	$(BIN)/windmark demo $(DEMO)

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Kernels before tests: else each of the processes that share the tests compiles the same ones.
KERNELS := $(shell find src -path '*/_[!_]*' -name '*.py')
$(VENV)/.compiled: $(VENV)/.installed-test $(KERNELS)
	$(BIN)/windmark warmup
	touch $@

# What every change is tried with: all but the tests that are marked slow.
test: lint $(VENV)/.compiled
	$(PYTEST) -m "not slow"

# Everything, as continuous integration runs it.
test-all: lint $(VENV)/.compiled
	$(PYTEST)

# CPU seconds of every test, the dearest first: those of over 1.5 seconds are to be marked slow.
test-costs: $(VENV)/.installed-test $(VENV)/.compiled
	$(PYTEST) --costs test-costs.csv

# The documentation site, build/docs/index.html; a link that leads nowhere is an error. No network is needed.
docs: $(VENV)/.installed-docs
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs build/docs

# The pictures of the documentation, all of them made by windmark: two minutes of CPU time. Those of reports and the viewer need
# Chromium, those of NASA's plate its data in ../shared.
MADE := build/pictures
pictures: $(VENV)/.installed-test $(VENV)/.compiled
	rm -rf $(MADE)
	$(BIN)/python docs/make_pictures.py
	$(BIN)/windmark simulate $(MADE)/test
	$(BIN)/python docs/view_picture.py $(MADE)/test/project.toml
	$(BIN)/windmark simulate $(MADE)/wing --deforming 4
	$(BIN)/windmark align $(MADE)/wing/images/cam1-0000.tif $(MADE)/wing/images/cam1-0003.tif -o $(MADE)/aligned
	$(BIN)/windmark run examples/nasa-upsp-cam5.toml -o $(MADE)/nasa
	$(BIN)/python docs/report_pictures.py $(MADE)/nasa/report.html $(MADE)/aligned/report.html

# dist/windmark-...whl for this system and Python, with compiled kernels: whoever installs it compiles nothing.
wheel: $(VENV)/.installed
	$(BIN)/python packaging/compiled_wheel.py dist

# Every command of docs/paper-map.md, from start to end (some eight minutes).
paper-map: $(VENV)/.installed
	$(BIN)/python docs/run_paper_map.py

bench: $(VENV)/.installed-test
	$(BIN)/python benchmarks/run.py

# Bytecode is made of what is imported, not of all libraries (half a minute).
# The project's own versions are pinned in constraints.txt; pip finds them where it is configured to look.
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile -c constraints.txt -e .
	touch $@

# All at once: on a fresh machine pip runs a single time.
$(VENV)/.installed-test: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile -c constraints.txt -e ".[test]"
	touch $(VENV)/.installed $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --no-compile -c constraints.txt -e ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) $(DEMO) build dist test-costs.csv
