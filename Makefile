# make demo and make test are all the set-up there is: each makes .venv and installs what it needs.

PYTHON ?= python3
BIN := .venv/bin
TAXELFLOW := $(BIN)/taxelflow
READY := .venv/ready
DEMO_READY := .venv/ready-demo
CONTROL_READY := .venv/ready-control
DOCS_READY := .venv/ready-docs
CONTROL := plot,sim,video
EVERYTHING := plot,bench,report,video,view,devices,ros,lsl,cluster,sim,dev

.PHONY: setup demo demo-live demo-control bench-live bench-view test test-long check docs wheel golden golden-update fuzz bench bench-start pictures results $(addprefix results-,table1 hard peers slip limits contacts prediction bench control control-search) constraints format clean
.DELETE_ON_ERROR:

setup: $(READY)

# Install the project with extras into .venv, which is made if there is none. What is there already stays. Bytecode is
# compiled on all cores afterwards: pip does it on one, in half of its time. Some files are not for this Python.
define installed
if command -v uv >/dev/null 2>&1; then \
  uv venv --allow-existing --quiet --python $(PYTHON) .venv && \
  uv pip install --quiet --compile-bytecode --python .venv --constraint constraints.txt --editable '.[$(1)]'; \
else \
  { test -x $(BIN)/python || $(PYTHON) -m venv .venv; } && \
  { $(BIN)/python -m pip --version >/dev/null 2>&1 || $(BIN)/python -m ensurepip; } && \
  $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt --editable '.[$(1)]' && \
  { $(BIN)/python -m compileall -qq -j 0 .venv/lib >/dev/null 2>&1 || true; }; \
fi
endef

# The tests' kernels are compiled while pip unpacks the rest: half a minute less on two cores.
$(READY): $(DEMO_READY)
	@$(BIN)/python tests/warm.py & \
	{ $(call installed,$(EVERYTHING)); }; status=$$?; wait; exit $$status
	@touch $(CONTROL_READY) $@

$(DEMO_READY): pyproject.toml constraints.txt
	@$(call installed,plot)
	@touch $@

$(CONTROL_READY): pyproject.toml constraints.txt
	@$(call installed,$(CONTROL))
	@touch $@

demo: $(DEMO_READY)
	@mkdir -p demo
	$(TAXELFLOW) simulate stroke --out demo/stroke.npz
	$(TAXELFLOW) info demo/stroke.npz
	$(TAXELFLOW) estimate demo/stroke.npz --method lnorm --out demo/lnorm
	$(TAXELFLOW) estimate demo/stroke.npz --method convolution --out demo/convolution
	$(TAXELFLOW) estimate demo/stroke.npz --method template --out demo/template
	$(TAXELFLOW) plot demo/lnorm demo/convolution demo/template --out demo/pictures --format png
	$(TAXELFLOW) score table1 --strokes 40

# A hand that is not there, over TCP, into three sinks; then the file that was recorded is replayed, and compared bit by bit.
LIVE := demo/live
demo-live: $(DEMO_READY)
	@rm -rf $(LIVE) && mkdir -p $(LIVE)
	$(TAXELFLOW) simulate slide-and-turn-over-hand --out $(LIVE)/hand.npz
	$(TAXELFLOW) emulate tcp://127.0.0.1:5055 --from $(LIVE)/hand.npz --fault garbage@3 & \
	$(TAXELFLOW) run 'tcp://127.0.0.1:5055?wait=60' --sensor barretthand-162 \
	  --to mcap:$(LIVE)/hand.mcap --to tables:$(LIVE)/tables --to jsonl:$(LIVE)/hand.jsonl; \
	status=$$?; wait; exit $$status
	$(TAXELFLOW) info $(LIVE)/hand.mcap
	$(TAXELFLOW) run 'replay:$(LIVE)/hand.mcap?speed=max&adoptions=recorded' --to tables:$(LIVE)/again --quiet
	cmp $(LIVE)/tables/slips.csv $(LIVE)/again/slips.csv
	cmp $(LIVE)/tables/events.csv $(LIVE)/again/events.csv
	$(TAXELFLOW) convert $(LIVE)/hand.npz $(LIVE)/sent.csv
	$(TAXELFLOW) convert $(LIVE)/hand.mcap $(LIVE)/recorded.csv
	cmp $(LIVE)/sent.csv $(LIVE)/recorded.csv
	@echo "every scan, slip and event is equal, live and read back"

# A bottle poured into, and caught: a film (without graphics: a message), and plots of one trial of each event.
demo-control: $(CONTROL_READY)
	@mkdir -p demo/control
	$(TAXELFLOW) control --controller hold --objects bottle --events pour --trials 1 --seed 7004 --film demo/control/pour.mp4
	$(TAXELFLOW) control --controller hold --objects ball bottle --trials 4 --seed 7000 --plot demo/control

test: $(READY)
	$(BIN)/pytest

# Accuracy over many scans and seeds, and real recordings: what `make test` leaves out.
test-long: $(READY)
	$(BIN)/pytest -m long

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/vulture
	$(BIN)/python tests/gates.py

# The documentation as a site in docs/_build/html. Its tutorials are executed; a warning is an error.
docs: $(DOCS_READY)
	$(BIN)/sphinx-build -q -W --keep-going -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

$(DOCS_READY): $(READY)
	$(BIN)/python -m pip --version >/dev/null 2>&1 || $(BIN)/python -m ensurepip --upgrade
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	@touch $@

# Build the wheel, install it into a fresh environment outside the checkout, and run the demo's commands with it there.
wheel: $(READY)
	PYTHON=$(PYTHON) sh tests/wheel.sh

# Results of every method on fixed recordings, bit for bit; GOLDEN="--only stroke" or "--rtol 1e-9" narrows or loosens it.
golden: $(READY)
	PYTHONPATH=tests $(BIN)/python -m golden compare $(GOLDEN)

# Say in the commit why results have changed.
golden-update: $(READY)
	PYTHONPATH=tests $(BIN)/python -m golden update

# What hostile files cost, and which message refuses them; then files changed for FUZZ_S seconds. Findings are kept.
FUZZ_S ?= 60
fuzz: $(READY)
	PYTHONPATH=tests $(BIN)/python -m hostile --fuzz $(FUZZ_S) $(FUZZ)

bench: $(READY)
	$(TAXELFLOW) bench $(BENCH)

# LIVE_BENCH="--paced-s 600" for ten minutes at 1 kHz, on a machine that does nothing else.
bench-live: $(READY)
	$(TAXELFLOW) score live $(LIVE_BENCH)

# VIEW_BENCH="--seconds 600" for ten minutes. Needs a browser.
bench-view: $(READY)
	$(TAXELFLOW) score view $(VIEW_BENCH)

# CPU time of first estimates from an empty kernel cache; AGAINST=REF measures another commit beside it.
bench-start: $(READY)
	$(BIN)/python tests/first_run.py $(if $(AGAINST),--against $(AGAINST))

# The tables in docs/results, of which docs show a part; many hours, most of them for the elastic solver. One of them
# alone: make results-hard. The real recordings are those in $TAXELFLOW_DATA, the folder that holds sdh-dsa/ and sdh-bags/.
RUNS := demo/results
LIMITS := stroke:stream:5 slide-and-turn:stream:5 bar-on-grid:batch:5 bar-on-grid:stream:5 feet-on-grid:batch:5 \
  feet-on-grid:stream:5 texture-on-grid:batch:5 stick-slip:stream:5 stick-slip-bar:stream:5 stick-slip-feet:stream:5
JOINED := awk 'FNR == 1 && NR > 1 { next } { print }'

results: results-table1 results-hard results-peers results-slip results-limits results-contacts results-prediction results-bench results-control

results-table1: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) score table1 --csv $(RUNS)/table1.csv
	$(TAXELFLOW) score table1 --solver elastic --csv $(RUNS)/table1-elastic.csv
	cp $(RUNS)/table1.csv $(RUNS)/table1-elastic.csv docs/results/

results-hard: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) score hard --seeds 50 --csv $(RUNS)/hard.csv
	cp $(RUNS)/hard.csv $(RUNS)/hard-far.csv docs/results/

results-peers: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) score peers --strokes 200 --csv $(RUNS)/peers.csv
	cp $(RUNS)/peers.csv docs/results/limits-peers.csv

# Fresh seeds for the template, with an hour of each object at rest, which takes longest.
results-slip: $(READY)
	@rm -rf $(RUNS)/slip && mkdir -p $(RUNS)/slip
	$(TAXELFLOW) score slip --seeds 2 --seed 5000 --hours 1 --methods template --csv $(RUNS)/slip/0.csv
	$(TAXELFLOW) score slip --seeds 2 --hours 0 --methods principal_axis convolution --csv $(RUNS)/slip/1.csv
	cp $(RUNS)/slip/0-holds.csv docs/results/slip-still.csv
	rm $(RUNS)/slip/*-holds.csv
	$(JOINED) $(RUNS)/slip/*.csv > docs/results/slip.csv

results-limits: $(READY)
	@rm -rf $(RUNS)/limits && mkdir -p $(RUNS)/limits
	$(TAXELFLOW) score limits stroke --seeds 20 --csv $(RUNS)/limits/0.csv
	$(TAXELFLOW) score limits slide-and-turn --csv $(RUNS)/limits/1.csv
	$(TAXELFLOW) score limits stick-slip --seeds 3 --methods template principal_axis --csv $(RUNS)/limits/2.csv
	for run in $(LIMITS); do \
	  set -- $$(echo $$run | tr : ' '); \
	  $(TAXELFLOW) score limits $$1 --mode $$2 --seeds $$3 --methods template --csv $(RUNS)/limits/3-$$1-$$2.csv || exit 1; \
	done
	for table in motion nees time; do $(JOINED) $(RUNS)/limits/*-$$table.csv > docs/results/limits-$$table.csv; done
	rm $(RUNS)/limits/*-motion.csv $(RUNS)/limits/*-nees.csv $(RUNS)/limits/*-time.csv $(RUNS)/limits/*-place.csv
	$(JOINED) $(RUNS)/limits/*.csv > docs/results/limits-error.csv

results-contacts: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) score contacts --seeds 3 --methods template --csv $(RUNS)/contacts.csv
	cp $(RUNS)/contacts.csv docs/results/

results-prediction: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) score prediction $(TAXELFLOW_DATA)/sdh-dsa/*.dsa $(TAXELFLOW_DATA)/sdh-bags/slip_up.bag --csv $(RUNS)/prediction.csv
	cp $(RUNS)/prediction.csv docs/results/prediction-scans.csv
	cp $(RUNS)/prediction-turn.csv docs/results/

results-bench: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) bench --recording $(TAXELFLOW_DATA)/sdh-dsa/slip_examples_pen_and_wooden_block.dsa --csv $(RUNS)/bench.csv
	cp $(RUNS)/bench*.csv docs/results/

# Fresh seeds: 50 trials on objects that can be felt, 10 on a plate, 100 more; a hand, slow grippers, motions.
results-control: $(READY)
	@mkdir -p $(RUNS)
	$(TAXELFLOW) control --controller hold --against threshold centroid constant --objects ball rod box bottle bumpy plate \
	  --trials 60 --seed 75000 --csv $(RUNS)/control.csv
	$(TAXELFLOW) control --controller hold --trials 100 --seed 80700 --csv $(RUNS)/control-more.csv
	$(TAXELFLOW) control --controller hold --sweep actuator --objects ball bottle bumpy --trials 3 --seed 75500 \
	  --csv $(RUNS)/control-actuator.csv
	$(TAXELFLOW) control --controller hold --hand barrett --against threshold centroid constant --objects jar case can \
	  --trials 24 --seed 77000 --csv $(RUNS)/control-hand.csv
	$(TAXELFLOW) control --controller slide --by-mm 5 --trials 16 --seed 80500 --csv $(RUNS)/control-slide-5.csv
	$(TAXELFLOW) control --controller slide --by-mm 20 --trials 24 --seed 80100 --csv $(RUNS)/control-slide-20.csv
	$(TAXELFLOW) control --controller pivot --by-deg 45 --trials 16 --seed 80900 --csv $(RUNS)/control-pivot.csv
	cp $(RUNS)/control*.csv docs/results/

# One search for every controller, about an hour; the defaults are what it found.
results-control-search: $(READY)
	for name in hold threshold centroid constant; do \
	  $(TAXELFLOW) control --controller $$name --tune 16 --trials 80 --seed 3000 || exit 1; \
	done

# The pictures that README and docs show.
pictures: $(READY)
	@mkdir -p demo
	$(TAXELFLOW) simulate stroke --out demo/stroke.npz
	$(TAXELFLOW) estimate demo/stroke.npz --method lnorm --out demo/lnorm
	$(TAXELFLOW) estimate demo/stroke.npz --method convolution --out demo/convolution
	$(TAXELFLOW) estimate demo/stroke.npz --method template --out demo/template
	$(TAXELFLOW) plot demo/lnorm demo/convolution demo/template --out docs/pictures
	$(TAXELFLOW) figures --out demo/figures --strokes 100
	cp demo/figures/fig7-rotation.svg demo/figures/error-over-position.svg demo/figures/spread-field.svg docs/pictures/
	$(TAXELFLOW) simulate slide-and-turn --out demo/slide.npz
	$(TAXELFLOW) estimate demo/slide.npz --method template --out demo/slide
	$(TAXELFLOW) plot demo/slide
	cp demo/slide/pattern-finger2_proximal.svg docs/pictures/pattern.svg
	$(TAXELFLOW) design --trials 100 --plot docs/pictures/design.svg
	rm docs/pictures/path-*.svg docs/pictures/pattern-palm*.svg docs/pictures/patterns-*.svg

# Resolve anew, then pin what was resolved. Lines are name==version and nothing else.
constraints:
	rm -rf .venv
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[plot,bench,report,video,view,devices,ros,lsl,cluster,docs,dev]'
	{ sed -n '/^#/p' constraints.txt; $(BIN)/python -m pip freeze --exclude-editable | grep -E '^[A-Za-z0-9_.-]+==[^ ]+$$'; } > constraints.new
	mv constraints.new constraints.txt

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv demo docs/_build docs/jupyter_execute .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
