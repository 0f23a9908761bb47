PYTHON ?= python

.PHONY: lint test test-nojit test-bounds attack docs gallery examples bench dolfinx clean

lint:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy
	lint-imports

test:
	$(PYTHON) -m pytest -n 2

test-nojit:
	NUMBA_DISABLE_JIT=1 $(PYTHON) -m pytest tests/kernels

# A cache of its own: numba does not distinguish kernels with bounds checks from those without.
test-bounds:
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/.numba_cache/bounds $(PYTHON) -m pytest tests/kernels tests/laws

# 20 000 random cases from a new seed, which is printed; CASES and SEED choose others.
CASES ?= 20000
attack:
	$(PYTHON) -m tests.attack --cases $(CASES) $(if $(SEED),--start $(SEED)) --report attack.jsonl

# Warnings are errors; nothing is fetched.
docs:
	$(PYTHON) -m sphinx -W --keep-going docs docs/_build

# Run the examples and put their pictures into docs/figures.
gallery:
	$(PYTHON) docs/_ext/refresh_pictures.py $(NAMES)

examples:
	set -e; for script in examples/*.py; do [ -e "$$script" ] || continue; $(PYTHON) "$$script"; done

# In an environment of its own, with DOLFINx and PETSc from the wheel dolfinx-solver-real:
#   python3.12 -m venv .dolfinx && .dolfinx/bin/pip install -e ".[mmg]" dolfinx-solver-real pytest \
#       pytest-timeout hypothesis
DOLFINX_PYTHON ?= .dolfinx/bin/python
dolfinx:
	PATH="$(dir $(abspath $(DOLFINX_PYTHON))):$$PATH" $(DOLFINX_PYTHON) -m pytest tests/dolfinx

bench:
	$(PYTHON) benchmarks/limiting.py

clean:
	rm -rf .numba_cache .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist
	rm -rf docs/_build docs/api docs/gallery docs/project docs/results
	rm -f bracket.vtu bracket.png attack.jsonl corpus.md corpus.md.jsonl
