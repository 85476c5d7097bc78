# make demo and make test are all the set-up there is: each makes .venv and installs what it needs.

PYTHON ?= python3
BIN := .venv/bin
TAXELFLOW := $(BIN)/taxelflow
READY := .venv/ready

.PHONY: setup demo test check golden golden-update bench pictures constraints format clean
.DELETE_ON_ERROR:

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@if command -v uv >/dev/null 2>&1; then \
	  uv venv --allow-existing --quiet --python $(PYTHON) .venv && \
	  uv pip install --quiet --python .venv --constraint constraints.txt --editable '.[plot,bench,dev]'; \
	else \
	  { test -x $(BIN)/python || $(PYTHON) -m venv .venv; } && \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[plot,bench,dev]'; \
	fi
	@touch $@

demo: $(READY)
	@mkdir -p demo
	$(TAXELFLOW) simulate stroke --out demo/stroke.npz
	$(TAXELFLOW) info demo/stroke.npz
	$(TAXELFLOW) estimate demo/stroke.npz --method lnorm --out demo/lnorm
	$(TAXELFLOW) estimate demo/stroke.npz --method convolution --out demo/convolution
	$(TAXELFLOW) estimate demo/stroke.npz --method template --out demo/template
	$(TAXELFLOW) plot demo/lnorm demo/convolution demo/template --out demo/pictures --format png
	$(TAXELFLOW) score table1 --strokes 40

test: $(READY)
	$(BIN)/pytest

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture
	$(BIN)/python tests/gates.py

# Results of every method on fixed recordings, bit for bit; GOLDEN="--only stroke" or "--rtol 1e-9" narrows or loosens it.
golden: $(READY)
	PYTHONPATH=tests $(BIN)/python -m golden compare $(GOLDEN)

# Say in the commit why results have changed.
golden-update: $(READY)
	PYTHONPATH=tests $(BIN)/python -m golden update

bench: $(READY)
	$(TAXELFLOW) bench $(BENCH)

# The pictures that README and docs show.
pictures: $(READY)
	@mkdir -p demo
	$(TAXELFLOW) simulate stroke --out demo/stroke.npz
	$(TAXELFLOW) estimate demo/stroke.npz --method lnorm --out demo/lnorm
	$(TAXELFLOW) estimate demo/stroke.npz --method convolution --out demo/convolution
	$(TAXELFLOW) estimate demo/stroke.npz --method template --out demo/template
	$(TAXELFLOW) plot demo/lnorm demo/convolution demo/template --out docs/pictures
	$(TAXELFLOW) figures --out demo/figures --strokes 100
	cp demo/figures/fig7-rotation.svg demo/figures/error-over-position.svg docs/pictures/
	$(TAXELFLOW) simulate slide-and-turn --out demo/slide.npz
	$(TAXELFLOW) estimate demo/slide.npz --method template --out demo/slide
	$(TAXELFLOW) plot demo/slide
	cp demo/slide/pattern-finger2_proximal.svg docs/pictures/pattern.svg
	rm docs/pictures/path-*.svg docs/pictures/pattern-palm*.svg

# Resolve anew, then pin what was resolved. Lines are name==version and nothing else.
constraints:
	rm -rf .venv
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[plot,bench,dev]'
	{ sed -n '/^#/p' constraints.txt; $(BIN)/python -m pip freeze --exclude-editable | grep -E '^[A-Za-z0-9_.-]+==[^ ]+$$'; } > constraints.new
	mv constraints.new constraints.txt

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv demo .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
