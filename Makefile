PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The import name as folders, for pyright: it does not follow an editable install.
LINKS := $(VENV)/links/thrustmargin

.PHONY: demo fleet-demo test pytest lab check answers bench measured mutation fuzz package screenshots clean

demo: $(VENV)/.demo
	$(BIN)/thrustmargin demo --out report.html $(DEMO_ARGS)

# Each on one core, and twice as many as there are, as many tests wait for a clock; module by module,
# so that what its tests share is made once. A worker that dies is a failure and not started anew: it
# would be given the same tests for ever.
PYTEST_ARGS ?= -n 4 --dist loadscope --no-loadscope-reorder --max-worker-restart 0

# Types on one core while the tests run: they take as long as a third of those.
test: $(VENV)/.test
	$(MAKE) --jobs 2 check pytest

pytest: $(VENV)/.test
	$(BIN)/python -m pytest $(PYTEST_ARGS)

# The loop on causes that it does not know, on measured data and on a season; minutes to an hour.
lab: $(VENV)/.test
	$(BIN)/python -m pytest $(PYTEST_ARGS) tests/lab

check: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright -p tests

bench: $(VENV)/.test
	$(BIN)/python -m pytest tests/lab/bench --benchmark-only -o python_files='bench_*.py' -s -v

# What every command answers on all bundled logs: make answers OUT=new [AGAINST=old] [REVISION=c6b276a9]
# [ANSWERS_ARGS='--core --logs FOLDER --short']. Fails where the answers in OUT and AGAINST differ.
answers: $(VENV)/.test
	$(BIN)/python -m tests.lab.answers --out $(OUT) $(if $(REVISION),--revision $(REVISION)) $(if $(AGAINST),--against $(AGAINST)) $(ANSWERS_ARGS)

# make measured DATA=../shared/measured [ONLY="px4_ulog ..."]
measured: $(VENV)/.test
	$(BIN)/python -m tests.lab.measured $(DATA) $(if $(ONLY),--only $(ONLY)) $(MEASURED_ARGS)

# Breaks the source on purpose and counts what fast tests notice: make mutation MUTATION_ARGS='ROOM --sample 20'
mutation: $(VENV)/.test
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[mutation]'
	nice $(BIN)/python tests/lab/mutation/mutate.py $(MUTATION_ARGS)

# What an index takes: the wheel is built from the source archive, so that neither lacks a file. Its
# pictures are of the pages as they are.
package: $(VENV)/.test screenshots
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[release]'
	rm -rf dist
	$(BIN)/python -m build --no-isolation
	$(BIN)/twine check --strict dist/*

# Damaged files of every kind into their readers, for so many seconds: make fuzz TIME=600
TIME ?= 600
fuzz: $(VENV)/.test
	nice $(BIN)/python -m tests.lab.fuzz.fuzz --seconds $(TIME) $(FUZZ_ARGS)

screenshots: $(VENV)/.test
	$(BIN)/python docs/screenshots.py

$(VENV)/.venv:
	$(PYTHON) -c 'import sys; assert sys.version_info[:2] >= (3, 11), "thrustmargin needs Python 3.11 or newer; run: make PYTHON=python3.11"'
	$(PYTHON) -m venv $(VENV)
	touch $@

# A season of 12 aircraft from the recorded flights, with faults put in, and the page that finds them.
fleet-demo: $(VENV)/.test
	$(BIN)/python -m tests.lab.season_plant fleet-demo --flights 40
	$(BIN)/thrustmargin fleet fleet-demo --out fleet.html

$(VENV)/.demo: $(VENV)/.venv pyproject.toml constraints.txt
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[loop]'
	touch $@

$(VENV)/.test: $(VENV)/.demo
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[all,test]'
	mkdir -p $(LINKS)
	ln -sfn ../../../gcs_plugin/api/__init__.py $(LINKS)/__init__.py
	for package in models mission gcs_plugin; do ln -sfn ../../../$$package $(LINKS)/$$package; done
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info
