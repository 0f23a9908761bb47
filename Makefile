PYTHON ?= python

.PHONY: lint test targets pages test-nojit test-bounds lowest attack docs gallery examples bench bench-compare dolfinx dist clean

lint:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy
	lint-imports

test:
	$(PYTHON) -m pytest -n 2 --dist loadfile

# Files are opened in the programs that they are for; what is not installed is skipped.  Debian has
# calculix-ccx, freefem++ and libfreefem++.  pyNastran needs an environment of its own: NASTRAN_PYTHON is its Python.
targets: export ADAPTSIZE_TARGETS = 1
targets:
	$(PYTHON) -m pytest -rs tests/targets

# The code of the pages as it stands, compared with the output that they show; `make test` uses coarser data.
# NAMES chooses pages: make pages NAMES="stl or coast"
pages:
	ADAPTSIZE_PAGES=full $(PYTHON) -m pytest tests/test_docs.py -k "code_of_a_page and ($(or $(NAMES),md))"

# Kernels as plain Python: their tests, and random calls of the public functions.  Prints which share of
# the lines was executed.  Scalars of numpy warn where compiled code does not.
test-nojit: export NUMBA_DISABLE_JIT = 1
test-nojit:
	$(PYTHON) -m coverage run -m pytest -W ignore::RuntimeWarning tests/kernels
	$(PYTHON) -m coverage run --append -m tests.attack --jobs 0 --start 20260214 --cases $(PLAIN_CASES) --only calls
	$(PYTHON) -m coverage report --skip-covered
PLAIN_CASES ?= 300

# Kernels with checks of array bounds, optimised less, which compiles sooner.  A cache of its own: numba
# does not distinguish them.
test-bounds attack: export NUMBA_BOUNDSCHECK = 1
test-bounds attack: export NUMBA_OPT = 1
test-bounds: export ADAPTSIZE_PROBLEMS = 200
test-bounds attack: export NUMBA_CACHE_DIR := $(or $(NUMBA_CACHE_DIR),$(CURDIR)/.numba_cache)/bounds
test-bounds:
	$(PYTHON) -m pytest -n 2 --dist loadfile tests/kernels tests/limiting/exact \
		tests/adaptation/test_transfer.py tests/background/test_location.py \
		tests/background/test_octree_location.py

# Tests with the lowest versions of the dependencies, in fresh environments.
lowest:
	.ci/lowest

# 20 000 random cases from a new seed, which is printed, with checks of array bounds; CASES and SEED
# choose others.
CASES ?= 20000
attack:
	$(PYTHON) -m tests.attack --cases $(CASES) $(if $(SEED),--start $(SEED))

# Warnings are errors; nothing is fetched.
SITE ?= docs/_build
docs:
	$(PYTHON) -m sphinx -j auto -W --keep-going $(SPHINXOPTS) docs $(SITE)
	$(PYTHON) docs/_ext/check_site.py $(SITE)

# Run the examples and put their pictures into docs/figures.
gallery:
	$(PYTHON) docs/_ext/refresh_pictures.py $(NAMES)
	$(if $(NAMES),,$(PYTHON) docs/_ext/make_growth.py)

examples:
	set -e; for script in examples/*.py; do [ -e "$$script" ] || continue; $(PYTHON) "$$script"; done

# In an environment of its own, with DOLFINx and PETSc from the wheel dolfinx-solver-real:
#   python3.12 -m venv .dolfinx && .dolfinx/bin/pip install -e ".[mmg]" dolfinx-solver-real pytest \
#       pytest-timeout hypothesis
DOLFINX_PYTHON ?= .dolfinx/bin/python
dolfinx:
	PATH="$(dir $(abspath $(DOLFINX_PYTHON))):$$PATH" $(DOLFINX_PYTHON) -m pytest tests/with_dolfinx

bench:
	$(PYTHON) benchmarks/limiting.py

# Paired runs of two commits, and the ratios of their times: make bench-compare OLD=v0.1.0 NEW=HEAD
OLD ?= HEAD~1
NEW ?= HEAD
bench-compare:
	$(PYTHON) benchmarks/compare.py $(OLD) $(NEW)

# One pure wheel and one source distribution, checked.  Needs: pip install build twine
dist:
	$(PYTHON) -m build --outdir dist
	$(PYTHON) -m twine check --strict dist/*

clean:
	rm -rf .numba_cache .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist
	rm -rf docs/_build docs/api docs/gallery docs/notebooks docs/project docs/results
	rm -f .coverage bracket.vtu bracket.png surfaces.md surfaces.md.jsonl wild.md wild.md.jsonl
