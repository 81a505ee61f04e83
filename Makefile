# make setup  install everything into .venv; the others do it when needed
# make run    set up, build the default dataset and its report
# make tiny   the same for the smallest experiment, as continuous integration does it
# make dataset CONFIG=mine.yaml   the dataset of your own experiment and nothing else
# make unlock   after a run was killed, before the same command is given again
# make check  what one runs while working, in a minute and a half: lint, and the tests nearest to what
#             has changed since CHANGED=HEAD
# make test   set up, run every test (tests/README.md); DRAPELINE_TINY=. where
#             `make tiny` was run, whose results it then checks
# make test-portable   those that another processor could decide otherwise, as the oldest one would
#             run them, or with ALL=1 as several
# make test-install   install the library with pip into empty environments
# make test-browser REPORT=report.html   open every page of a report in a browser; installs
#             Playwright and, where there is no browser, Debian's Chromium
# make mutants   plant faults in copies of the code and list those that no test notices (COUNT=60,
#             SEED=0, ONLY=geometry for those of some files, CHANGED=main for those of lines that
#             are not in main)
# make fuzz   read damaged files for an hour (MINUTES=60, SEED=0) and print how to see a case again
#             that is met badly
# make bench RESULTS=results   measure speed beside other libraries, on the results of a finished
#             experiment, and write the table of docs/background/speed.md
# make lint   formatters, linters and types, as CI runs them
# Anything after that is plain Snakemake: .venv/bin/snakemake [target] --cores all
PYTHON ?= $(shell command -v python3.11 || command -v python3)
CONFIG ?= config.yaml
REPORT ?= report.html
RESULTS ?= results
CORES ?= all
PROFILE ?= local
MINUTES ?= 60
COUNT ?= 60
SEED ?= 0
BIN := .venv/bin
# Compiled tests are kept, since to compile them takes longer than to import them.
TEST := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1
SNAKEMAKE = $(BIN)/snakemake --cores $(CORES)
# Snakemake's lock outlives it when it is killed; it also lies there while another one works.
AFTER_A_KILL = { [ -z "$$(ls .snakemake/locks 2>/dev/null)" ] || \
   echo "If no other Snakemake works in this folder, one was killed here: 'make unlock CONFIG=$(CONFIG)', then the same command again."; \
   exit 1; }

.PHONY: setup run tiny dataset unlock report docs bodies check test test-near test-install test-portable test-browser mutants \
        fuzz bench lint format lock clean

setup: .venv/ready

run: .venv/ready
	$(SNAKEMAKE) --workflow-profile workflow/profiles/$(PROFILE) --configfile $(CONFIG) || $(AFTER_A_KILL)
	$(MAKE) --no-print-directory report

tiny:
	$(MAKE) --no-print-directory run CONFIG=tests/data/tiny.yaml PROFILE=ci

dataset: .venv/ready
	$(SNAKEMAKE) dataset --workflow-profile workflow/profiles/$(PROFILE) --configfile $(CONFIG) || $(AFTER_A_KILL)

unlock: .venv/ready
	$(BIN)/snakemake --unlock --configfile $(CONFIG)

report: .venv/ready
	$(SNAKEMAKE) --report report.html --report-stylesheet workflow/report/style.css --configfile $(CONFIG)
	@echo "The report is report.html; the dataset is under the 'results' folder of $(CONFIG)."

check: .venv/ready
	@$(MAKE) --no-print-directory --jobs 2 --output-sync lint test-near

test-near: .venv/ready
	$(TEST) PYTHONPATH=src:tests $(BIN)/python tests/check.py $(if $(CHANGED),--changed $(CHANGED))

test: .venv/ready
	$(TEST) $(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder

test-install: .venv/ready
	PYTHONPATH=tests $(BIN)/python -m install.run

test-portable: .venv/ready
	PYTHONDONTWRITEBYTECODE= PYTHONPATH=tests $(BIN)/python -m portable.run $(if $(ALL),--all)

test-browser: .venv/ready
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement tests/browser/requirements.txt
	@for browser in chromium chromium-browser google-chrome google-chrome-stable; do \
	   command -v $$browser >/dev/null && exit; done; \
	 { apt-get update --quiet && apt-get install --yes --no-install-recommends chromium; }
	$(BIN)/python -m pytest -q tests/browser --report-page $(REPORT)

mutants: .venv/ready
	PYTHONPATH=tests $(BIN)/python -m mutants.run --count $(COUNT) --seed $(SEED) \
	   $(if $(CHANGED),--changed $(CHANGED)) $(if $(ONLY),--only $(ONLY))

fuzz: .venv/ready
	PYTHONPATH=src:tests $(BIN)/python -m fuzz.run --minutes $(MINUTES) --seed $(SEED)

# Blocks of memory are kept: the peers' times would else be those of the kernel clearing pages.
bench: .venv/ready
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MALLOC_MMAP_THRESHOLD_=4294967296 \
	   MALLOC_TRIM_THRESHOLD_=17179869184 MALLOC_TOP_PAD_=268435456 \
	   PYTHONPATH=src $(BIN)/python bench/run.py $(RESULTS)

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/mypy
	$(BIN)/snakemake --lint --configfile config.yaml

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile workflow

# Bakes the bodies that come with drapeline; a new version of them has a new number in `bodies/model.py`.
bodies: .venv/ready
	PYTHONPATH=src $(BIN)/python workflow/resources/bodies/make_bodies.py

docs: .venv/ready
	PYTHONPATH=src $(BIN)/python docs/make_settings.py
	PYTHONPATH=src $(BIN)/python docs/make_rules.py
	PYTHONPATH=src $(BIN)/python docs/make_fabrics.py

lock: .venv/ready
	@{ echo "# Exact versions of the one environment that runs everything (Python 3.11); made by 'make lock'."; \
	   $(BIN)/pip freeze --exclude-editable --exclude playwright | sed 's/+cpu//'; } > requirements.lock

.venv/ready: requirements.lock pyproject.toml src/drapeline/preflight.py
	@$(PYTHON) src/drapeline/preflight.py
	@echo "Setting up .venv with the locked versions (a few minutes, once) ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/pip install --disable-pip-version-check --requirement requirements.lock
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@$(BIN)/python -c "import bpy" || { echo "drapeline preflight: Blender's wheel is installed but does not load, see the line above."; exit 1; }
	@touch $@

clean:
	rm -rf .venv .snakemake results resources logs benchmarks report.html
