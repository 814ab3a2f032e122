# Two commands are enough: `make demo` and `make test`. `make` alone lists them all.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := .ci/install $(BIN)/python
# Versions that were tested, with the hashes of their files; `make demo LOCK=` takes the newest that pyproject.toml allows.
LOCK ?= locks
# What each lock file is of: extras of pyproject.toml.
EXTRAS_use := sim
EXTRAS_dev := dev
EXTRAS_docs := docs
EXTRAS_image := sim postgresql export dbc xacro s3 mqtt opcua
comma := ,
space := $(subst ,, )
# install NAME MORE: what locks/NAME.txt lists, then this project and others; nothing is downloaded without a hash.
install = @$(if $(LOCK),$(PIP) --require-hashes -r $(LOCK)/$(1).txt && $(PIP) --no-deps --no-build-isolation -e . $(2),\
  $(PIP) -e ".[$(subst $(space),$(comma),$(EXTRAS_$(1)))]" $(2))
# Of each target that is fuzzed; FUZZ names some of them, all without it.
FUZZ_SECONDS ?= 60
FUZZ ?=
# Tests at once; what is not said is by what the tests do. All of them wait for buses, children and recordings a third of
# the time; of the quick ones a third worker on two cores gained 2 of 75 s, for a third more of processor time.
JOBS ?=
PYTEST := $(BIN)/pytest --dist loadfile --no-loadscope-reorder
# Tests start hundreds of Python processes; none should compile again what another has compiled.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test test-quick test-socketcan test-compose test-fresh fuzz check generated bench docs picture readme paper page lock changelog release clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/make \1|\2/p' Makefile | while IFS='|' read -r name text; do \
	  printf '%-16s %s\n' "$$name" "$$text"; done

demo: $(VENV)/.use ## the whole job on a simulated machine, about two minutes; everything goes to hilfit-demo/
	$(BIN)/hilfit demo

test: $(VENV)/.dev ## every test and, beside them, the checks; what failed is listed at the end
	$(BIN)/ruff check .
	@$(MAKE) --no-print-directory check > $(VENV)/check.log 2>&1 & checking=$$!; \
	$(PYTEST) -n $(or $(JOBS),3) --durations 20; tested=$$?; \
	wait $$checking; checked=$$?; \
	if [ $$checked = 0 ]; then echo 'checks: passed ($(VENV)/check.log)'; else cat $(VENV)/check.log; fi; exit $$((tested | checked))

test-quick: $(VENV)/.dev ## the tests that are not marked slow; says at the end which those are
	$(PYTEST) -n $(or $(JOBS),2) -m "not slow" --durations 5 -p no:schemathesis

test-socketcan: $(VENV)/.dev ## the drivers on AF_CAN, in user-mode Linux with a virtual bus; two minutes at most
	$(BIN)/python tests/daq/user_mode_linux.py

test-fresh: ## make demo and make test on new machines: Debian 12 and 13, root and a user (needs root; ARGUMENTS="trixie --as user")
	@$(PYTHON) tests/project/fresh_machines.py $(ARGUMENTS)

fuzz: $(VENV)/.dev ## coverage-guided fuzzing of the parsers, FUZZ_SECONDS (60) for each; skipped without the extra fuzz
	$(BIN)/python tests/daq/fuzz_parsers.py --seconds $(FUZZ_SECONDS) $(FUZZ)

check: $(VENV)/.dev ## ruff, mypy --strict, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

generated: $(VENV)/.dev ## what is made of the sources and kept: descriptions of REST and of reports, and the page (needs Node 20)
	$(BIN)/python -m server.commands.openapi_file
	$(BIN)/python -m fitting.report.schema.file
	@$(MAKE) --no-print-directory page

bench: $(VENV)/.dev ## the benchmarks that have a target, see benchmarks/README.md
	$(BIN)/hilfit bench samples
	$(BIN)/hilfit bench demo

docs: $(VENV)/.docs ## the documentation site, with its examples run (minutes); warnings are errors; docs/_build/html
	MPLBACKEND=Agg $(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo 'docs/_build/html/index.html'

picture: $(VENV)/.dev ## the picture on the first screen, made anew
	$(BIN)/python -m benchmarks.picture docs/_static/before-after.png

readme: $(VENV)/.dev ## the result of the demonstration in README.md, made anew
	$(BIN)/python -m benchmarks.demonstration

paper: $(VENV)/.dev ## the page of the claims with its figures, made anew
	$(BIN)/hilfit bench paper --page docs/paper.md

page: ## build the web page (needs Node 20; what it makes is committed, so that nobody else does)
	cd server/web && npm ci && npm run check && npm test && npm run build

COMPILE = $(BIN)/uv pip compile --universal --python-version 3.11 --quiet --no-annotate --no-header --no-emit-index-url \
  --no-emit-find-links pyproject.toml

lock: $(VENV)/.dev ## the files in locks/, anew, with the newest versions that pyproject.toml allows
	@$(COMPILE) --all-extras --upgrade > locks/all.new
	@for name in use dev docs image; do $(MAKE) --silent locks/$$name.txt.new || exit 1; done
	@for name in use dev docs image; do mv locks/$$name.txt.new locks/$$name.txt; done; rm locks/all.new

# The project itself is built with the setuptools that is locked, not with one that pip fetches for it.
locks/%.txt.new: FORCE
	@{ echo '# Versions that hilfit was tested with, and hashes of their files; made by: make lock'; \
	  echo 'setuptools>=77' | $(COMPILE) - $(EXTRAS_$*:%=--extra %) --constraint locks/all.new --generate-hashes; } > $@

FORCE:

test-compose: $(VENV)/.dev ## docker-compose.yml itself: built, up, a worker killed, backed up, upgraded; ten minutes at most
	$(BIN)/python tests/project/composition/run.py

changelog: $(VENV)/.dev ## CHANGELOG.md from the fragments in news/, which are deleted: make changelog VERSION=0.1.0
	$(BIN)/towncrier build --yes --version "$${VERSION:?say which, as in: make changelog VERSION=0.1.0}"

release: $(VENV)/.dev ## wheel, sources, bill of materials (CycloneDX), signed checksums, in dist/: make release KEY=~/.ssh/hilfit_release
	@$(BIN)/python deploy/release.py --key "$(KEY)"

$(VENV)/.docs: $(VENV)/.dev $(LOCK:%=%/docs.txt)
	$(call install,docs)
	@touch $@

clean: ## remove the environment and everything that was built
	rm -rf $(VENV) build docs/_build docs/gallery *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Says that the environment is whole, and where: one that was interrupted has none and is made again, and so is one that
# was moved, whose programs name the old place.
MADE := $(VENV)/.made
ifneq ($(shell cat $(MADE) 2>/dev/null),$(CURDIR))
$(MADE): FORCE
endif

# Debian has the venv module in a package of its own; without it `python3 -m venv` leaves half an environment behind.
$(MADE):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo 'hilfit needs Python 3.11 or newer; name one with PYTHON=, as in: make demo PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq python3-venv || true; fi
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || \
	  { echo '$(PYTHON) cannot make virtual environments; install that with: sudo apt-get install python3-venv' >&2; exit 1; }
	@[ ! -s $@ ] || echo 'this folder was moved or copied; its environment is made anew'
	$(PYTHON) -m venv --clear $(VENV)
	@echo '$(CURDIR)' > $@

# The environment is brought up to date when the dependencies change; the package itself is installed editable.
$(VENV)/.use: pyproject.toml $(LOCK:%=%/use.txt) $(MADE)
	$(call install,use)
	@touch $@

$(VENV)/.dev: pyproject.toml benchmarks/pyproject.toml $(LOCK:%=%/dev.txt) $(MADE)
	$(call install,dev,-e benchmarks)
	@touch $@ $(VENV)/.use
