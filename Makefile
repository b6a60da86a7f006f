# `make` or `make help` lists what there is to make. Everything is built in .venv.

VENV := .venv
BIN := $(VENV)/bin
# The newest supported Python on the machine; `make PYTHON=...` chooses another.
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 15))' \
	2>/dev/null && echo $$p && break; done)

# Python keeps what it compiled of imported modules; the suite's processes would compile it again.
export PYTHONDONTWRITEBYTECODE :=

# Install the package with the extras $(1) and the tested versions: by uv, or by pip where uv fails.
# Both compile the bytecode, which each process would compile again where Python may not write it.
# `make PIP=1` uses pip alone.
TESTED := -q -c constraints.txt
install = { test -z "$(PIP)" && $(BIN)/python -m uv pip install --python $(BIN)/python $(TESTED) \
	--compile-bytecode --build-constraint constraints.txt -e '.[$(1)]'; } || \
	$(BIN)/python -m pip install --disable-pip-version-check $(TESTED) -e '.[$(1)]'

# Commas separate the arguments of `call`, so that lists need names.
DEMO_EXTRAS := dynamics,experiment,drawings,studio
DOCS_EXTRAS := test,docs

# 150 MB of C++ headers that come with pinocchio and that no program here reads.
HEADERS = $(VENV)/lib/python3*/site-packages/cmeel.prefix/include/boost

# Run the suite in an environment of its own, $(1), with versions that the options $(2) choose.
define suite_with
	$(BIN)/python -m uv venv -q --clear --python $(BIN)/python $(VENV)/$(1)
	$(BIN)/python -m uv pip install -q --python $(VENV)/$(1) $(2) -e '.[test]'
	NUMBA_CACHE_DIR=$(CURDIR)/$(VENV)/$(1)/cache $(VENV)/$(1)/bin/armcontour compile
	NUMBA_CACHE_DIR=$(CURDIR)/$(VENV)/$(1)/cache $(VENV)/$(1)/bin/python -m pytest -q -n auto
endef

# The files of compiled functions, and the list of what they are called with.
COMPILED := $(shell grep -rl --include='*.py' '^@compiled' src/armcontour) src/armcontour/core/kernels.txt

# Where the site is built.
SITE := docs/_build/html
# What Sphinx has read. It goes when a page has a warning, which Sphinx would not repeat.
READ := docs/_build/read

# What developers of the Studio's page need of node: bundles, and types.
TOOLS := tools/vendor
TSC := $(TOOLS)/node_modules/.bin/tsc

.DEFAULT_GOAL := help
.PHONY: help demo test slow newest lowest plain constraints check packing types layers page package release docs site links soak bench figures kernels vendor clean

help:  ## List the targets
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-8s %s\n", $$1, $$2}'

demo: $(VENV)/base-usual  ## Run the paper's job and cut a plate with a UR5e; print where the report is
	$(BIN)/armcontour demo --out demo --force

test: $(VENV)/test-all  ## Run the whole test suite, on all cores
	$(BIN)/python -m pytest -n auto --durations 15

slow: $(VENV)/test-all docs package  ## Run the tests that need time, processes, signals or a browser, and try the wheel
	$(BIN)/python -m pytest -q -n auto tests/slow docs/site
	$(BIN)/python -m soak playing --jobs 1 --count 30
	@if command -v halcmd >/dev/null; then \
		$(BIN)/python -m soak.paper_table && $(BIN)/python -m soak.robot_loop; \
		else echo "Table I was not played: LinuxCNC is not installed (apt-get install linuxcnc-uspace)."; fi
	$(BIN)/python tools/try_package.py dist --install

newest: $(VENV)/bin/python  ## Run the suite with the newest versions of all dependencies
	$(call suite_with,newest,--upgrade)

lowest: $(VENV)/bin/python  ## Run the suite with the lowest versions of the dependencies
	$(call suite_with,lowest,--resolution lowest-direct)

# pinocchio needs a newer NumPy than the package.
plain: $(VENV)/bin/python  ## Run the suite with the lowest versions, without the extra dynamics
	$(call suite_with,plain,--resolution lowest-direct --override tools/without_dynamics.txt)

constraints: $(VENV)/bin/python  ## Write the newest versions to constraints.txt, which `make test` then tests
	printf '%s\n' hatchling uv | $(BIN)/python -m uv pip compile -q --upgrade --universal --python-version 3.11 \
		--all-extras --no-header --no-annotate -o $(VENV)/constraints.txt pyproject.toml -
	{ echo '# The versions with which the suite passed, by make constraints.'; \
		cat $(VENV)/constraints.txt; } > constraints.txt
	sed -i.old "s/rev: v.*/rev: v$$(sed -n 's/^ruff==//p' constraints.txt)/" .pre-commit-config.yaml
	rm .pre-commit-config.yaml.old

check: $(VENV)/dev  ## Check format, lint, packed statements, types and layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@$(MAKE) --no-print-directory packing
	@$(MAKE) --no-print-directory types
	@$(MAKE) --no-print-directory layers
	@$(MAKE) --no-print-directory page

packing: $(VENV)/dev  ## Check that no assignment packs several statements into one
	$(BIN)/python -m tools.packing

types: $(VENV)/dev  ## Check the types of the package
	$(BIN)/mypy

layers: $(VENV)/dev  ## Check which packages import which
	$(BIN)/lint-imports

page:  ## Check the types of the Studio's page, where node is found
	@if [ -x $(TSC) ] || { command -v npm >/dev/null && npm --prefix $(TOOLS) ci --silent; }; then \
		echo "$(TSC) --project $(TOOLS)/tsconfig.json" && $(TSC) --project $(TOOLS)/tsconfig.json; \
	else \
		echo "The types of the Studio's page were not checked: that needs node with npm, and its registry."; \
	fi

package: $(VENV)/dev  ## Build the source archive and the wheels, compare their files, and try the wheels
	rm -rf dist
	UV_BUILD_CONSTRAINT=$(CURDIR)/constraints.txt PIP_CONSTRAINT=$(CURDIR)/constraints.txt \
		$(BIN)/python -m build --installer $(if $(PIP),pip,uv) --outdir dist > $(VENV)/build.log 2>&1 || { cat $(VENV)/build.log; exit 1; }
	$(BIN)/python -m tools.ship dist
	$(BIN)/python tools/try_package.py dist

release: $(VENV)/bin/python  ## Check that a release can be built (TAG=v1.2.3: that of a tag), and build its archives
	$(BIN)/python tools/release.py check $(TAG)
	@$(MAKE) --no-print-directory package

soak: $(VENV)/test  ## Hours: random problems, broken files, signals; each judged independently
	$(BIN)/python -m soak
	$(BIN)/python -m soak.gcode
	$(BIN)/python -m tests.oracle.toppra_kept
	$(BIN)/python -m pytest tests/properties -m hypothesis --hypothesis-profile soak -n auto

bench: $(VENV)/bench  ## Measure speed, and say what became slower than benchmarks/baseline.json
	$(BIN)/python -m benchmarks

docs: $(VENV)/pictures  ## Build the documentation as a site
	rm -rf $(SITE)
	$(BIN)/python -m sphinx -b html -d $(READ) -j auto -W --keep-going -q docs $(SITE) || { rm -rf $(READ); exit 1; }
	@echo "The documentation is built: file://$(CURDIR)/$(SITE)/index.html"

site: docs $(VENV)/test-all  ## Build the site and test it: its code, links, names, and accessibility in a browser
	$(BIN)/python -m pytest -q -n auto docs/site tests/test_docs_*.py tests/test_examples.py tests/slow/docs

links: $(VENV)/docs  ## Ask other people's sites whether the links to them still lead somewhere
	$(BIN)/python -m sphinx -b linkcheck -q docs docs/_build/links

figures: $(VENV)/docs  ## Draw the figures of docs/ and of its gallery
	$(BIN)/python -m docs.figures
	$(BIN)/python -m docs.gallery

kernels: $(VENV)/test  ## Rewrite the list of what compiled functions are called with
	$(BIN)/python -m tools.kernels

vendor:  ## Bundle what reports and the Studio's page take from others (needs node)
	npm --prefix $(TOOLS) ci
	node $(TOOLS)/build.mjs

clean:  ## Remove the environment, the demo's results, and what was built
	rm -rf $(VENV) demo dist docs/_build docs/reference/pages docs/gallery/*.md

$(VENV)/bin/python:
	@test -n "$(PYTHON)" || { echo "armcontour needs Python 3.11 to 3.14 with its venv module; none was found." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt uv || \
		echo "uv could not be installed: pip takes its place."

$(VENV)/base: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(call install,$(DEMO_EXTRAS))
	@rm -rf $(HEADERS)
	@touch $@

$(VENV)/test: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(call install,test)
	@touch $@

# What is compiled at its first use is compiled here, once for each state of the sources.
$(VENV)/base-usual: $(VENV)/base $(COMPILED)
	$(BIN)/armcontour compile usual
	@touch $@

$(VENV)/test-all: $(VENV)/test $(COMPILED)
	$(BIN)/armcontour compile
	@touch $@

# Pictures are drawn again when their programs change; `make figures` draws them at any time.
$(VENV)/pictures: $(VENV)/docs $(wildcard docs/figures/*.py docs/gallery/*.py examples/*.py)
	$(BIN)/python -m docs.figures > /dev/null & drawing=$$!; \
		$(BIN)/python -m docs.gallery > /dev/null && wait $$drawing
	@touch $@

$(VENV)/bench: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(call install,bench)
	@touch $@

$(VENV)/docs: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(call install,$(DOCS_EXTRAS))
	@touch $@

$(VENV)/dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(call install,dev)
	@touch $@
