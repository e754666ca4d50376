# `make demo` and `make test` need nothing but Python >= 3.10: the first call makes .venv and installs into it.
PYTHON ?= python3
BIN := .venv/bin

# uv takes the certificates of the system, as pip does.
export UV_SYSTEM_CERTS ?= 1

# Tests of kernels that are run once more as Numba compiles them without the project's own passes, kernels/parts.py.
WITHOUT_PASSES := tests/unit/kernels/test_rigid.py tests/unit/kernels/test_random_numbers.py tests/unit/kernels/test_qp.py

# Tests that run once more with the oldest Pinocchio that is supported: what asks most of its models.
WITH_PINOCCHIO := $(addprefix tests/unit/robots/,test_models.py test_robot.py test_tools_and_bases.py test_joint_names.py) tests/unit/integrations

.PHONY: demo test oldest installs quick lint examples docs gallery clean FORCE

demo: .venv/.ready ## solve random poses with both redundancy methods and the plain reference, compare them
	$(BIN)/maira-qp compare --picture output/comparison.png

test: .venv/.ready ## run the tests; those of the kernels again as plain Python, where an index out of bounds is an error; some as other processors round
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --dist loadgroup
	OMP_NUM_THREADS=1 NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q -n auto tests/unit/kernels tests/conformance/kernels
	OMP_NUM_THREADS=1 OPENBLAS_CORETYPE=Haswell $(BIN)/python -m pytest -q -n auto -m rounding
	OMP_NUM_THREADS=1 OPENBLAS_CORETYPE=Prescott NUMBA_CPU_NAME=generic $(BIN)/python -m pytest -q -n auto -m rounding
	OMP_NUM_THREADS=1 MAIRA_QP_INLINE=0 $(BIN)/python -m pytest -q -n 0 $(WITHOUT_PASSES)

oldest: .venv-oldest/.ready ## run the tests of models beside what LeRobot installs, .ci/oldest.txt
	OMP_NUM_THREADS=1 .venv-oldest/bin/python -m pytest -q -n auto $(WITH_PINOCCHIO)

installs: install-3.10 install-3.12 install-3.13 install-lowest ## install the wheel on each of these Pythons that is here, use it, uninstall it

install-%: output/wheel/.built
	$(BIN)/python .ci/install.py $* output/wheel/*.whl

output/wheel/.built: .venv/.ready FORCE
	rm -rf output/wheel
	$(BIN)/uv build --quiet --python $(BIN)/python --out-dir output/wheel
	touch $@

quick: .venv/.ready ## run the unit tests alone: about a minute once the kernels are compiled
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q -n auto --dist loadgroup tests/unit

lint: .venv/.ready ## style, types, and the import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

examples: .venv/.ready ## run every example; pictures go to output/
	for example in examples/*.py; do echo "== $$example"; $(BIN)/python $$example || exit 1; done

docs: .venv/.ready ## build the documentation site into site/, without a network; a warning is an error
	NO_MKDOCS_2_WARNING=1 OMP_NUM_THREADS=1 $(BIN)/mkdocs build --quiet

gallery: examples ## take the pictures of the examples into the documentation's gallery, and draw its figures
	$(BIN)/python docs/builder/gallery.py
	$(BIN)/python docs/builder/figures.py

.venv/.ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip uv
	$(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python --editable '.[dev]' || $(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

.venv-oldest/.ready: pyproject.toml .ci/oldest.txt
	$(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet --upgrade pip
	.venv-oldest/bin/python -m pip install --quiet --editable '.[qp,time,closed-form]' -r .ci/oldest.txt \
		pytest pytest-xdist hypothesis mpmath yourdfpy example-robot-data rtb-data
	touch $@

clean: ## remove the environment and what was produced
	rm -rf .venv .venv-oldest output site
