PYTHON ?= python

.PHONY: lint test test-nojit test-bounds attack docs gallery examples bench dist clean

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

bench:
	$(PYTHON) benchmarks/limiting.py

# One pure wheel and one source distribution, checked.  Needs: pip install build twine
dist:
	$(PYTHON) -m build --outdir dist
	$(PYTHON) -m twine check --strict dist/*

clean:
	rm -rf .numba_cache .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist
	rm -rf docs/_build docs/api docs/gallery docs/project docs/results
	rm -f bracket.vtu bracket.png attack.jsonl corpus.md corpus.md.jsonl
