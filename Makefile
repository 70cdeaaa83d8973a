# make demo    a fresh machine: environment, install, analysis of a shipped capture, result on screen
# make test    everything that has to hold, the engine both compiled and interpreted
# make docs    the documentation as a web site with an API reference, in build/docs
#
# make browser the analyzer in one HTML file that needs no installation, in build/browser (docs/browser.md)
# make wheels  the files of a release for this machine, each built and tried (docs/release.md)
# make bundle  all wheels in one zip that installs without a network; PLATFORM=win_amd64 PYTHON_VERSION=3.12 for another system
#
# What is installed is a wheel in .venv, built from this tree. A run of pytest from there tests the tree itself, interpreted,
# and needs no rebuild; with S7DISSECT_EXPECT=compiled it tests that wheel, and tests/conftest.py refuses a stale one.

VENV ?= .venv
DEMO ?= captures/nodes7-poll-missing.pcapng
# Processes side by side: tests also wait for others and for time that has to pass, a quarter of their time.
JOBS ?= $(shell echo $$(($$(nproc 2>/dev/null || echo 2) + 2)))
# In CI nothing falls back to interpreted.
COMPILED := $(if $(CI),S7DISSECT_COMPILED=1)
# Seconds for each fuzz target.
FUZZ_SECONDS ?= 60
# Of `make fuzz-installed`: inputs, processes side by side, and the file that notes what is done.
EXECUTIONS ?= 10000000
FUZZ_JOBS ?= 2
FUZZ_DONE ?= build/fuzz-done.jsonl
# Rounds of the property tests.
ROUNDS ?= 20

BIN := $(VENV)/bin
PYTEST := $(BIN)/pytest
# The tests of the engine itself, which run on both builds.
ENGINE := $(wildcard tests/wire/test_*.py tests/packets/source tests/packets/tcp tests/protocols/iso tests/protocols/s7 \
	tests/engine/test_*.py tests/engine/transactions tests/engine/findings tests/test_session.py tests/test_leaving.py tests/test_sources.py tests/meaning/report tests/properties)
# What these test is interpreted in the wheel as well: they would try the same code twice (tests/test_setup.py holds that).
ONCE := $(wildcard tests/packets/source/test_live_*.py tests/packets/source/test_growing.py tests/packets/source/test_pcapng_writer.py tests/packets/source/test_remote.py)

# What the tests of each part share (imports, asserts rewritten, captures) is made once for each process, and a worker of xdist
# collects every test there is. So these parts, about equally long, take a process each, and make keeps JOBS of them running.
# Those that take longest begin; what none of the others names is in the rest.
INSTALLED := rest program cli browser scd layers oracle captures
installed-browser := tests/output/browser
installed-oracle := tests/testing/oracle tests/testing/golden tests/protocols/tls
installed-cli := tests/cli
installed-scd := tests/scd tests/properties tests/files/anonymize
installed-captures := tests/captures tests/testing/playback tests/packets/source
installed-layers := tests/layers tests/output/page tests/promises tests/files/cluster tests/files/jobs
installed-program := tests/benchmarks $(wildcard tests/test_*.py)
installed-rest := tests $(foreach part,$(filter-out rest,$(INSTALLED)),$(installed-$(part):%=--ignore=%))

# What nothing can trace, count or give other bounds when it is compiled.
UNCOMPILED := tests/test_architecture.py tests/test_open_files.py tests/benchmarks/test_work.py tests/cli/test_cut.py tests/testing/golden/test_reading.py tests/meaning/inventory/test_code.py \
	tests/meaning/inventory/test_collector.py tests/files/jobs/test_inventories.py tests/output/page/test_gathered.py tests/output/page/test_samples.py \
	tests/output/page/test_use.py tests/testing/playback/server/test_recording.py tests/engine/program/test_carved.py tests/promises/test_growth.py \
	tests/output/variables/test_rows.py tests/output/variables/test_writers.py tests/meaning/select/test_selection.py

# Tests with a size for every change and a larger one for a release.
RELEASE_TESTS := tests/promises/test_kill.py tests/properties/test_captures.py tests/properties/test_pairs.py \
	tests/benchmarks/test_profiles.py tests/benchmarks/test_soak.py

INTERPRETED := source rest
interpreted-source := $(filter tests/packets/source tests/properties,$(ENGINE))
interpreted-rest := $(filter-out $(interpreted-source),$(ENGINE)) $(UNCOMPILED)

# They write no list of what failed last: all would write the same file.
UNKEPT := -p no:cacheprovider

# For what runs alone: a file goes to one worker as a whole.
WORKERS := $(if $(filter-out 1,$(JOBS)),-n $(JOBS) --dist loadfile,-n 0)

export PYTHONSAFEPATH := 1
export VENV
# Without kept bytecode every worker rewrites the asserts of all tests again, and every command that a test starts compiles
# what it imports.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test checks release-tests docs browser browser-sample wheels bundle container-steps lint types test-installed test-interpreted environment test-environment format coverage fuzz fuzz-installed properties record clean
# Only what `checks` starts goes side by side.
ifndef BESIDE
.NOTPARALLEL:
endif

demo: environment
	$(BIN)/s7dissect analyze $(DEMO)

test: test-environment lint checks

# Side by side; what each has to say comes when it is done. They ask tshark for the same, which is done once.
checks:
	@answers=$$(mktemp -d); trap 'rm -rf "$$answers"' EXIT; \
	S7DISSECT_TSHARK_ANSWERS=$$answers $(MAKE) --no-print-directory --keep-going --output-sync=target -j $(JOBS) BESIDE=yes \
		test-installed test-interpreted types container-steps

# The analyzer as one page; packages of npm and PyPI are kept beside the environment.
browser: environment
	@mkdir -p build/browser
	$(BIN)/s7dissect browser -o build/browser/s7dissect.html --packages $(VENV)/browser --force

# The page against the command line, byte for byte, on the captures of S7DISSECT_CORPUS.
browser-sample: test-environment
	PYTHONPATH=$(CURDIR) $(BIN)/python -m tests.output.browser.sample $${S7DISSECT_CORPUS:?names no folder of captures}

wheels:
	scripts/wheels.sh

# PLATFORM is a tag of wheels; empty for this system. What was made is installed at once, without a network.
bundle:
	$(COMPILED) scripts/environment.sh bundle
	@mkdir -p build
	env -u PYTHONSAFEPATH $(BIN)/python -m scripts.bundle --output build/bundle $(if $(PLATFORM),--platform $(PLATFORM)) \
		$(if $(PYTHON_VERSION),--python $(PYTHON_VERSION)) --wheel "$$(echo $(VENV)/s7dissect-wheel/*.whl)" | tee build/bundle.txt
	env -u PYTHONSAFEPATH $(BIN)/python -m scripts.try_bundle "$$(sed -n 's/^[0-9a-f]\{64\}  //p' build/bundle.txt)"

# Needs no network once the environment is there. What it warns of is an error: a link that leads nowhere, a page in no group.
docs:
	$(COMPILED) scripts/environment.sh docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "make docs: build/docs/index.html"

environment:
	$(COMPILED) scripts/environment.sh

test-environment:
	$(COMPILED) scripts/environment.sh test
	scripts/install-nodes7.sh
	scripts/install-native.sh
	scripts/install-pyright.sh
	scripts/install-page-tools.sh
	scripts/install-tools.sh

lint:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# What is not on every system is behind sys.platform, which mypy reads: as on Windows and macOS, where nobody runs the tests.
types:
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32 dissect
	$(BIN)/mypy --platform darwin --cache-dir .mypy_cache/darwin dissect

# The installed wheel. Without a C compiler it is interpreted, which a person may want to test and CI must not let pass.
test-installed: $(INSTALLED:%=installed-%)

installed-%:
	@build=$$($(BIN)/s7dissect --version | sed 's/.*(\(.*\))/\1/'); \
	if [ "$$build" != compiled ] && [ -n "$$CI" ]; then \
		echo "make test: the wheel is not compiled; $(VENV)/s7dissect-wheel/build.log says why" >&2; exit 1; \
	fi; \
	export S7DISSECT_EXPECT=$$build S7DISSECT_WHEEL="$$(echo $(abspath $(VENV))/s7dissect-wheel/*.whl)"; \
	set -x; \
	$(PYTEST) $(UNKEPT) $($@)

# The property tests try hard on the wheel; fewer examples show here that the source reads alike without the compiler.
test-interpreted: $(INTERPRETED:%=interpreted-%)

interpreted-%:
	S7DISSECT_EXAMPLES=$${S7DISSECT_EXAMPLES:-25} S7DISSECT_EXPECT=interpreted PYTHONPATH=$(CURDIR) $(PYTEST) $(UNKEPT) -m "not measured" $($@) $(ONCE:%=--ignore=%)

# What docs/probe/Containerfile says, done in a temporary folder; CONTAINER=analysis: docs/container/Containerfile, which installs
# all extras once more and is no part of `make test`.
container-steps: environment
	$(BIN)/python scripts/container_steps.py $(CONTAINER)

format: test-environment
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# What takes too long for every change, with the wheel: tests whose size can be chosen, at their large one (tests/cases.py).
release-tests: test-environment
	S7DISSECT_EFFORT=release S7DISSECT_EXPECT=$$($(BIN)/s7dissect --version | sed 's/.*(\(.*\))/\1/') $(PYTEST) $(UNKEPT) $(WORKERS) $(RELEASE_TESTS)

# Only interpreted code can be traced.
coverage: test-environment
	PYTHONPATH=$(CURDIR) $(PYTEST) $(WORKERS) -m "not measured" -p pytest_cov --cov --cov-report=term $(ENGINE)

# Every property test with fresh seeds, round after round; a round that fails is repeated with SEED=the one it printed.
properties: test-environment
	@for round in $$(seq $(ROUNDS)); do \
		seed=$${SEED:-$$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')}; \
		echo "round $$round of $(ROUNDS): --hypothesis-seed=$$seed"; \
		CI= PYTHONPATH=$(CURDIR) $(PYTEST) -q $(WORKERS) -m "hypothesis and not measured" \
			--hypothesis-seed=$$seed || exit 1; \
	done

# Every fuzz target for a while, one after the other (docs/fuzzing.md); only interpreted code shows atheris its branches.
# FUZZ=--installed runs them on the installed package, compiled, without atheris; FUZZ="--corpus DIR" keeps what was found.
fuzz:
	scripts/environment.sh test
	scripts/environment.sh fuzz
	@failed=0; for target in container frames segments streams pdus plus blocks tls files inputs; do \
		PYTHONPATH=$(CURDIR) $(BIN)/python -m tests.fuzz $$target --seconds $(FUZZ_SECONDS) $(FUZZ) || failed=1; \
	done; exit $$failed

# So many inputs of all targets to the installed package, compiled; goes on where an earlier run with the same file was stopped.
fuzz-installed: test-environment
	PYTHONPATH=$(CURDIR) $(BIN)/python -m tests.fuzz all --installed --executions $(EXECUTIONS) --jobs $(FUZZ_JOBS) --done $(FUZZ_DONE) $(FUZZ)

# Record captures/ anew with real peers; needs root.
record:
	env -u PYTHONSAFEPATH python3 captures/record/record.py $(NAMES)

clean:
	rm -rf $(VENV) build dist *.egg-info .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache
