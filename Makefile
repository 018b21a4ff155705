# Two commands do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEMO   := windmark-demo

.PHONY: demo test bench paper-map clean

demo: $(VENV)/.installed
	$(BIN)/windmark demo $(DEMO)

test: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest

# Every command of docs/paper-map.md, from start to end (some fifteen minutes).
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

clean:
	rm -rf $(VENV) $(DEMO) build dist
