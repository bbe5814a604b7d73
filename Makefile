# accelcal: all jobs. `make help` lists them.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO_STAMP := $(VENV)/.installed-for-demo
SOURCES := pyproject.toml Cargo.toml $(wildcard crates/*/Cargo.toml) $(shell find crates -path '*/src/*.rs')
export CARGO_INCREMENTAL ?= 0
# Freed memory stays with a process, which asks for the same arrays again and again; compiled modules stay for the next.
RUN_TESTS := OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= MALLOC_TRIM_THRESHOLD_=268435456 MALLOC_MMAP_THRESHOLD_=268435456 $(BIN)/python -m pytest -n auto --dist worksteal -q
BESIDE := slow or outside or statistics

.NOTPARALLEL:
.PHONY: help demo docs pages paper test test-rest test-all figures coverage mutants test-durations test-long test-browser test-hostile fuzz embedded check wheel try-wheel release-check constraints bench bench-check bench-live bench-live-input bench-noisy-live bench-monitoring bench-regimes bench-nulls nulls bench-added bench-lines bench-axes bench-accidents bench-mistakes bench-rates bench-ruler bench-loop bench-named bench-mechanisms bench-left-out bench-engines bench-references bench-crossovers bench-hidden bench-against compare-outputs bench-peers size stubs format clean bench-response bench-arms bench-triads bench-tracked bench-allan

help: ## List the jobs.
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(DEMO_STAMP) ## Set up, then run the main steps: simulate, fit, compare, draw.
	$(BIN)/accelcal demo -o demo

docs: $(STAMP) ## Build the site into build/docs: pages, cards with pictures, the tutorial run anew. No network.
	$(BIN)/python -m sphinx -W -E -q -b html -d build/doctrees docs build/docs
	@echo "open build/docs/index.html"

pages: $(STAMP) ## Write what the package prints on its pages: cards of effects, thresholds.
	$(BIN)/python -m tests.docs.printed

paper: $(STAMP) ## Reproduce the paper: measured next to expected values, figures in build/paper. ARGS=--full for all runs.
	$(BIN)/python -m papers.stakkeland2007 -o build/paper $(ARGS)

test: $(STAMP) ## Run the fast tests: Rust, then Python.
	cargo test --workspace --exclude accelcal-py --exclude ekf-simd-benches --quiet --lib --tests
	cargo test --workspace --exclude accelcal-py --exclude ekf-simd-benches --quiet --doc
	$(RUN_TESTS) -m "not ($(BESIDE))" $(PYTEST)

test-rest: $(STAMP) ## Run the tests that make test leaves out: slow ones, browsers, compilers, emulators, statistics.
	$(RUN_TESTS) -m "$(BESIDE)" $(PYTEST)

test-all: test test-rest ## Run every test.

test-durations: $(STAMP) ## Measure the processor time of every test and write tests/durations.json; an hour.
	rm -rf build/durations
	ACCELCAL_DURATIONS=build/durations $(RUN_TESTS) $(PYTEST)
	$(BIN)/python -m tests.tiers build/durations

figures: $(STAMP) ## Are the results on short records of many kinds what they were, number by number? ARGS=write writes them anew.
	$(if $(ARGS),$(BIN)/python -m tests.workflow.test_figures,$(RUN_TESTS) tests/workflow/test_figures.py)

coverage: $(STAMP) ## Lines of the package that the fast tests run, by folder.
	$(BIN)/python -m pip install --quiet pytest-cov
	COVERAGE_FILE=build/.coverage $(RUN_TESTS) -m "not ($(BESIDE))" --cov=python/accelcal --cov-context=test --cov-report=
	$(BIN)/python tools/mutants.py --folders

mutants: ## Change 200 lines of estimation and diagnosis one by one, behind make coverage: do tests notice? Hours, restartable.
	$(BIN)/python tools/mutants.py

test-long: $(STAMP) ## Compare the filters with their twins on ten times as many records; single precision for ten minutes.
	ACCELCAL_HYPOTHESIS=long cargo test --release --quiet -p ekf-core -p ekf-simd -- --include-ignored
	ACCELCAL_HYPOTHESIS=long $(BIN)/python -m pytest -n auto --dist worksteal -q tests/twin

test-browser: $(STAMP) ## Ten tasks and hidden effects on the workbench in every size and theme, and axe; pictures in build/screenshots.
	rm -rf build/screenshots
	ACCELCAL_BROWSER=every ACCELCAL_SCREENSHOTS=build/screenshots ACCELCAL_REQUIRE_BROWSER=1 \
		$(BIN)/python -m pytest -q tests/app/test_tasks.py tests/app/test_accessibility.py tests/app/test_hidden_browser.py

test-hostile: $(STAMP) ## Mutated files and models, kills, full disks, many sessions: every case, hours.
	ACCELCAL_FUZZ=300000 cargo test --release --quiet -p ekf-core-fuzz -- --nocapture
	ACCELCAL_HOSTILE=long ACCELCAL_REQUIRE_BROWSER=1 $(BIN)/python -m pytest -q -s tests/hostile

fuzz: ## Drive the fuzz targets of ekf-core by coverage, a minute each; needs a nightly toolchain and cargo-fuzz.
	tools/fuzz.sh 60

embedded: $(STAMP) ## Run the filter on a Cortex-M in QEMU: bits, instructions, flash, stack. Installs Debian packages.
	firmware/install.sh
	$(BIN)/python -m tests.firmware.run
	ACCELCAL_REQUIRE_EMBEDDED=1 $(BIN)/python -m pytest -q tests/firmware

check: $(STAMP) ## Format, lints, types, stubs.
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	for some in "" std f32; do cargo clippy -p ekf-core --lib --no-default-features --features "$$some" --quiet -- -D warnings || exit 1; done
	RUSTDOCFLAGS="-D warnings" cargo doc -p ekf-core -p ekf-simd --no-deps --quiet
	cargo fmt --manifest-path firmware/Cargo.toml --check
	cargo fmt --manifest-path benches/peers/rust/Cargo.toml --check
	cargo clippy --manifest-path firmware/Cargo.toml --target-dir target/firmware --lib --quiet -- -D warnings
	$(BIN)/ruff format --check python papers tests benches docs tools
	$(BIN)/ruff check python papers tests benches docs tools
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest accelcal._core --ignore-disjoint-bases

wheel: $(STAMP) ## Build the wheel (Python 3.11 and later) and the source distribution into dist/.
	rm -rf dist
	$(BIN)/python tools/licences.py > LICENSES-THIRD-PARTY.txt
	$(BIN)/maturin build --release --locked --strip --quiet --out dist
	$(BIN)/maturin sdist --out dist >/dev/null 2>&1

try-wheel: wheel ## Install the wheel where there is no compiler, newest and lowest versions, and run the main commands.
	tools/try_wheel.sh
	tools/try_wheel.sh --lowest

release-check: $(STAMP) ## All that a release needs, on one page: held or not; an hour. ITEMS="versions changelog" for some.
	$(BIN)/python tools/release_check.py $(ITEMS)

constraints: $(STAMP) ## Write down the versions of this environment, once `make test` has passed in it.
	$(BIN)/python -m pip freeze --exclude-editable | grep -E '^[A-Za-z0-9._-]+==' > constraints.txt

bench: $(STAMP) ## Measure times, memory and statistics; minutes.
	cargo bench --quiet -p ekf-simd-benches
	$(BIN)/python -m benches.start
	$(BIN)/python -m benches.streaming
	$(BIN)/python -m benches.replay
	$(BIN)/python -m benches.fit
	$(BIN)/python -m benches.diagnose
	$(BIN)/python -m benches.consistency
	$(BIN)/python -m benches.power --write
	$(BIN)/python -m benches.campaign
	$(BIN)/python -m benches.workbench --hour

bench-live: $(STAMP) ## Draw a million setups of live and batch filters: no negative variance, no NaN without an error.
	$(BIN)/python -m benches.live_filters

bench-live-input: $(STAMP) ## Send 10 kHz to `accelcal live` for ten minutes each by TCP and by a terminal: nothing may be lost.
	$(BIN)/python -m benches.live --over tcp
	$(BIN)/python -m benches.live --over pty

bench-noisy-live: $(STAMP) ## Follow 480 records of two hours behind noisy sensors: are scale factor and bias within their uncertainties?
	$(BIN)/python -m benches.noisy_live

bench-monitoring: $(STAMP) ## Follow 200 hours of honest rigs, and rigs to which something happens: alarms as rare as stated, of the right cause? (half an hour)
	$(BIN)/python -m benches.monitoring null
	$(BIN)/python -m benches.monitoring causes
	$(BIN)/python -m benches.monitoring simulate

bench-check: $(STAMP) ## Fail where a step costs 5 % more instructions than stored (valgrind).
	tools/bench_check.sh

size: $(STAMP) ## Print the size of the package: statements, tokens, public names.
	$(BIN)/python tools/size.py

compare-outputs: $(STAMP) ## Outputs of ten recordings against another revision: make compare-outputs REV=aab2a6e.
	tools/compare_outputs.sh $(REV)

bench-against: $(STAMP) ## Time and memory of the commands of the loop against another revision: make bench-against REV=aab2a6e.
	tools/bench_against.sh $(REV)

bench-peers: $(STAMP) ## Run every other filter on our workloads and put the table into docs/benchmarks.md. Installs them.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[peers]"
	$(BIN)/python -m benches.peers --write

bench-regimes: $(STAMP) ## Hold the product to honest records of every kind of rig; hours, restartable.
	$(BIN)/python -m benches.regimes --workers 2

nulls: $(STAMP) ## Print the false names among the last 2000 honest records that benches ran; at most 1 %.
	$(BIN)/python -m benches.ledger

bench-nulls: $(STAMP) ## Read 300 honest records of every kind of rig; half an hour, restartable.
	$(BIN)/python -m benches.nulls

bench-added: $(STAMP) ## Hide, name and add every effect of the catalogue; twenty minutes, restartable.
	$(BIN)/python -m benches.added

bench-lines: $(STAMP) ## Hide lines and waves over position, add them, compare with the truth; minutes, restartable.
	$(BIN)/python -m benches.lines

bench-axes: $(STAMP) ## Read records with gravity across and along the axis; minutes, restartable.
	$(BIN)/python -m benches.axes

bench-accidents: $(STAMP) ## Plant accidents of a laboratory into honest records: said, never named; an hour, restartable.
	$(BIN)/python -m benches.accidents

bench-mistakes: $(STAMP) ## Read records whose units, ranges, columns, signs or gravity are mistaken; minutes, restartable.
	$(BIN)/python -m benches.mistakes

bench-rates: $(STAMP) ## Align pairs of recorders whose clocks run at different rates; minutes, restartable.
	$(BIN)/python -m benches.rates

bench-ruler: $(STAMP) ## Estimate the systematic error in 2500 worlds whose error is known in closed form; minutes, restartable.
	$(BIN)/python -m benches.ruler --chains 50 --budgets 100

bench-loop: $(STAMP) ## Run the loop of the demo on 20 hidden effects; minutes, restartable.
	$(BIN)/python -m benches.loop

bench-named: $(STAMP) ## Hide effects of all kinds: what improve names, what is in the model; an hour, restartable.
	$(BIN)/python -m benches.named

bench-mechanisms: $(STAMP) ## Coefficients that follow a driver, and true processes: what is named; twenty minutes, restartable.
	$(BIN)/python -m benches.mechanisms

bench-left-out: $(STAMP) ## Read records with saturated bursts; minutes, restartable.
	$(BIN)/python -m benches.left_out

bench-references: $(STAMP) ## Hide effects in records whose reference is a velocity or an acceleration; an hour, restartable.
	$(BIN)/python -m benches.references --workers 2

bench-arms: $(STAMP) ## Read sensors on arms about axles, with nothing and one effect hidden; an hour, restartable.
	$(BIN)/python -m benches.arms --workers 2

bench-triads: $(STAMP) ## Read three outputs of a body that turns, with nothing and one effect hidden on an axis; an hour, restartable.
	$(BIN)/python -m benches.triads --workers 2

bench-tracked: $(STAMP) ## Fit three outputs of a tracked board (shared recordings): error, scales, delay, names; ten minutes.
	$(BIN)/python -m benches.tracked

bench-crossovers: $(STAMP) ## Read stages by references from poor to far too good, with nothing and one effect hidden; an hour, restartable.
	$(BIN)/python -m benches.crossovers --workers 2

bench-engines: $(STAMP) ## Estimate honest and spoilt records by the replay and by the weak form; hours, restartable.
	$(BIN)/python -m benches.engines --workers 2
	$(BIN)/python -m benches.engines --workers 2 --fault --regime 'a-*' 'b-*' --records 2

bench-hidden: $(STAMP) ## Hold the product to records with hidden effects; an hour, restartable.
	$(BIN)/python -m benches.hidden --write

bench-response: $(STAMP) ## Hold the frequency response to exact simulated shakers: errors and coverage; minutes.
	$(BIN)/python -m benches.response

bench-allan: $(STAMP) ## Hold the noise of simulated sensors at rest to their truth: coverage; 25 minutes, restartable.
	$(BIN)/python -m benches.allan

format: $(STAMP) ## Rewrite sources in the project's style.
	cargo fmt --all
	cargo fmt --manifest-path firmware/Cargo.toml
	cargo fmt --manifest-path benches/peers/rust/Cargo.toml
	$(BIN)/ruff format python papers tests benches docs tools
	$(BIN)/ruff check --fix python papers tests benches docs tools

clean: ## Remove everything that can be made again.
	rm -rf $(VENV) target demo build dist LICENSES-THIRD-PARTY.txt

$(VENV)/bin/python:
	@tools/prerequisites.sh
	$(PYTHON) -m venv $(VENV)

$(DEMO_STAMP) $(STAMP): $(VENV)/bin/python $(SOURCES)
	@tools/prerequisites.sh
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[$(if $(filter $(STAMP),$@),dev,report)]"
	@touch $(DEMO_STAMP) $@
