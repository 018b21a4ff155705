# Two commands do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := windmark-demo
# A file of tests is run by one process; two files at a time halve the wait on two cores.
TEST_PROCESSES ?= 2

.PHONY: demo test docs bench paper-map clean

demo: $(VENV)/.installed
	$(BIN)/windmark demo $(DEMO)

test: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest --numprocesses $(TEST_PROCESSES) --dist loadfile

# The documentation site, build/docs/index.html; a link that leads nowhere is an error. No network is needed.
docs: $(VENV)/.installed-docs
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs build/docs

# Every command of docs/paper-map.md, from start to end (some eight minutes).
paper-map: $(VENV)/.installed
	$(BIN)/python docs/run_paper_map.py

bench: $(VENV)/.installed-test
	$(BIN)/python benchmarks/run.py

# The project's own versions are pinned in constraints.txt; pip finds them where it is configured to look.
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[test]"
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet -e ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) $(DEMO) build dist
