# Two commands: `make demo` runs the main job, `make test` runs every check. Both set everything up first, once.

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test lint types tests slow nightly docs pictures screenshots clean

demo: $(INSTALLED)
	$(BIN)/python -m experiments.demo --out out/demo

test: lint types tests

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/pyright

tests: $(INSTALLED)
	$(BIN)/pytest -n 2 --dist worksteal

# The tests that take more than two seconds each: ten minutes. CI runs them as well.
slow: $(INSTALLED)
	$(BIN)/pytest -n 2 --dist worksteal -m "slow and not nightly"

# The tests that take longer than a minute each, and the laws of worlds in all named scenes.
nightly: $(INSTALLED)
	$(BIN)/pytest -m nightly

# The site, at http://127.0.0.1:8000/, written anew as pages change. `mkdocs build --strict` makes it in site/.
docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve --strict

# The pictures of README and docs.
pictures: $(INSTALLED)
	$(BIN)/python -m experiments.demo --policy ring --out out/pictures
	$(BIN)/python -m experiments.pictures --out docs/pictures
	$(BIN)/python tools/architecture.py

# Screenshots of report, viewer, site and help; needs Chromium.
screenshots: demo
	$(BIN)/python tools/screenshots.py --labels out/demo/labels

# Set up again only when what is to be installed has changed.
$(INSTALLED): pyproject.toml constraints.txt apt-packages.txt tools/setup.sh
	tools/setup.sh $(VENV)
	touch $@

clean:
	rm -rf $(VENV) out build dist site *.egg-info
