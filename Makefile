# `make demo` and `make test` need nothing but Python >= 3.10: the first call makes .venv and installs into it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint examples clean

demo: .venv/.ready ## solve random poses with both redundancy methods and the plain reference, compare them
	$(BIN)/maira-qp compare --picture output/comparison.png

test: .venv/.ready ## run the tests, and those of the kernels again as plain Python, where an index out of bounds is an error
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --dist loadgroup
	OMP_NUM_THREADS=1 NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q -n auto tests/test_kernels_*.py

lint: .venv/.ready ## style, types, and the import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

examples: .venv/.ready ## run every example; pictures go to output/
	for example in examples/*.py; do echo "== $$example"; $(BIN)/python $$example || exit 1; done

.venv/.ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

clean: ## remove the environment and what was produced
	rm -rf .venv output
